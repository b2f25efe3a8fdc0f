"""Run one function on many inputs on the workers of a Dask cluster: docs/cluster.md."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import ClusterError
from ggcnn_net2net.parallel import Crash, pack_task, run_task

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_SECONDS = 10


class DaskWorkers:
    """The workers of a Dask cluster; see `parallel.Workers` for the contract of `run`.

    A context manager: leaving it closes the connection and leaves the cluster running. While there are no workers, a
    run waits for some. Dask cannot stop a running function: when a run stops early, functions that have begun run to
    their end, and their results are discarded.

    Args:
        address: of the scheduler, "tcp://host:8786".

    Raises:
        ClusterError: `distributed` is not installed, nothing answers at the address, or a worker has several threads.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._client = _connect(address)

    def __enter__(self) -> DaskWorkers:
        try:
            _expect_one_thread(self._client.nthreads())
        except ClusterError:
            self._client.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    @property
    def count(self) -> int:
        """Number of workers now; it changes as they come and go."""
        return len(self._client.nthreads())

    def run(self, function: Callable[..., Any], inputs: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """See `parallel.Workers.run`. An input whose worker dies is tried as often as the scheduler allows, twice over.

        Args:
            function: as of `parallel.Workers.run`.
            inputs: as of `parallel.Workers.run`.

        Yields:
            Index and result of each input, in the order in which they are done.

        Raises:
            ClusterError: a worker with several threads, or the scheduler went away.
        """
        tasks = {index: pack_task(function, values) for index, values in enumerate(inputs)}
        suspects: dict[int, Crash] = {}
        name = function.__name__  # Dask learns how long tasks take by the name of the function
        for index, result in self._results(name, tasks):
            if isinstance(result, Crash):
                suspects[index] = result
            else:
                yield index, result
        # Dask also blames a worker's death on the tasks that waited there. Run alone, only the guilty one kills again.
        for index, first in suspects.items():
            for _, result in self._results(name, {index: tasks[index]}):
                yield index, Crash(None, first.attempts + result.attempts) if isinstance(result, Crash) else result

    def _results(self, name: str, tasks: Mapping[int, bytes]) -> Iterator[tuple[int, Any]]:
        from distributed import as_completed

        futures = self._client.map(_run_task, tasks.values(), key=name, pure=False)
        pending = dict(zip(futures, tasks, strict=True))
        try:
            for future in as_completed(futures, loop=self._client.loop):
                yield pending.pop(future), self._outcome(future)
        finally:
            if pending and self._client.status == "running":
                self._client.cancel(list(pending))

    def _outcome(self, future: Future) -> Any:
        from distributed import KilledWorker

        try:
            return pickle.loads(future.result())
        except KilledWorker as error:
            return Crash(None, error.allowed_failures + 1)
        except CancelledError as error:
            raise ClusterError(
                f"the Dask scheduler at {self._address} went away or gave the work up: {error}"
            ) from error


def _connect(address: str) -> Client:
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError as error:
        raise ClusterError(
            "expected the package `distributed` for work on a Dask cluster, it is not installed: "
            "pip install 'ggcnn_net2net[distributed]'"
        ) from error
    try:
        get_address_host_port(address, strict=True)  # refuses what a Client tries to connect to for long
        return Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"expected a Dask scheduler that answers within {_CONNECT_SECONDS} s at an address such as "
            f"tcp://host:8786, received {address!r}: start one with `dask scheduler`, it prints its address ({error})"
        ) from error


def _run_task(task: bytes) -> bytes:
    """In a Dask worker."""
    from distributed import get_worker

    worker = get_worker()
    _expect_one_thread({worker.address: worker.state.nthreads})  # it may have come after the connection was made
    return run_task(task)


def _expect_one_thread(threads: Mapping[str, int]) -> None:
    """Refuse workers that would run two inputs in one process.

    TensorFlow's number of threads, and with it the bits of the weights, is one for the whole process.

    Raises:
        ClusterError: one has several threads.
    """
    for worker, count in threads.items():
        if count != 1:
            raise ClusterError(
                f"expected Dask workers with one thread, the one at {worker} has {count}: start them with "
                "`dask worker ADDRESS --nthreads 1 --nworkers 2`"
            )
