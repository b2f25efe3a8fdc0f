"""What gets into the zoo, and what does not."""

import json

import h5py
import pytest
from numpy.testing import assert_array_equal

from ggcnn_net2net import zoo
from ggcnn_net2net.architecture import build_ggcnn
from ggcnn_net2net.errors import ModelFileError, VerificationError
from ggcnn_net2net.model_files import load_ggcnn, save_ggcnn
from ggcnn_net2net.net2net import deeper, history_of
from ggcnn_net2net.reference_data import sha256_of


def test_what_the_train_command_writes_is_accepted_as_it_is(trained, tmp_path):
    added = zoo.add(trained, trained.with_suffix(".json"), "mine", folder=tmp_path / "zoo")
    assert added == tmp_path / "zoo" / "mine.hdf5"
    before, after = (json.loads(path.with_suffix(".json").read_text()) for path in (trained, added))
    assert after["model_sha256"] == sha256_of(added)
    assert after["trained_sha256"] == sha256_of(trained)
    assert (after["architecture"], after["parameters"]) == ("C5x5x4_C3x3x2_T3x3x2_T5x5x4", before["parameters"])
    assert {key: after[key] for key in before if key != "model_sha256"} == {
        key: before[key] for key in before if key != "model_sha256"
    }
    for one, other in zip(load_ggcnn(added).get_weights(), load_ggcnn(trained).get_weights(), strict=True):
        assert_array_equal(one, other)


def test_results_are_added_later(trained, facts, empty_zoo):
    zoo.add(trained, facts, "mine")
    zoo.add(zoo.network_file("mine"), {**zoo.provenance("mine"), "sim": [{"rate": 0.9}]}, "mine")
    assert zoo.provenance("mine")["sim"] == [{"rate": 0.9}]
    assert zoo.provenance("mine")["trained_sha256"] == facts["model_sha256"]
    assert zoo.network_file("mine").is_file()


def test_an_optimizer_is_left_out_and_the_lineage_is_kept(facts, tmp_path, empty_zoo):
    model = deeper(build_ggcnn("shallow", input_size=20, seed=0), 1)
    model.compile("adam", "mse")
    path = save_ggcnn(model, tmp_path / "mine.keras")
    zoo.add(path, {**facts, "model_sha256": sha256_of(path)}, "mine")
    with h5py.File(zoo.network_file("mine")) as file:
        assert set(file) == {"model_weights"}
        assert "training_config" not in file.attrs
    assert history_of(load_ggcnn("zoo:mine")) == history_of(model)


@pytest.mark.parametrize("place", zoo.REQUIRED_FIELDS)
@pytest.mark.parametrize("value", [None, "", [], {}, 0.5, True])
def test_an_incomplete_provenance_is_refused(place, value, trained, facts, empty_zoo):
    *above, last = place.split(".")
    section = facts[above[0]] if above else facts
    section[last] = value
    with pytest.raises(ModelFileError, match=f"it lacks: {place}"):
        zoo.add(trained, facts, "mine")
    assert list(empty_zoo.iterdir()) == []


def test_everything_that_is_missing_is_named(trained, empty_zoo):
    with pytest.raises(ModelFileError) as caught:
        zoo.add(trained, {"data": "a string", "command": ["one", " "]}, "mine")
    for place in zoo.REQUIRED_FIELDS:
        assert place in str(caught.value)


def test_several_commands_may_have_made_it(trained, facts, empty_zoo):
    zoo.add(trained, {**facts, "command": ["grow ...", "train ..."]}, "mine")
    assert zoo.provenance("mine")["command"] == ["grow ...", "train ..."]


@pytest.mark.parametrize("content", ["", "{", "[1]", None])
def test_a_provenance_that_cannot_be_read(content, trained, tmp_path, empty_zoo):
    path = tmp_path / "made_by.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ModelFileError, match=r"made_by\.json"):
        zoo.add(trained, path, "mine")


def test_the_provenance_of_another_file_is_refused(trained, facts, empty_zoo):
    with pytest.raises(VerificationError, match="different trainings"):
        zoo.add(trained, {**facts, "model_sha256": "0" * 64}, "mine")
    assert list(empty_zoo.iterdir()) == []


def test_a_large_network_is_refused_and_the_old_one_kept(trained, facts, tmp_path, empty_zoo):
    zoo.add(trained, facts, "mine")
    before = sha256_of(zoo.network_file("mine"))
    large = save_ggcnn(build_ggcnn("C9x9x32_C9x9x40_T9x9x8", input_size=9, seed=0), tmp_path / "large.hdf5")
    assert large.stat().st_size > zoo.MAX_BYTES
    with pytest.raises(ModelFileError, match="400,000"):
        zoo.add(large, {**facts, "model_sha256": sha256_of(large)}, "mine")
    assert sha256_of(zoo.network_file("mine")) == before
    assert sorted(path.name for path in empty_zoo.iterdir()) == ["mine.hdf5", "mine.json"]


def test_a_provenance_that_cannot_be_written_changes_nothing(trained, facts, empty_zoo, monkeypatch):
    def fail(*_):
        raise OSError("no space left")

    zoo.add(trained, facts, "mine")
    before = {path.name: path.read_bytes() for path in empty_zoo.iterdir()}
    monkeypatch.setattr("ggcnn_net2net.zoo.adding.write_text", fail)
    for name in ("mine", "other"):
        with pytest.raises(OSError, match="no space left"):
            zoo.add(trained, facts, name)
    assert {path.name: path.read_bytes() for path in empty_zoo.iterdir()} == before


def test_a_network_that_is_no_working_ggcnn_is_refused(facts, tmp_path, empty_zoo):
    path = save_ggcnn(build_ggcnn("shallow", input_size=20, seed=0), tmp_path / "nan.hdf5")
    with h5py.File(path, "r+") as file:
        weights = file["model_weights/conv2d_1"]
        weights[weights.attrs["weight_names"][0]][0, 0, 0, 0] = float("nan")
    with pytest.raises(ModelFileError, match="finite"):
        zoo.add(path, {**facts, "model_sha256": sha256_of(path)}, "mine")
    assert list(empty_zoo.iterdir()) == []


@pytest.mark.parametrize("name", ["", "Mine", "a-b", "../mine", "a.b", "a,b", "zoo:mine"])
def test_names(name, trained, facts, empty_zoo):
    with pytest.raises(ModelFileError, match="lower case"):
        zoo.add(trained, facts, name)
