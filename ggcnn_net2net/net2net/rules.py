"""What surgery has to know of each Keras layer class: how channels pass it, and which axes of its weights they are.

A class that is not in `RULES` is left alone, and stops surgery on the channels that reach it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import keras

Shape = tuple[int | None, ...]
Tie = tuple[int, np.ndarray, np.ndarray]
"""Number of an input, channels of this input, and the output channels that they become."""


def _no_ties(_layer: Any, _inputs: Sequence[Shape], _output: Shape) -> list[Tie]:
    return []


def _same_channels(_layer: Any, inputs: Sequence[Shape], output: Shape) -> list[Tie]:
    channels = np.arange(output[-1] or 0)
    return [(number, channels, channels) for number in range(len(inputs))]


def _concatenated(layer: Any, inputs: Sequence[Shape], output: Shape) -> list[Tie]:
    if layer.axis not in (-1, len(output) - 1):
        return _same_channels(layer, inputs, output)
    widths = [shape[-1] or 0 for shape in inputs]
    starts = np.cumsum([0, *widths])
    return [(number, np.arange(width), starts[number] + np.arange(width)) for number, width in enumerate(widths)]


def _flattened(_layer: Any, inputs: Sequence[Shape], output: Shape) -> list[Tie]:
    flat = np.arange(output[-1] or 0)
    return [(0, flat % (inputs[0][-1] or 1), flat)]


@dataclass(frozen=True)
class Rule:
    """How layers of one class treat channels, by which is meant the last axis of their tensors."""

    ties: Callable[[Any, Sequence[Shape], Shape], list[Tie]] = _same_channels
    """Which output channels are made of one channel of an input alone. None are in a convolution."""

    sums: Mapping[str, int] = field(default_factory=dict)
    """Weight name -> its axis of input channels, over which the layer sums."""

    owns: Mapping[str, int] = field(default_factory=dict)
    """Weight name -> its axis of output channels."""

    width: str | None = None
    """Config entry with the number of output channels, for layers that can be made wider and deeper."""


ACTIVATION_LAYERS = ("Activation", "ELU", "LeakyReLU", "PReLU", "ReLU")
_MERGING = ("Add", "Average", "Maximum", "Minimum", "Multiply", "Subtract")
_REGULARIZING = (
    "ActivityRegularization",
    "Dropout",
    "GaussianDropout",
    "GaussianNoise",
    "Identity",
    "SpatialDropout2D",
)
_RESAMPLING = (
    "AveragePooling2D",
    "Cropping2D",
    "GlobalAveragePooling2D",
    "GlobalMaxPooling2D",
    "MaxPooling2D",
    "UpSampling2D",
    "ZeroPadding2D",
)

RULES: dict[str, Rule] = {
    **dict.fromkeys((*ACTIVATION_LAYERS, *_MERGING, *_REGULARIZING, *_RESAMPLING), Rule()),
    "PReLU": Rule(owns={"alpha": -1}),
    "BatchNormalization": Rule(
        owns=dict.fromkeys(("gamma", "beta", "moving_mean", "moving_variance"), -1),
    ),
    "Concatenate": Rule(_concatenated),
    "Flatten": Rule(_flattened),
    "Conv2D": Rule(_no_ties, sums={"kernel": -2}, owns={"kernel": -1, "bias": -1}, width="filters"),
    "Conv2DTranspose": Rule(_no_ties, sums={"kernel": -1}, owns={"kernel": -2, "bias": -1}, width="filters"),
    "Dense": Rule(_no_ties, sums={"kernel": -2}, owns={"kernel": -1, "bias": -1}, width="units"),
}

_ACROSS_CHANNELS = {"glu", "log_softmax", "softmax", "sparsemax"}
_IDEMPOTENT = {"hard_tanh", "relu", "relu6"}


def is_expandable(layer: keras.Operation) -> bool:
    """Whether `layer` is of a class that *deeper* and *wider* are for: Conv2D, Conv2DTranspose or Dense."""
    rule = RULES.get(type(layer).__name__)
    return rule is not None and rule.width is not None


def refusal(layer: keras.Operation, inputs: Sequence[Shape], output: Shape) -> str | None:
    """Why the channels that `layer` takes or makes cannot be operated on; None where they can.

    Args:
        layer: a layer, or a Keras operation such as `a + b` on tensors.
        inputs: shapes of its inputs, batch dimension first.
        output: shape of its output.
    """
    import keras  # importing the package must not import TensorFlow

    kind = type(layer).__name__
    if kind == "InputLayer":
        return "it is an input of the model"
    if kind not in RULES or type(layer) is not getattr(keras.layers, kind):
        return f"its class {type(layer).__module__}.{kind} is not supported"
    last = len(output) - 1
    widths = {shape[-1] for shape in inputs}
    checks = {
        "it is channels_first": getattr(layer, "data_format", "channels_last") != "channels_last",
        "it is a grouped convolution": getattr(layer, "groups", 1) != 1,
        "it normalizes another axis than the last": kind == "BatchNormalization" and layer.axis not in (-1, last),
        "it shares slopes among channels": kind == "PReLU" and last in (layer.shared_axes or ()),
        "it broadcasts one channel to several": kind != "Concatenate" and len(widths) > 1,
        "its number of channels is not known": None in {*widths, output[-1]},
    }
    return next((reason for reason, holds in checks.items() if holds), None)


def activation_refusal(layer: keras.Operation) -> str | None:
    """Why the activation of `layer` forbids copying channels, as softmax does; None where it does not."""
    import keras

    activation = getattr(layer, "activation", None)
    name = _activation_name(layer)
    if type(activation) in (type(None), keras.layers.ELU, keras.layers.LeakyReLU, keras.layers.ReLU):
        return None
    if name not in _ACROSS_CHANNELS and getattr(keras.activations, name, None) is activation:
        return None
    return f"its activation {name} is not known to act on each channel by itself"


def is_linear(layer: keras.Operation) -> bool:
    """Whether `layer` has no activation of its own."""
    return _activation_name(layer) in ("NoneType", "linear")


def idempotence_refusal(layer: keras.Operation) -> str | None:
    """Why applying the activation of `layer` (or `layer` itself) twice is not the same as once; None if it is."""
    import keras

    activation = getattr(layer, "activation", None)
    if isinstance(activation, keras.layers.Layer):
        return idempotence_refusal(activation)
    kind = type(layer).__name__
    if kind in ("ELU", "LeakyReLU", "PReLU") or (kind == "ReLU" and layer.negative_slope):
        return f"{kind} applied twice is not the same as once"
    if is_linear(layer) or _activation_name(layer) in _IDEMPOTENT:
        return None
    return f"its activation {_activation_name(layer)} applied twice is not the same as once"


def _activation_name(layer: keras.Operation) -> str:
    activation = getattr(layer, "activation", None)
    return getattr(activation, "__name__", type(activation).__name__)
