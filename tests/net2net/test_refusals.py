"""What operations refuse, and that the message names the layer and the reason."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import keras
import pytest
from surgery_models import L

from ggcnn_net2net.errors import GGCNNError, SurgeryError
from ggcnn_net2net.net2net import apply_operations, deeper, operations, wider


class Custom(L.Layer):
    """A layer that this package does not know."""

    def call(self, inputs: Any) -> Any:
        return inputs[..., ::-1]


def _model(*layers: Callable[[Any], Any], first: dict[str, Any] | None = None) -> keras.Model:
    inputs = keras.Input((8, 8, 4), name="depth")
    x = L.Conv2D(
        **{"filters": 4, "kernel_size": 3, "padding": "same", "activation": "relu", "name": "it", **(first or {})}
    )(inputs)
    for layer in layers:
        x = layer(x)
    return keras.Model(inputs, L.Conv2D(1, 1, name="head")(x))


def _two(x: Any) -> Any:
    shared = L.ReLU(name="shared")
    return L.Add()([shared(x), shared(L.Conv2D(4, 1)(x))])


def _nested(x: Any) -> Any:
    inputs = keras.Input(x.shape[1:])
    return keras.Model(inputs, L.Conv2D(4, 1)(inputs), name="inner")(x)


@pytest.mark.parametrize("operation", [deeper, wider])
@pytest.mark.parametrize(
    ("layer", "name", "reason"),
    [
        (_two, "shared", "called 2 times"),
        (_nested, "inner", "nested model"),
        (L.Lambda(lambda x: x, name="code"), "code", "Lambda"),
    ],
)
def test_models_that_cannot_be_edited(operation: Any, layer: Any, name: str, reason: str) -> None:
    with pytest.raises(SurgeryError, match=rf"'{name}'.*{reason}"):
        operation(_model(layer), 1)


def test_a_model_that_is_not_functional() -> None:
    model = keras.Sequential([keras.Input((8, 8, 1)), L.Conv2D(2, 3, name="it"), L.Conv2D(1, 1)])
    with pytest.raises(SurgeryError, match=r"functional.*keras\.Model\(model\.inputs, model\.outputs\)"):
        deeper(model, 1)
    assert wider(keras.Model(model.inputs, model.outputs), 1).get_layer("it").filters == 4


@pytest.mark.parametrize("operation", [deeper, wider])
@pytest.mark.parametrize("layer", [0, 2, -1, "nowhere", "head", "depth", "relu"])
def test_layers_that_cannot_be_chosen(operation: Any, layer: int | str) -> None:
    with pytest.raises(SurgeryError, match=rf"expandable layers \(1 it\), received {layer!r}, which"):
        operation(_model(L.ReLU(name="relu")), layer)


@pytest.mark.parametrize(
    ("layer", "reason"),
    [
        (L.DepthwiseConv2D(3, name="obstacle"), "DepthwiseConv2D is not supported"),
        (L.SeparableConv2D(4, 3, name="obstacle"), "SeparableConv2D is not supported"),
        (L.Conv2D(4, 3, groups=2, name="obstacle"), "grouped"),
        (L.LayerNormalization(name="obstacle"), "LayerNormalization is not supported"),
        (L.BatchNormalization(axis=1, name="obstacle"), "another axis"),
        (L.PReLU(shared_axes=(1, 2, 3), name="obstacle"), "slopes"),
        (L.Activation("softmax", name="obstacle"), "softmax"),
        (L.Reshape((16, 4, 4), name="obstacle"), "Reshape is not supported"),
        (Custom(name="obstacle"), "Custom is not supported"),
        (lambda x: L.Multiply(name="obstacle")([x, L.Conv2D(1, 1)(x)]), "broadcasts"),
        (lambda x: L.Add(name="obstacle")([x, L.MaxPooling2D(1)(x._keras_history.operation.input)]), "'depth'.*input"),
    ],
)
def test_wider_stops_at_layers_it_does_not_know(layer: Any, reason: str) -> None:
    model = _model(layer)
    with pytest.raises(SurgeryError, match=r"cannot widen layer 'it': layer .* stands in the way, because") as error:
        wider(model, 1)
    assert re.search(reason, str(error.value)), error.value
    assert "wider(1)" not in map(str, operations(model))
    assert "deeper(1)" in map(str, operations(model))
    assert deeper(model, 1).get_layer("it_deeper")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"activation": "tanh"}, "tanh applied twice"),
        ({"activation": "elu"}, "elu applied twice"),
        ({"activation": "softmax"}, "softmax applied twice"),
        ({"activation": L.LeakyReLU(0.1)}, "LeakyReLU applied twice"),
        ({"groups": 2}, "grouped"),
    ],
)
def test_deeper_stops_where_no_identity_can_follow(change: dict[str, Any], reason: str) -> None:
    model = _model(first=change)
    with pytest.raises(SurgeryError, match=f"cannot add a layer behind 'it': layer 'it' .*{reason}"):
        deeper(model, 1)
    assert "deeper(1)" not in map(str, operations(model))


@pytest.mark.parametrize("activation", [L.LeakyReLU, L.PReLU, L.ELU, lambda name: L.Activation("sigmoid", name=name)])
def test_deeper_stops_at_an_activation_layer_without_identity(activation: Any) -> None:
    model = _model(L.BatchNormalization(), activation(name="curve"), first={"activation": None})
    with pytest.raises(SurgeryError, match=r"layer 'curve' stands in the way"):
        deeper(model, 1)
    assert wider(model, 1).get_layer("it").filters == 8


@pytest.mark.parametrize("activation", ["softmax", "tanh", "relu"])
def test_a_head_with_a_separate_activation_is_an_output(activation: str) -> None:
    inputs = keras.Input((8, 8, 1))
    head = L.Conv2D(3, 1, name="head")(L.Conv2D(4, 3, name="it")(inputs))
    model = keras.Model(inputs, L.Activation(activation)(head))
    assert [str(operation) for operation in operations(model)] == ["deeper(1)", "wider(1)"]
    for operation in (deeper, wider):
        with pytest.raises(SurgeryError, match="'head', which is an output"):
            operation(model, "head")


def test_softmax_and_grouped_layers_cannot_be_widened() -> None:
    for change in ({"activation": "softmax"}, {"groups": 2}):
        with pytest.raises(SurgeryError, match="layer 'it' stands in the way"):
            wider(_model(first=change), 1)


@pytest.mark.parametrize(
    ("options", "received"),
    [
        ({"factor": 1}, "factor=1"),
        ({"factor": 0.5}, "factor=0.5"),
        ({"factor": float("nan")}, "factor=nan"),
        ({"factor": float("inf")}, "factor=inf"),
        ({"factor": 1e308}, r"factor=1e\+308"),
        ({"filters": 4}, "filters=4"),
        ({"filters": 2}, "filters=2"),
        ({"noise": -0.1}, "noise=-0.1"),
        ({"noise": float("nan")}, "noise=nan"),
    ],
)
def test_wider_wants_more_filters(options: dict[str, Any], received: str) -> None:
    with pytest.raises(SurgeryError, match=f"received {received}"):
        wider(_model(), 1, **options)


def test_channels_that_are_added_to_each_other() -> None:
    def fold(x: Any) -> Any:
        return L.Add()([L.Concatenate()([x, x]), L.Conv2D(8, 1, name="folded")(x)])

    model = _model(fold)
    assert wider(model, "it").get_layer("folded").filters == 16
    with pytest.raises(SurgeryError, match="'folded': a layer behind it combines"):
        wider(model, "folded")


@pytest.mark.parametrize("kernel_size", [0, -3, (3, 0), (3, 3, 3), 2.5])
def test_kernel_sizes_are_positive(kernel_size: Any) -> None:
    with pytest.raises(SurgeryError, match="one or two positive integers"):
        deeper(_model(), 1, kernel_size=kernel_size)


def test_a_dense_layer_has_no_kernel_size() -> None:
    with pytest.raises(SurgeryError, match="Dense"):
        deeper(_model(L.Dense(3, activation="relu", name="dense")), "dense", kernel_size=3)


def test_the_failing_operation_of_a_sequence_is_named() -> None:
    with pytest.raises(GGCNNError, match=r"operation 2 of 3, wider\(7\): expected one of the expandable layers"):
        apply_operations(_model(), "deeper(1), wider(7), deeper(1)")
