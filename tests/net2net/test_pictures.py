"""The picture of surgery shows what the weights are."""

from __future__ import annotations

import cv2
import keras
import numpy as np
import pytest
from click.testing import CliRunner

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.cli.grow import grow_command
from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net.pictures import draw_surgery, kernel_panels


@pytest.fixture(scope="module")
def narrow():
    return gn.build_ggcnn("narrow", input_size=24, seed=0)


def test_a_panel_is_a_layer_from_its_inputs_to_its_filters(narrow):
    panels = kernel_panels(narrow)
    assert [panel.strength.shape for panel in panels] == [(1, 8), (8, 4), (4, 2), (2, 2), (2, 4), (4, 8), (8, 4)]
    transposed = narrow.get_layer("conv2d_transpose_2").kernel.numpy()  # (h, w, out, in)
    assert panels[4].strength[1, 3] == abs(transposed[..., 3, 1]).max()
    assert panels[-1].strength[5, 2] == abs(narrow.get_layer("sin_out").kernel.numpy()[..., 5, 0]).max()
    assert not any(panel.is_identity for panel in panels)
    assert all((panel.outputs == np.arange(len(panel.outputs))).all() for panel in panels)


@pytest.mark.parametrize(("layer", "index"), [(2, 2), (5, 5)])
def test_deeper_adds_an_identity(narrow, layer, index):
    panels = kernel_panels(gn.apply_operations(narrow, f"deeper({layer})"))
    assert [number for number, panel in enumerate(panels) if panel.is_identity] == [index]


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_wider_marks_the_copies_and_who_reads_them(narrow, noise):
    panels = kernel_panels(gn.apply_operations(narrow, "wider(6, filters=11)", noise=noise))
    widened, heads = panels[-2:]
    assert (widened.outputs[:8] == np.arange(8)).all()
    assert (widened.outputs[8:] < 8).all()
    assert (widened.strength[:, 8:] == widened.strength[:, widened.outputs[8:]]).all()
    assert (heads.inputs == widened.outputs).all()
    assert (heads.strength[8:] == heads.strength[heads.inputs[8:]]).all() == (noise == 0)


def test_new_layers_stand_below_nothing(narrow, tmp_path):
    draw_surgery(tmp_path / "same.png", narrow, narrow, "nothing")
    draw_surgery(tmp_path / "grown.png", narrow, gn.apply_operations(narrow, "deeper(2)"), "deeper(2)")
    same, grown = (cv2.imread(str(tmp_path / name)) for name in ("same.png", "grown.png"))
    assert grown.shape[1] > same.shape[1]
    upper = grown[100 : grown.shape[0] // 2]
    empty = (upper == 255).all(axis=(0, 2))
    widest = max(map(len, "".join("_" if blank else " " for blank in empty).split()))
    assert widest > grown.shape[1] / 8  # the column of the new layer


def test_grow_draws(tmp_path):
    arguments = ["zoo:narrow", "--ops", "deeper(2), wider(3)", "-o", tmp_path / "a.hdf5", "--draw", tmp_path / "a.png"]
    result = CliRunner().invoke(grow_command, [str(argument) for argument in arguments], standalone_mode=False)
    assert result.exception is None
    assert cv2.imread(str(tmp_path / "a.png")).shape[1] > 1200


def test_what_cannot_be_drawn_is_refused_before_anything_is_written(tmp_path):
    inputs = keras.Input((8, 8, 1))
    branches = [keras.layers.Conv2D(width, 3, padding="same")(inputs) for width in (2, 2, 2, 3)]

    def heads_on(features):
        heads = [keras.layers.Conv2D(1, 2, padding="same", name=name) for name in HEADS]
        return keras.Model(inputs, [head(below) for head, below in zip(heads, features, strict=True)])

    model = heads_on(branches)
    with pytest.raises(SurgeryError, match="heads of several"):
        kernel_panels(model)
    gn.save_ggcnn(model, tmp_path / "branches.hdf5")
    arguments = [tmp_path / "branches.hdf5", "--ops", f"wider({model.layers[1].name})", "-o", tmp_path / "a.hdf5"]
    arguments += ["--draw", tmp_path / "a.png"]
    result = CliRunner().invoke(grow_command, [str(argument) for argument in arguments], standalone_mode=False)
    assert isinstance(result.exception, SurgeryError)
    assert [path.name for path in tmp_path.iterdir()] == ["branches.hdf5"]
    dense = keras.layers.Dense(3)(keras.layers.Conv2D(2, 3, padding="same")(inputs))
    with pytest.raises(SurgeryError, match="of class Dense"):
        kernel_panels(heads_on([dense] * 4))
