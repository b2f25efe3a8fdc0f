import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from ggcnn_net2net.errors import GGCNNError
from ggcnn_net2net.parallel import Crash, LocalWorkers, run_parallel


def work(value, folder=""):
    """Square; dies on 3 always, on 4 the first time."""
    if value == 3:
        os._exit(7)
    if value == 4:
        marker = Path(folder) / "tried"
        if not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    if value == 5:
        raise ArithmeticError("five")
    return value * value


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_with_their_index(workers):
    inputs = [(value,) for value in (9, 8, 7, 6, 2, 1, 0) * 3]
    results = dict(run_parallel(work, inputs, workers))
    assert [results[index] for index in range(len(inputs))] == [value * value for (value,) in inputs]


def test_a_dead_worker_costs_only_its_own_input(tmp_path):
    results = dict(run_parallel(work, [(value, str(tmp_path)) for value in (1, 3, 4, 6)], 2))
    assert results[0] == 1
    assert results[1] == Crash(exit_code=7, attempts=2)
    assert results[2] == 16  # the second attempt
    assert results[3] == 36


def test_an_exception_is_raised_here():
    with pytest.raises(ArithmeticError, match="five"):
        list(run_parallel(work, [(5,)], 1))


def test_no_worker_is_refused():
    with pytest.raises(GGCNNError, match="workers"):
        list(run_parallel(work, [(1,)], 0))


def pid_after(seconds):
    time.sleep(seconds)
    return os.getpid()


def pids_of(workers, seconds=0.3):
    return {pid for _, pid in workers.run(pid_after, [(seconds,)] * 4 * workers.count)}


def test_workers_stay_alive_between_runs_and_end_with_the_context():
    with LocalWorkers(2) as workers:
        first = pids_of(workers)
        assert len(first) == 2
        assert pids_of(workers) == first
    assert not any(map(alive, first))


def test_workers_of_this_machine_are_taken_as_they_are_and_stay():
    with LocalWorkers(1) as workers:
        with LocalWorkers.of(workers) as own:
            assert own is workers
            first = pids_of(own)
        assert pids_of(workers) == first


def test_workers_of_a_cluster_are_not_taken_for_work_on_this_machine():
    with LocalWorkers.of(SimpleNamespace(count=0)) as own:  # it may have none yet
        assert (type(own), own.count) == (LocalWorkers, 1)
    with LocalWorkers.of(SimpleNamespace(count=10**6)) as own:
        assert own.count == os.cpu_count()


def test_leaving_the_context_ends_workers_in_mid_task():
    start = time.monotonic()
    with LocalWorkers(1) as workers:
        results = workers.run(pid_after, [(0,), (120,)])
        _, pid = next(results)
    assert not alive(pid)
    assert time.monotonic() - start < 60
    with pytest.raises(GGCNNError, match="closed meanwhile"):
        next(results)


def test_a_pool_goes_on_after_the_death_of_a_worker_at_work(tmp_path):
    with LocalWorkers(2) as workers:
        assert dict(workers.run(work, [(3,), (4, str(tmp_path))])) == {0: Crash(exit_code=7, attempts=2), 1: 16}
        assert dict(workers.run(work, [(value,) for value in (6, 7, 8)])) == {0: 36, 1: 49, 2: 64}


def test_a_pool_goes_on_after_the_death_of_idle_workers():
    with LocalWorkers(2) as workers:
        for pid in pids_of(workers):
            os.kill(pid, signal.SIGKILL)
        wait_until(lambda: not workers._pool.active)  # Pebble gives the pool up, which takes it a moment to notice
        assert dict(workers.run(work, [(6,), (7,)])) == {0: 36, 1: 49}


def test_a_break_ends_the_workers():
    with LocalWorkers(2) as workers:
        for _, pid in workers.run(pid_after, [(0,), (120,), (120,)]):
            assert alive(pid)
            break
        assert not alive(pid)


def stop_by_break(workers, inputs):
    for _ in workers.run(pid_after, inputs):
        break


def stop_by_an_exception(workers, inputs):
    with pytest.raises(TypeError):
        list(workers.run(pid_after, [("no number",), *inputs]))


def stop_and_keep_the_generator(workers, inputs):
    workers.kept = workers.run(pid_after, inputs)
    next(workers.kept)


@pytest.mark.parametrize("stop", [stop_by_break, stop_by_an_exception, stop_and_keep_the_generator])
def test_a_run_that_stops_early_leaves_nothing_to_the_next(stop):
    start = time.monotonic()
    with LocalWorkers(2) as workers:
        stop(workers, [(0.1,), (120,), (120,), (0.1,)])
        assert dict(workers.run(work, [(6,), (7,), (8,)])) == {0: 36, 1: 49, 2: 64}
        assert dict(workers.run(work, [(9,)])) == {0: 81}
    assert time.monotonic() - start < 60


class Unpicklable:
    """Pickles, and cannot be unpickled."""

    def __reduce__(self):
        return int, ("not a number",)


class Unsendable(Exception):
    """An exception that pickles, and cannot be unpickled."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def identity(value):
    return value


def make(kind):
    return {"lambda": lambda: None, "generator": iter(lambda: 0, 1), "unpicklable": Unpicklable()}[kind]


def throw(kind):
    raise {"unsendable": Unsendable(1, 2), "local": type("Local", (Exception,), {})("local")}[kind]


@pytest.mark.timeout(60)  # each of these once waited for ever
@pytest.mark.parametrize(
    ("function", "value", "error", "message"),
    [
        (identity, Unpicklable(), ValueError, "invalid literal"),
        (make, "unpicklable", ValueError, "invalid literal"),
        (make, "lambda", Exception, "pickle"),
        (make, "generator", Exception, "pickle"),
        (throw, "unsendable", GGCNNError, "Unsendable: 1 and 2"),
        (throw, "local", GGCNNError, "Local: local"),
    ],
)
def test_what_cannot_be_pickled_is_an_exception_and_the_pool_goes_on(function, value, error, message):
    with LocalWorkers(2) as workers:
        with pytest.raises(error, match=message):
            list(workers.run(function, [(value,)]))
        assert list(workers.run(work, [(6,)])) == [(0, 36)]


UNGUARDED = """
from ggcnn_net2net.parallel import LocalWorkers
list(LocalWorkers(1).run(abs, [(1,)]))
"""


def test_workers_that_cannot_start_are_an_error(tmp_path):
    script = tmp_path / "unguarded.py"
    script.write_text(UNGUARDED)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "GGCNNError: expected waiting worker processes" in done.stderr


SLEEPER = """
import os, sys, time
from ggcnn_net2net.parallel import run_parallel
def sleep(_):
    open(os.path.join(sys.argv[1], str(os.getpid())), "w").close()
    time.sleep(120)
if __name__ == "__main__":
    for _ in run_parallel(sleep, [(n,) for n in range(8)], 2):
        pass
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_orphans(tmp_path, how):
    """Neither Ctrl-C nor the death of the parent leaves workers behind, which end in mid-task."""
    script = tmp_path / "sleeper.py"
    script.write_text(SLEEPER)
    pids = tmp_path / "pids"
    pids.mkdir()
    parent = subprocess.Popen([sys.executable, str(script), str(pids)], stderr=subprocess.DEVNULL)
    wait_until(lambda: len(list(pids.iterdir())) == 2)
    parent.send_signal(how)
    parent.wait(30)
    wait_until(lambda: not any(alive(int(file.name)) for file in pids.iterdir()))


def wait_until(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.1)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
