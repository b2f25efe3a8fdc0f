import json

import pytest

from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.zoo import measured

RATE = {"successes": 3, "trials": 4, "rate": 0.75, "wilson_95": [0.3, 0.95]}
ROWS = [
    {"name": "original", "sha256": "a" * 64, "success": RATE | {"successes": 2}, "in_bin": RATE},
    {"name": "mine", "sha256": "b" * 64, "success": RATE, "in_bin": RATE | {"successes": 1}},
    {"name": "extended", "sha256": "", "success": None, "in_bin": None},
]
TABLE = {
    "command": "reproduce table1",
    "finished": True,
    "settings": {
        "scenes": {"object_set": "ycb40", "poses": 5, "seed": 0},
        "protocol": {"name": "PAPER"},
        "versions": {"keras": "3"},
    },
    "networks": ROWS,
}
IOU_RATE = {"successes": 1, "images": 2, "rate": 0.5, "wilson_95": [0.1, 0.9]}
IOU = {
    "model": {"file": "mine.hdf5", "sha256": "b" * 64},
    "dataset": {"file": "/somewhere/data.h5", "split": "test", "images": 2, "fingerprint": "f"},
    "rates": [{"protocol": {"name": name}, **IOU_RATE} for name in ("PAPER", "CORRECTED")],
    "versions": {"keras": "3"},
}


@pytest.fixture
def files(tmp_path):
    (tmp_path / "results.json").write_text(json.dumps(TABLE))
    (tmp_path / "iou.json").write_text(json.dumps(IOU))
    return tmp_path, tmp_path / "iou.json"


def test_a_gripper_that_is_not_the_papers_is_on_record(files):
    folder, _ = files
    (paper,) = measured("b" * 64, [folder])["sim"]
    assert "gripper" not in paper
    settings = {**TABLE["settings"], "gripper": {"max_opening": 0.08}}
    (folder / "results.json").write_text(json.dumps({**TABLE, "settings": settings}))
    (small,) = measured("b" * 64, [folder])["sim"]
    assert small["gripper"] == {"max_opening": 0.08}


def test_results_of_the_right_network_are_taken(files):
    folder, iou = files
    found = measured("b" * 64, [folder], [iou])
    (sim,) = found["sim"]
    assert (sim["objects"], sim["poses"], sim["protocol"]) == ("ycb40", 5, "PAPER")
    assert (sim["success"]["successes"], sim["in_bin"]["successes"]) == (3, 1)
    assert [entry["protocol"] for entry in found["iou"]] == ["PAPER", "CORRECTED"]
    assert found["iou"][0]["dataset"]["file"] == "data.h5"
    assert found["iou"][0]["rate"] == 0.5


def test_a_benchmark_that_is_not_finished_is_refused(files):
    folder, _ = files
    (folder / "results.json").write_text(json.dumps({**TABLE, "finished": False}))
    with pytest.raises(ResultsError, match="only what is missing"):
        measured("b" * 64, [folder])


def test_two_rows_of_the_same_weights_are_one_network(files):
    folder, _ = files
    (folder / "results.json").write_text(json.dumps({**TABLE, "networks": [*ROWS, {**ROWS[1], "name": "copy"}]}))
    assert measured("b" * 64, [folder])["sim"][0]["success"]["successes"] == 3


def test_what_was_not_measured_is_left_out(files):
    assert measured("b" * 64) == {}
    assert measured("b" * 64, [files[0]]).keys() == {"sim"}


@pytest.mark.parametrize("kind", ["results", "iou"])
def test_results_of_other_networks_are_refused(files, kind):
    with pytest.raises(ResultsError, match=r"cccc.*received 0"):
        measured("c" * 64, **{kind: [files[0] if kind == "results" else files[1]]})


def test_files_of_another_kind_are_refused(files):
    folder, iou = files
    with pytest.raises(ResultsError, match="evaluate iou"):
        measured("b" * 64, iou=[folder / "results.json"])
    (folder / "results.json").write_text(iou.read_text())
    with pytest.raises(ResultsError, match="reproduce table1"):
        measured("b" * 64, results=[folder])
    with pytest.raises(ResultsError, match="cannot read"):
        measured("b" * 64, results=[folder / "nowhere"])
