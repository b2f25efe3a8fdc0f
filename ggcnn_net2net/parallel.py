"""Run one function on many inputs in worker processes, and survive the death of a worker."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from typing import Any

from pebble import ProcessExpired, ProcessFuture, ProcessPool

from ggcnn_net2net.errors import GGCNNError

_ATTEMPTS = 2
_BACKLOG = 4  # inputs in flight for each worker; bounds the memory that waiting inputs take


@dataclass(frozen=True)
class Crash:
    """Stands for the result of an input on which a worker process died `attempts` times."""

    exit_code: int
    attempts: int


def run_parallel(
    function: Callable[..., Any], inputs: Iterable[tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, Any]]:
    """Yield (index of the input, result) as results come in, in no fixed order.

    Args:
        function: importable, called with the values of one input.
        inputs: argument tuples.
        workers: processes; fresh interpreters, so that nothing of this one (such as TensorFlow) is copied.

    Yields:
        Index and result. An input whose worker dies is tried once more, and then has a `Crash` for a result; the
        others are not disturbed. An exception of `function` is raised here.

    When the caller stops early (an exception, Ctrl-C, `break`), all workers are ended.

    Raises:
        GGCNNError: workers below 1.
    """
    if workers < 1:
        raise GGCNNError(f"expected workers of 1 or more, received {workers}")
    pool = ProcessPool(max_workers=workers, context=multiprocessing.get_context("spawn"))
    waiting = iter(enumerate(inputs))
    running: dict[ProcessFuture, tuple[int, tuple[Any, ...], int]] = {}

    def start(index: int, values: tuple[Any, ...], attempt: int) -> None:
        running[pool.schedule(function, args=values)] = (index, values, attempt)

    try:
        while True:
            while len(running) < workers * _BACKLOG and (item := next(waiting, None)) is not None:
                start(*item, 1)
            if not running:
                break
            wait(running, return_when=FIRST_COMPLETED)
            for future in [future for future in running if future.done()]:
                index, values, attempt = running.pop(future)
                error = future.exception()
                if not isinstance(error, ProcessExpired):
                    yield index, future.result()
                elif attempt < _ATTEMPTS:
                    start(index, values, attempt + 1)
                else:
                    yield index, Crash(error.exitcode or 0, attempt)
    finally:
        pool.stop()
        pool.join()
