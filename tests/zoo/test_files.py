"""What the zoo hands out is what its provenance describes."""

import subprocess
import sys

import pytest

from ggcnn_net2net import zoo
from ggcnn_net2net.errors import ModelFileError, VerificationError
from ggcnn_net2net.model_files import load_ggcnn, model_summary
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.zoo import adding, files


@pytest.fixture
def mine(trained, facts, empty_zoo):
    return zoo.add(trained, facts, "mine")


def test_it_is_found_by_name(mine, trained, facts, empty_zoo):
    zoo.add(trained, facts, "again")
    (empty_zoo / ".mine.123.tmp.hdf5").write_bytes(b"")  # of an `add` that was killed
    assert zoo.names() == ("again", "mine")
    assert zoo.network_file("mine") == mine
    assert zoo.provenance("mine")["recipe"] == facts["recipe"]
    assert load_ggcnn("zoo:mine").count_params() == model_summary("zoo:mine").parameters == facts["parameters"]


@pytest.mark.parametrize("name", ["extended", "", "../mine", "mine.hdf5", "Mine"])
def test_an_unknown_name_is_told_what_there_is(name, mine):
    for function in (zoo.network_file, zoo.provenance):
        with pytest.raises(ModelFileError, match=r"\(mine\)"):
            function(name)


def test_an_empty_zoo_says_so(empty_zoo):
    assert zoo.names() == ()
    with pytest.raises(ModelFileError, match="which is empty"):
        load_ggcnn("zoo:extended")


def test_a_changed_file_is_refused(mine):
    content = bytearray(mine.read_bytes())
    content[-1] ^= 1
    mine.write_bytes(content)
    with pytest.raises(VerificationError, match=sha256_of(mine)):
        load_ggcnn("zoo:mine")


@pytest.mark.parametrize("content", [None, "", "{}", "[]", "{"])
def test_a_file_without_provenance_is_refused(content, mine):
    record = mine.with_suffix(".json")
    record.unlink()
    if content is not None:
        record.write_text(content)
    with pytest.raises(VerificationError, match=r"mine\.json"):
        load_ggcnn("zoo:mine")


def test_importing_it_is_light():
    code = "import sys, ggcnn_net2net.zoo as zoo; zoo.names(); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "ggcnn_net2net.zoo.files" in loaded
    assert not {"tensorflow", "keras", "h5py", "matplotlib", "pybullet"} & set(loaded)


def test_what_ships_is_small_works_and_is_on_record():
    for name in zoo.names():
        record = zoo.provenance(name)
        assert list(adding._problems(record)) == []
        assert zoo.network_file(name).stat().st_size <= zoo.MAX_BYTES
        model = load_ggcnn(f"zoo:{name}")
        assert model.count_params() == record["parameters"]
        assert model.input_shape == (None, 300, 300, 1)


def test_nothing_else_lies_in_the_folder():
    """No provenance without its network, and nothing that only one machine has."""
    assert sorted(path.stem for path in files.FOLDER.glob("*.json")) == list(zoo.names())
    for path in files.FOLDER.glob("*.json"):
        assert "/tmp/" not in path.read_text()
