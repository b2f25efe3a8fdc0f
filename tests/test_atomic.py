import subprocess
import sys

import pytest

from ggcnn_net2net.atomic import alone, is_one_of, replacing, write_text
from ggcnn_net2net.errors import ResultsError


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "result.json"
    write_text(target, "old")
    with pytest.raises(RuntimeError, match="power cut"), replacing(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError("power cut")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_good_write_replaces(tmp_path):
    target = tmp_path / "new" / "result.json"
    write_text(target, "one")
    write_text(target, "two")
    assert target.read_text() == "two"
    assert list(target.parent.iterdir()) == [target]


def test_the_suffix_is_kept_for_libraries_that_look_at_it(tmp_path):
    with replacing(tmp_path / "plot.png") as temporary:
        assert temporary.suffix == ".png"
        temporary.touch()


WRITE_120_KB = """
import resource, sys
from pathlib import Path
import numpy as np
from ggcnn_net2net.atomic import new_hdf5, replacing

limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    with replacing(Path(sys.argv[1])) as temporary, new_hdf5(temporary) as file:
        for number in range(12):
            file[f"layer{number}/kernel"] = np.full((5, 5, 10, 5), number, "f8")
except OSError as error:
    print(error.strerror)
"""


@pytest.mark.parametrize("limit", [0, 1_000, 20_000, 100_000])
def test_a_full_disk_is_an_os_error(tmp_path, limit):
    """Also when it shows as late as when the file is closed, where HDF5's own driver kills the process."""
    target = tmp_path / "model.hdf5"
    target.write_text("old")
    command = [sys.executable, "-c", WRITE_120_KB, str(target), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "File too large\n"
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_is_known_under_another_name(tmp_path):
    read, other = tmp_path / "read", tmp_path / "other"
    read.touch()
    other.touch()
    (tmp_path / "link").symlink_to(read)
    for name in (read, tmp_path / "link", tmp_path / ".." / tmp_path.name / "read"):
        assert is_one_of(name, [None, tmp_path / "missing", other, read])
        assert not is_one_of(name, [None, tmp_path / "missing", other])
    assert not is_one_of(tmp_path / "missing", [tmp_path / "missing"])  # nothing is there to be lost


def test_one_block_at_a_time(tmp_path):
    lock_file, refusal = tmp_path / "new" / "results.lock", ResultsError("another process")
    with (
        alone(lock_file, refusal),
        pytest.raises(ResultsError, match="another process"),
        alone(lock_file, refusal),
    ):
        raise AssertionError("in a block that is taken")
    with pytest.raises(RuntimeError, match="broken"), alone(lock_file, refusal):
        raise RuntimeError("broken")
    with alone(lock_file, refusal):
        pass  # a block that failed has let others in
