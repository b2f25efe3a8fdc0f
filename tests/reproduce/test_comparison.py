import json
from dataclasses import replace

import pytest
from commands import call
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.cli.evaluate import evaluate
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.reproduce.comparison import ObjectCounts, compare
from ggcnn_net2net.reproduce.networks import short_hash
from ggcnn_net2net.reproduce.records import COLUMNS, GraspRecord, RecordFile
from ggcnn_net2net.reproduce.results import current_records
from ggcnn_net2net.simulation.trial import Outcome

BLANK = GraspRecord(**{**dict.fromkeys(COLUMNS), "in_bin": False, "distance": 0.1, "steps": 1})


def record(model, name, pose, success, outcome=None):
    outcome = outcome or (Outcome.SUCCESS if success else Outcome.MISSED)
    values = {"model": model, "weights": model, "object": name, "category": name, "pose": pose}
    return replace(BLANK, **values, success=success, outcome=outcome.value)


def records_of(model, successes):
    """`successes`: "110" by object, a digit a pose."""
    return [
        record(model, name, pose, digit == "1")
        for name, digits in successes.items()
        for pose, digit in enumerate(digits)
    ]


OLD = records_of("old", {"cup": "110", "vase": "000", "box": "111"})
NEW = records_of("new", {"cup": "001", "vase": "110", "box": "111"})


def test_counts_by_hand():
    found = compare([*OLD, *NEW], "old", "new")
    assert (found.first.successes, found.first.trials) == (5, 9)
    assert (found.second.successes, found.second.trials) == (6, 9)
    assert (found.paired.only_first, found.paired.only_second) == (2, 3)
    assert found.objects == (ObjectCounts("vase", 0, 2, 3), ObjectCounts("box", 3, 3, 3), ObjectCounts("cup", 2, 1, 3))


def test_only_scenes_that_both_have_grasped():
    crashed = record("new", "cup", 0, False, Outcome.CRASHED)
    found = compare([*OLD, crashed, *NEW[1:7]], "old", "new")
    assert found.first.trials == found.second.trials == 6
    assert found.objects[-1] == ObjectCounts("cup", 1, 1, 2)


@given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans(), st.booleans()), min_size=1, max_size=30))
def test_nothing_is_lost(trials):
    rows = [
        row
        for pose, (name, first, second) in enumerate(trials)
        for row in (record("old", name, pose, first), record("new", name, pose, second))
    ]
    found = compare(rows, "old", "new")
    assert found.second.successes - found.first.successes == found.paired.only_second - found.paired.only_first
    assert sum(item.first for item in found.objects) == found.first.successes == sum(first for _, first, _ in trials)
    assert sum(item.second for item in found.objects) == found.second.successes
    assert sum(item.poses for item in found.objects) == found.first.trials == len(trials)
    turned = compare(rows, "new", "old")
    assert turned.paired.p_value == pytest.approx(found.paired.p_value)


def test_networks_that_cannot_be_compared():
    with pytest.raises(ResultsError, match="expected one of the networks old; new, received 'mine'"):
        compare([*OLD, *NEW], "old", "mine")
    with pytest.raises(ResultsError, match="none, received 'old'"):
        compare([], "old", "new")
    with pytest.raises(ResultsError, match="expected scenes that both 'old' and 'new'"):
        compare([*OLD[:3], *NEW[3:]], "old", "new")


def test_command(tmp_path):
    RecordFile(tmp_path / "grasps.csv").rewrite([*OLD, *NEW])
    (tmp_path / "results.json").write_text('{"networks": []}')
    lines = call(evaluate, "compare", tmp_path, "old", "new").splitlines()
    assert "new against old, same scenes: 3 won, 2 lost, p = 1 (McNemar's exact test)" in lines
    assert ["new", "6/9", "0.667", "(0.354-0.879)"] in [line.split() for line in lines]
    assert ["vase", "0", "2", "3"] in [line.split() for line in lines]
    assert lines[-1] == "As many successes with both: 1 of 3 objects"
    with pytest.raises(ResultsError, match=r"holds no grasps\.csv"):
        call(evaluate, "compare", tmp_path.parent, "old", "new")
    same = call(evaluate, "compare", tmp_path, "old", "old")
    assert "0 won, 0 lost, p = 1 " in same
    assert "3 of 3 objects" in same


def test_of_a_network_that_was_trained_further_the_last_table_counts(tmp_path):
    before, after = short_hash("before" * 11), short_hash("after" * 13)
    rows = [replace(row, weights=weights, model="mine") for row, weights in ((OLD[0], before), (NEW[0], after))]
    RecordFile(tmp_path / "grasps.csv").rewrite([*rows, *OLD])
    assert [row.weights for row in shown(tmp_path, [])] == [after, *["old"] * len(OLD)]
    table = [{"name": "mine", "sha256": "before" * 11}, {"name": "empty", "sha256": ""}]
    assert [row.weights for row in shown(tmp_path, table)] == [before, *["old"] * len(OLD)]
    (tmp_path / "results.json").write_text("{")
    with pytest.raises(ResultsError, match=r"results\.json"):
        current_records(tmp_path)


def test_rows_of_the_same_weights_have_the_same_grasps(tmp_path):
    """They were executed once, under the name of the first."""
    weights = short_hash("weights" * 9)
    RecordFile(tmp_path / "grasps.csv").rewrite([replace(row, weights=weights) for row in OLD])
    records = shown(tmp_path, [{"name": name, "sha256": "weights" * 9} for name in ("old", "copy")])
    assert compare(records, "old", "copy").paired.p_value == 1
    assert [row.model for row in records] == ["old"] * len(OLD) + ["copy"] * len(OLD)
    renamed = shown(tmp_path, [{"name": "copy", "sha256": "weights" * 9}])
    assert compare(renamed, "old", "copy").first == compare(records, "old", "old").first


def shown(folder, networks):
    (folder / "results.json").write_text(json.dumps({"networks": networks}))
    return current_records(folder)
