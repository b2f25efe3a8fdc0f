import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ggcnn_net2net.errors import GGCNNError
from ggcnn_net2net.parallel import Crash, run_parallel


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


SLEEPER = """
import os, sys, time
from ggcnn_net2net.parallel import run_parallel
def sleep(_):
    open(os.path.join(sys.argv[1], str(os.getpid())), "w").close()
    time.sleep(float(sys.argv[2]))
if __name__ == "__main__":
    for _ in run_parallel(sleep, [(n,) for n in range(8)], 2):
        pass
"""


@pytest.mark.parametrize(("how", "task_seconds"), [(signal.SIGINT, 120), (signal.SIGKILL, 3)])
def test_no_orphans(tmp_path, how, task_seconds):
    """Ctrl-C ends the workers in mid-task; workers of a killed parent end with their task."""
    script = tmp_path / "sleeper.py"
    script.write_text(SLEEPER)
    pids = tmp_path / "pids"
    pids.mkdir()
    command = [sys.executable, str(script), str(pids), str(task_seconds)]
    parent = subprocess.Popen(command, stderr=subprocess.DEVNULL)
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
