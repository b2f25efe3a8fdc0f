import logging
import os
import signal
import sys
import time
from pathlib import Path

import dask
import pytest
from distributed import LocalCluster

from ggcnn_net2net.cluster import DaskWorkers
from ggcnn_net2net.errors import ClusterError, GGCNNError
from ggcnn_net2net.parallel import Crash

pytestmark = pytest.mark.slow  # a cluster of processes starts, and workers die and come back


def local_cluster(workers, threads=1):
    # One death less per input than by default: each costs the start of a new worker.
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}):
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=threads,
            processes=True,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        )


@pytest.fixture(scope="module")
def cluster():
    with local_cluster(workers=2) as cluster:
        yield cluster


@pytest.fixture
def workers(cluster):
    cluster.wait_for_workers(2)  # the nanny brings back those that the test before killed
    with DaskWorkers(cluster.scheduler_address) as workers:
        yield workers


class Unpicklable:
    """Pickles, and cannot be unpickled."""

    def __reduce__(self):
        return int, ("not a number",)


class Unsendable(Exception):
    """An exception that pickles, and cannot be unpickled."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def square(value):
    return value * value


def raise_unsendable(value):
    raise Unsendable(value, value)


def return_unpicklable():
    return Unpicklable()


def raise_for_five(value):
    if value == 5:
        raise ArithmeticError("five")


def die_on_three(value, folder):
    """Square; dies on 3 always, on 4 the first time, by the signal of the kernel when memory is out."""
    marker = Path(folder) / "tried"
    if value == 3 or (value == 4 and not marker.exists()):
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return value * value


def sleep(seconds, folder="", name=""):
    if folder:
        (Path(folder) / name).touch()
    time.sleep(seconds)
    return seconds


def pid(seconds):
    time.sleep(seconds)
    return os.getpid()


def test_results_come_with_their_index(workers):
    assert workers.count == 2
    inputs = [(value,) for value in (9, 8, 7, 6, 2, 1, 0) * 3]
    results = list(workers.run(square, inputs))
    assert sorted(results) == [(index, value * value) for index, (value,) in enumerate(inputs)]


def test_equal_inputs_are_all_worked_on_and_by_all_workers(workers):
    assert len({result for _, result in workers.run(pid, [(0.5,)] * 4)}) == 2


def test_no_input_no_result(workers):
    assert list(workers.run(square, [])) == []


def test_an_exception_is_raised_here(workers):
    with pytest.raises(ArithmeticError, match="five"):
        list(workers.run(raise_for_five, [(5,), (1,)]))


@pytest.mark.parametrize(
    ("function", "values", "error"),
    [
        (square, (Unpicklable(),), ValueError),
        (return_unpicklable, (), ValueError),
        (raise_unsendable, (1,), GGCNNError),
    ],
)
def test_what_cannot_be_unpickled_is_an_exception(workers, function, values, error):
    with pytest.raises(error):
        list(workers.run(function, [values]))


def test_a_killed_worker_costs_only_the_input_that_killed_it(workers, tmp_path):
    results = dict(workers.run(die_on_three, [(value, str(tmp_path)) for value in (1, 4, 6, 7, 8)]))
    assert results == {0: 1, 1: 16, 2: 36, 3: 49, 4: 64}


def test_an_input_that_always_kills_its_worker_is_a_crash(workers, tmp_path):
    """Also on what was waiting at the same workers, Dask puts the blame."""
    results = dict(workers.run(die_on_three, [(value, str(tmp_path)) for value in (3, 1, 2, 5, 6, 7)]))
    assert results == {0: Crash(exit_code=None, attempts=4), 1: 1, 2: 4, 3: 25, 4: 36, 5: 49}


def test_a_break_cancels_what_has_not_begun(workers, tmp_path):
    inputs = [(0, str(tmp_path), "0"), *[(1, str(tmp_path), str(number)) for number in range(1, 9)]]
    for _, seconds in workers.run(sleep, inputs):
        assert seconds == 0
        break
    assert list(workers.run(square, [(3,)])) == [(0, 9)]
    time.sleep(1.5)
    assert len(list(tmp_path.iterdir())) < len(inputs) / 2


def test_a_lost_scheduler_is_an_error():
    with local_cluster(workers=1) as cluster, DaskWorkers(cluster.scheduler_address) as workers:
        results = workers.run(sleep, [(0,), (60,)])
        assert next(results) == (0, 0)
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        cluster.close()
        with pytest.raises(ClusterError, match=r"scheduler at .* went away"):
            next(results)


def test_workers_with_several_threads_are_refused():
    with local_cluster(workers=1, threads=2) as cluster:
        with pytest.raises(ClusterError, match="--nthreads 1"), DaskWorkers(cluster.scheduler_address):
            pass
        late = DaskWorkers(cluster.scheduler_address)  # as if the worker had come after the check
        with pytest.raises(ClusterError, match="--nthreads 1"):
            list(late.run(square, [(1,)]))
        late.__exit__()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "tcp://127.0.0.1", "nonsense", "no_such_scheme://host:1"])
def test_an_unreachable_scheduler_is_an_error(address, monkeypatch):
    monkeypatch.setattr("ggcnn_net2net.cluster._CONNECT_SECONDS", 1)
    with pytest.raises(ClusterError, match=r"expected a Dask scheduler .* `dask scheduler`"):
        DaskWorkers(address)


def test_the_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install 'ggcnn_net2net\[distributed\]'"):
        DaskWorkers("tcp://127.0.0.1:8786")
