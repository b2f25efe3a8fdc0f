"""Run one function on many inputs in worker processes, and survive the death of a worker."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from multiprocessing import connection
from typing import Any, Protocol

from pebble import ProcessExpired, ProcessFuture, ProcessPool

from ggcnn_net2net.errors import GGCNNError

_ATTEMPTS = 2
_BACKLOG = 4  # inputs in flight for each worker; bounds the memory that waiting inputs take
_CHECK_SECONDS = 1.0  # between two looks whether the pool itself is alive


@dataclass(frozen=True)
class Crash:
    """Stands for the result of an input on which a worker process died `attempts` times.

    Attributes:
        exit_code: of the last one, negative for a signal; None where it is not known (another machine).
        attempts: how often the input was tried.
    """

    exit_code: int | None
    attempts: int


class Workers(Protocol):
    """Processes that run functions: of this machine (`LocalWorkers`) or of a Dask cluster (`cluster.DaskWorkers`)."""

    @property
    def count(self) -> int:
        """How many inputs are worked on at the same time."""

    def run(self, function: Callable[..., Any], inputs: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """Yield (index of the input, result) as results come in, in no fixed order.

        Args:
            function: importable, called with the values of one input.
            inputs: argument tuples.

        Yields:
            Index and result. An input whose worker dies is tried again, and in the end has a `Crash` for a result;
            the others are not disturbed. An exception of `function` is raised here.

        When the caller stops early (an exception, Ctrl-C, `break`), unfinished inputs are given up. One run at a time.
        """


class LocalWorkers:
    """Worker processes of this machine that stay alive from one `run` to the next; see `Workers` for its contract.

    A context manager: leaving it ends all workers, also in mid-task. So does the death of this process, `kill -9`
    included, and an early stop of `run`; the next `run` then starts new ones.

    Args:
        count: processes; fresh interpreters, so that nothing of this one (such as TensorFlow) is copied.

    Raises:
        GGCNNError: count below 1.
    """

    @classmethod
    def of(cls, workers: Workers) -> AbstractContextManager[LocalWorkers]:
        """The given workers if they run on this machine, otherwise as many new local ones, at most one per core.

        For work on files that other machines need not have, such as meshes in the user's cache.

        Args:
            workers: of this machine or of a cluster.

        Returns:
            A context manager; leaving it ends workers that it started, but not those that were given.
        """
        if isinstance(workers, cls):
            return nullcontext(workers)
        return cls(min(max(1, workers.count), os.cpu_count() or 1))

    def __init__(self, count: int) -> None:
        if count < 1:
            raise GGCNNError(f"expected workers of 1 or more, received {count}")
        self.count = count
        self._pool: ProcessPool | None = None
        self._running: dict[ProcessFuture, tuple[int, bytes, int]] = {}

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def run(self, function: Callable[..., Any], inputs: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """See `Workers.run`. An input whose worker dies is tried once more.

        Args:
            function: as of `Workers.run`.
            inputs: as of `Workers.run`.

        Yields:
            Index and result of each input, in the order in which they are done.

        Raises:
            GGCNNError: workers die before they begin, or were ended by leaving the context or by another run.
        """
        pool = self._pool_without_tasks()
        waiting = enumerate(inputs)
        self._running = running = {}

        def start(index: int, task: bytes, attempt: int) -> None:
            running[pool.schedule(run_task, args=(task,))] = (index, task, attempt)

        try:
            while True:
                while len(running) < self.count * _BACKLOG and (item := next(waiting, None)) is not None:
                    start(item[0], pack_task(function, item[1]), 1)
                if not running:
                    break
                wait(running, _CHECK_SECONDS, return_when=FIRST_COMPLETED)
                done = [future for future in running if future.done()]
                if not pool.active:
                    raise GGCNNError(
                        "expected waiting worker processes, they have ended: they cannot start (does the script lack "
                        "`if __name__ == '__main__':`?), memory is short, or the workers were closed meanwhile"
                    )
                for future in done:
                    index, task, attempt = running.pop(future)
                    error = future.exception()
                    if not isinstance(error, ProcessExpired):
                        yield index, pickle.loads(future.result())
                    elif attempt < _ATTEMPTS:
                        start(index, task, attempt + 1)
                    else:
                        yield index, Crash(error.exitcode, attempt)
        finally:
            if running and pool is self._pool:
                self._end()

    def _pool_without_tasks(self) -> ProcessPool:
        """The pool of the last run, or a new one where that run is unfinished or lost the pool."""
        if self._pool is not None and (self._running or not self._pool.active):
            self._end()
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPool(max_workers=self.count, initializer=_end_with_parent, context=context)
        return self._pool

    def _end(self) -> None:
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = None


def run_parallel(
    function: Callable[..., Any], inputs: Iterable[tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, Any]]:
    """`LocalWorkers(workers).run(function, inputs)` with processes for this call alone.

    Args:
        function: as of `Workers.run`.
        inputs: as of `Workers.run`.
        workers: number of processes.

    Yields:
        Index and result of each input, in the order in which they are done.

    Raises:
        GGCNNError: workers below 1.
    """
    with LocalWorkers(workers) as pool:
        yield from pool.run(function, inputs)


def pack_task(function: Callable[..., Any], values: tuple[Any, ...]) -> bytes:
    """The bytes that `run_task` takes.

    Pools (Pebble's, Dask's) lose a task or themselves when something cannot be unpickled; bytes always can.

    Args:
        function: at the top level of a module.
        values: its arguments.

    Returns:
        A pickle of both.
    """
    return pickle.dumps((function, values))


def run_task(task: bytes) -> bytes:
    """Call a packed function in a worker.

    Args:
        task: what `pack_task` made.

    Returns:
        Its result, pickled.

    Raises:
        GGCNNError: the function raised an exception that cannot be sent; all others are raised as they are, those of
            pickling arguments and result included.
    """
    try:
        function, values = pickle.loads(task)
        return pickle.dumps(function(*values))
    except Exception as error:
        if _survives_pickling(error):
            raise
        raise GGCNNError(f"a worker raised {type(error).__name__}: {error}") from error


def _survives_pickling(error: Exception) -> bool:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return False
    return True


def _end_with_parent() -> None:
    """In a worker: end it as soon as its parent is dead, in mid-task as well."""
    threading.Thread(target=_wait_for_end_of_parent, daemon=True).start()


def _wait_for_end_of_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)
