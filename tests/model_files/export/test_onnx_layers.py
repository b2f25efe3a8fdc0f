"""ONNX operators against the Keras layers that they stand for, for sizes where padding is easily got wrong."""

from __future__ import annotations

import keras
import numpy as np
import onnxruntime
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from keras import layers
from numpy.testing import assert_allclose

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.model_files.export.onnx_file import write_onnx
from ggcnn_net2net.model_files.export.runtime import Job


def assert_equal_maps(inputs, tensor, path) -> None:
    """Put heads on a tensor of the input's size, write the network, and compare the maps of two images."""
    heads = [layers.Conv2D(1, 2, padding="same", name=name)(tensor) for name in HEADS]
    model = keras.Model(inputs, heads)
    rng = np.random.default_rng(0)
    model.set_weights([rng.uniform(0.1, 0.5, weight.shape) for weight in model.get_weights()])
    write_onnx(Job(model), path)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    assert [output.name for output in session.get_outputs()] == list(HEADS)
    images = rng.normal(size=(2, *inputs.shape[1:])).astype(np.float32)
    for ours, theirs in zip(session.run(None, {"depth": images}), model(images), strict=True):
        expected = np.asarray(theirs)
        assert_allclose(ours, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kernels=st.tuples(*[st.integers(1, 6)] * 4),
    strides=st.tuples(*[st.integers(1, 4)] * 2),
    blocks=st.tuples(*[st.integers(2, 4)] * 2),
    bias=st.booleans(),
)
def test_down_and_up_again(kernels, strides, blocks, bias, tmp_path):
    """Kernels larger and smaller than the stride, odd and even, not square."""
    inputs = keras.Input((blocks[0] * strides[0], blocks[1] * strides[1], 1))
    options = {"strides": strides, "padding": "same", "activation": "relu", "use_bias": bias}
    tensor = layers.Conv2D(3, kernels[:2], **options)(inputs)
    assert_equal_maps(inputs, layers.Conv2DTranspose(2, kernels[2:], **options)(tensor), tmp_path / "net.onnx")


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kernel=st.integers(1, 5), dilation=st.integers(1, 3), side=st.integers(6, 13))
def test_dilated_convolutions(kernel, dilation, side, tmp_path):
    inputs = keras.Input((side, side, 1))
    tensor = layers.Conv2D(2, kernel, padding="same", dilation_rate=dilation, activation="tanh")(inputs)
    assert_equal_maps(inputs, tensor, tmp_path / "net.onnx")


@pytest.mark.parametrize(
    "chain",
    [
        [layers.ZeroPadding2D(((1, 2), (3, 0))), layers.Conv2D(2, 4)],
        [layers.Conv2DTranspose(2, 5), layers.Cropping2D(((1, 3), (4, 0)))],
        [layers.Conv2DTranspose(2, 2, strides=3), layers.Conv2D(2, 7, strides=3, padding="same")],
        [layers.MaxPooling2D(3, strides=2, padding="same"), layers.UpSampling2D(2)],
        [layers.MaxPooling2D(2), layers.UpSampling2D(2, interpolation="bilinear")],
        [layers.Conv2D(4, 1), layers.Conv2D(4, 3, padding="same", groups=2), layers.LeakyReLU(0.3)],
        [layers.Conv2D(3, 1, activation="sigmoid"), layers.BatchNormalization(), layers.ReLU()],
        [layers.BatchNormalization(scale=False, center=False, epsilon=0.1), layers.Dropout(0.5)],
    ],
    ids=lambda chain: "-".join(layer.name for layer in chain),
)
def test_chains_of_layers(chain, tmp_path):
    inputs = tensor = keras.Input((12, 12, 1))
    for layer in chain:
        tensor = layer(tensor)
    assert_equal_maps(inputs, tensor, tmp_path / "net.onnx")


def test_branches(tmp_path):
    inputs = keras.Input((8, 8, 1))
    one, other = (layers.Conv2D(2, size, padding="same")(inputs) for size in (3, 4))
    total = layers.Add()([one, other, one])
    assert_equal_maps(inputs, layers.Concatenate()([total, other, inputs]), tmp_path / "net.onnx")
