"""*deeper*: what the new layer is, where it goes, and that it is the identity there."""

from __future__ import annotations

from typing import Any

import keras
import numpy as np
import pytest
from surgery_models import L, expected_parameters, max_difference, outputs, randomize, relative_difference

from ggcnn_net2net.net2net import deeper, wider


def _model(*layers: keras.layers.Layer, size: int = 12) -> keras.Model:
    inputs = x = keras.Input((size, size, 2), dtype="float64")
    for layer in layers:
        x = layer(x)
    model = keras.Model(inputs, [L.Conv2D(1, 2, padding="same", dtype="float64", name=name)(x) for name in "ab"])
    randomize(model, 0)
    return model


def _image(model: keras.Model) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(2, *model.input_shape[1:]))


@pytest.mark.parametrize("kind", [L.Conv2D, L.Conv2DTranspose])
@pytest.mark.parametrize("kernel_size", [(1, 1), (2, 2), (3, 4), (5, 2), (8, 8), (9, 9)])
@pytest.mark.parametrize("options", [{"padding": "same"}, {"padding": "valid"}, {"padding": "same", "strides": 3}])
def test_the_new_layer_is_the_identity(kind: Any, kernel_size: tuple[int, int], options: dict[str, Any]) -> None:
    model = _model(kind(3, kernel_size, activation="relu", dtype="float64", name="it", **options))
    child = deeper(model, "it")
    assert max_difference(model, child, _image(model)) == 0
    added = child.get_layer("it_deeper")
    assert type(added) is kind
    assert (added.filters, added.kernel_size, added.activation.__name__) == (3, kernel_size, "relu")
    assert (added.strides, added.padding, added.use_bias) == ((1, 1), "same", True)
    assert child.count_params() == expected_parameters(child)


@pytest.mark.parametrize(
    "layer",
    [
        L.Conv2D(3, 4, dilation_rate=3, padding="same", activation="relu", use_bias=False, dtype="float64", name="it"),
        L.Conv2DTranspose(3, 4, strides=2, output_padding=1, dtype="float64", name="it"),
        L.Conv2DTranspose(3, 3, strides=3, output_padding=1, padding="same", dtype="float64", name="it"),
        L.Conv2D(3, 3, activation=L.ReLU(max_value=1.5, dtype="float64"), dtype="float64", name="it"),
        L.Dense(3, activation="relu", dtype="float64", name="it"),
    ],
    ids=["dilated", "output padding", "output padding same", "activation layer", "dense"],
)
def test_layers_of_all_kinds(layer: keras.layers.Layer) -> None:
    model = _model(layer)
    for child in (deeper(model, 1), deeper(deeper(model, 1), 2), wider(deeper(model, 1), 2)):
        assert relative_difference(model, child, _image(model)) < 1e-14


def test_a_kernel_size_of_ones_own() -> None:
    model = _model(L.Conv2D(3, 3, activation="relu", dtype="float64", name="it"))
    child = deeper(deeper(model, 1, kernel_size=4), 1, kernel_size=(1, 6))
    assert child.get_layer("it_deeper").kernel_size == (4, 4)
    assert child.get_layer("it_deeper_2").kernel_size == (1, 6)
    assert max_difference(model, child, _image(model)) == 0


@pytest.mark.parametrize("options", [{}, {"scale": False}, {"center": False, "epsilon": 0.1}])
@pytest.mark.parametrize("activation", [L.ReLU, lambda **kw: L.Activation("relu", **kw), None])
def test_a_block_with_normalization_is_repeated_whole(options: dict[str, Any], activation: Any) -> None:
    layers = [
        L.Conv2D(3, 3, dtype="float64", name="it"),
        L.BatchNormalization(dtype="float64", name="norm", **options),
        *([activation(dtype="float64", name="relu")] if activation else []),
    ]
    model = _model(*layers)
    child = deeper(model, 1)
    added = [layer.name for layer in child.layers if layer.name.endswith("_deeper")]
    assert added == [layer.name + "_deeper" for layer in layers]
    assert [layer.name for layer in child.layers].index("it_deeper") == len(layers) + 1
    assert relative_difference(model, child, _image(model)) < 1e-14


def test_a_linear_layer_before_a_skip_gets_a_linear_one() -> None:
    inputs = keras.Input((8, 8, 2))
    x = L.Conv2D(2, 3, padding="same", name="it")(inputs)
    model = keras.Model(inputs, L.Conv2D(1, 1, name="head")(L.ReLU()(L.Add()([x, inputs]))))
    child = deeper(model, 1)
    assert child.get_layer("it_deeper").activation.__name__ == "linear"
    assert max_difference(model, child, _image(model).astype("float32")) == 0


def test_a_layer_right_before_an_output_is_not_lost() -> None:
    inputs = keras.Input((8, 8, 2))
    x = L.Conv2D(2, 3, padding="same", name="it")(inputs)
    model = keras.Model(inputs, L.BatchNormalization(axis=1, name="out")(x))
    child = deeper(model, 1)
    assert [layer.name for layer in child.layers[1:]] == ["it", "it_deeper", "out"]


def test_all_consumers_are_rewired() -> None:
    model = _model(L.Conv2D(3, 3, activation="relu", dtype="float64", name="it"))
    child = deeper(model, 1)
    added = child.get_layer("it_deeper")
    added.set_weights([np.zeros_like(weight) for weight in added.get_weights()])
    biases = [child.get_layer(name).get_weights()[1] for name in "ab"]
    for output, bias in zip(outputs(child, _image(model)), biases, strict=True):
        np.testing.assert_array_equal(output, np.broadcast_to(bias, output.shape))


def test_behind_a_frozen_layer_the_new_one_learns() -> None:
    model = _model(L.Conv2D(3, 3, activation="relu", dtype="float64", name="it"))
    model.get_layer("it").trainable = False
    child = deeper(model, 1)
    assert not child.get_layer("it").trainable
    assert child.get_layer("it_deeper").trainable


def test_settings_of_layers_and_model_are_kept() -> None:
    model = _model(
        L.Conv2D(3, 3, activation="relu", kernel_regularizer=keras.regularizers.L2(0.1), dtype="float64", name="one"),
        L.Conv2D(3, 3, activation="relu", dtype="float64", name="two"),
    )
    model.get_layer("one").trainable = False
    for child in (deeper(model, "two"), wider(model, "one")):
        assert child.name == model.name
        assert not child.get_layer("one").trainable
        assert child.get_layer("two").trainable
        assert child.get_layer("one").kernel_regularizer.l2 == pytest.approx(0.1)
        assert child.output_names == model.output_names == ["a", "b"]
        assert {weight.dtype for weight in child.weights} == {"float64"}
    model.trainable = False
    assert deeper(model, "two").trainable_weights == []
