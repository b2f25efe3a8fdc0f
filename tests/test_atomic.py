import pytest

from ggcnn_net2net.atomic import alone, replacing, write_text
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
