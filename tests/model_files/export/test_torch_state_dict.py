"""State_dicts written without PyTorch: read back the same, refused where class GGCNN would compute something else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS, build_ggcnn
from ggcnn_net2net.errors import ExportError
from ggcnn_net2net.model_files.export.torch_state_dict import write_state_dict
from ggcnn_net2net.model_files.torch_ggcnn import build_torch_ggcnn
from ggcnn_net2net.model_files.torch_tensors import read_state_dict

TORCH_FILE = "original_ggcnn_weights/pytorch/ggcnn_epoch_23_cornell_statedict.pt"


@pytest.fixture
def torch_network():
    """The PyTorch GG-CNN for images of 60 pixels with random weights, biases included."""
    model = build_torch_ggcnn(60)
    rng = np.random.default_rng(0)
    model.set_weights([weight + rng.normal(0, 0.05, weight.shape) for weight in model.get_weights()])
    return model


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    shapes=st.dictionaries(
        st.text(st.characters(exclude_categories=["Cs"]), min_size=1),
        st.lists(st.integers(1, 4), max_size=4),
        max_size=5,
    )
)
def test_tensors_come_back(shapes, tmp_path):
    rng = np.random.default_rng(0)
    tensors = {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    write_state_dict(tensors, tmp_path / "net.pt")
    read = read_state_dict(tmp_path / "net.pt")
    assert list(read) == list(tensors)
    for name, tensor in tensors.items():
        assert_array_equal(read[name], tensor, strict=True)


def test_a_network_with_pytorchs_padding_goes_there_and_back(torch_network, depth, tmp_path):
    path = gn.export(torch_network, tmp_path / "net.pt", samples=depth())
    again = gn.load_ggcnn(path)
    for ours, theirs in zip(again.get_weights(), torch_network.get_weights(), strict=True):
        assert_array_equal(ours, theirs)
    second = gn.export(torch_network, tmp_path / "again" / "net.pt", samples=depth())
    assert second.read_bytes() == path.read_bytes()


def test_the_published_state_dict_goes_there_and_back(data_root, depth, tmp_path):
    path = gn.export(data_root / TORCH_FILE, tmp_path / "net.pt", samples=depth(1, 300))
    ours, theirs = read_state_dict(path), read_state_dict(data_root / TORCH_FILE)
    assert list(ours) == list(theirs)
    for name, tensor in theirs.items():
        assert_array_equal(ours[name], tensor)


def test_order_of_the_layers_in_the_model_does_not_matter(torch_network, depth, tmp_path):
    """Heads go by their names."""
    model = gn.load_ggcnn(gn.save_ggcnn(torch_network, tmp_path / "net.hdf5"))
    state = read_state_dict(gn.export(model, tmp_path / "net.pt", samples=depth()))
    for name in HEADS:
        bias = torch_network.get_layer(name).get_weights()[1]
        assert_array_equal(state[f"{name.replace('_out', '_output')}.bias"], bias)


@pytest.mark.parametrize("architecture", ["original", "extended", "narrow"])
def test_keras_padding_is_refused(architecture, depth, tmp_path):
    with pytest.raises(ExportError, match="one pixel more above"):
        gn.export(build_ggcnn(architecture, 60, seed=0), tmp_path / "net.pt", samples=depth())
    assert list(tmp_path.iterdir()) == []


def test_grown_networks_are_refused(torch_network, depth, tmp_path):
    grown = gn.wider(torch_network, 3)
    with pytest.raises(ExportError, match="filters=16"):
        gn.export(grown, tmp_path / "net.pt", samples=depth())
