"""Which networks the names of a table's rows mean."""

import json

import pytest

from ggcnn_net2net import reference_data, zoo
from ggcnn_net2net.architecture import SHALLOW, build_ggcnn
from ggcnn_net2net.errors import DataNotFoundError, ModelFileError, ResultsError, VerificationError
from ggcnn_net2net.model_files import published, save_ggcnn
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.reproduce.networks import default_rows, load_networks
from ggcnn_net2net.reproduce.paper import TABLE1
from ggcnn_net2net.zoo import files


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A zoo that is empty."""
    folder = tmp_path / "zoo"
    folder.mkdir()
    monkeypatch.setattr(files, "FOLDER", folder)
    return folder


@pytest.fixture
def put(folder):
    """Function: put untrained networks into the zoo."""

    def put(*names, size=300):
        for name in names:
            path = save_ggcnn(build_ggcnn("shallow", input_size=size, seed=0), folder / f"{name}.hdf5")
            path.with_suffix(".json").write_text(json.dumps({"model_sha256": sha256_of(path)}))

    return put


@pytest.fixture
def nowhere(monkeypatch, tmp_path):
    """The published file is nowhere, and there is no network."""
    monkeypatch.delenv("GGCNN_NET2NET_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(reference_data, "checkout_root", lambda: tmp_path / "checkout")
    monkeypatch.setattr(published, "PUBLISHED_URL", "http://127.0.0.1:9/epoch_29_model.hdf5")


def test_the_default_rows_are_those_of_the_paper_and_what_the_zoo_has(put):
    assert default_rows() == ["original", "extended", "optimized"]
    put("searched_small", "narrow", "control", zoo.STAND_IN)
    assert default_rows() == ["original", "control", "extended", "optimized", "searched_small"]
    put("extended", "searched_extended")
    assert default_rows() == [
        "original", "control", "extended", "optimized", "searched_extended", "searched_small",
    ]  # fmt: skip


def test_the_papers_rows_are_there_without_weights(put):
    put("control")
    extended, optimized = load_networks(["extended", "optimized"])
    assert (extended.parameters, optimized.parameters) == (67_644, 16_104)
    for network in (extended, optimized):
        assert (network.model, network.sha256, network.file) == (None, "", "")
        assert network.paper == TABLE1[network.name]
        assert network.note == "no trained model ships yet"


def test_rows_of_the_zoo(put):
    put("extended", "control", "narrow")
    extended, control, narrow = load_networks(["extended", "control", "zoo:narrow"])
    assert [network.name for network in (extended, control, narrow)] == ["extended", "control", "narrow"]
    assert [network.file for network in (extended, control, narrow)] == ["zoo:extended", "zoo:control", "zoo:narrow"]
    assert (extended.paper, control.paper, narrow.paper) == (TABLE1["extended"], None, None)
    for network in (extended, control, narrow):
        assert network.sha256 == zoo.provenance(network.name)["model_sha256"]
        assert (network.architecture, network.parameters) == (str(SHALLOW), SHALLOW.n_parameters)
        assert (network.note, network.stand_in) == ("", False)
    assert load_networks(["zoo:extended"])[0].paper == TABLE1["extended"]


@pytest.mark.parametrize("spec", ["control", "searched_small", "zoo:optimized", "zoo:"])
def test_a_row_that_the_zoo_lacks(spec, put):
    put("narrow")
    with pytest.raises(ModelFileError, match=r"\(narrow\)"):
        load_networks([spec])


def test_a_changed_file_of_the_zoo_is_refused(put, folder):
    put("extended")
    with (folder / "extended.hdf5").open("ab") as stream:
        stream.write(b"more")
    with pytest.raises(VerificationError):
        load_networks(["extended"])


@pytest.mark.parametrize("spec", ["original", "published"])
def test_the_stand_in_is_named_so(spec, put, nowhere):
    put(zoo.STAND_IN)
    with pytest.warns(zoo.StandInWarning):
        (network,) = load_networks([spec])
    assert network.name == "original (stand-in)"
    assert network.note == "stand-in, trained by this project; the published file was not found"
    assert (network.stand_in, network.file) == (True, "zoo:original_retrained")
    assert network.paper == TABLE1["original"]
    (itself,) = load_networks([f"zoo:{zoo.STAND_IN}"])  # who asks for it by name knows what it is
    assert (itself.name, itself.note, itself.paper) == ("original_retrained", "", None)


def test_without_a_stand_in_it_says_how_to_get_the_original(nowhere, put):
    put("extended")
    with pytest.raises(DataNotFoundError, match="curl"):
        load_networks(["original"])


def test_the_published_network_is_no_stand_in(put, data_root):
    put(zoo.STAND_IN)
    (network,) = load_networks(["original"])
    assert (network.name, network.sha256) == ("original", published.PUBLISHED_SHA256)
    assert (network.note, network.stand_in, network.file) == ("", False, "epoch_29_model.hdf5")


@pytest.mark.parametrize("spec", ["orignal", "narrow", "nowhere/mine.hdf5"])
def test_a_name_that_is_none_names_the_rows(spec):
    with pytest.raises(ResultsError, match=rf"original, control, extended, .* received '{spec}'"):
        load_networks([spec])


def test_networks_need_names_of_their_own(put):
    put("extended")
    with pytest.raises(ResultsError, match="different names"):
        load_networks(["extended", "zoo:extended"])
    with pytest.raises(ResultsError, match="none"):
        load_networks([])


def test_a_network_for_another_image_size_is_refused(put, tmp_path):
    path = save_ggcnn(build_ggcnn("shallow", input_size=120, seed=0), tmp_path / "small.hdf5")
    put("control", size=120)
    for spec in (str(path), "control"):
        with pytest.raises(ResultsError, match="120"):
            load_networks([spec])


def test_a_file_of_the_users_is_not_taken_for_the_papers(tmp_path):
    path = save_ggcnn(build_ggcnn("narrow", seed=0), tmp_path / "extended.hdf5")
    (network,) = load_networks([str(path)])
    assert (network.name, network.parameters, network.paper) == ("extended", 4_508, None)
