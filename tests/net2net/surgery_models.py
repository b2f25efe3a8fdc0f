"""Models to operate on, and what has to hold of every operation."""

from __future__ import annotations

import json
from typing import Any

import keras
import numpy as np
from hypothesis import strategies as st

L = keras.layers


def with_dtype(model: keras.Model, dtype: str) -> keras.Model:
    """The same model with all weights and activations of `dtype`."""
    config = model.get_config()
    for layer in config["layers"]:
        layer["config"]["dtype"] = dtype
        layer.pop("build_config", None)
    cast = keras.Model.from_config(config)
    cast.set_weights([weight.astype(dtype) for weight in model.get_weights()])
    return cast


def outputs(model: keras.Model, x: np.ndarray) -> list[np.ndarray]:
    result = model(x, training=False)
    return [np.asarray(output) for output in (result if isinstance(result, list) else [result])]


def max_difference(one: keras.Model, other: keras.Model, x: np.ndarray) -> float:
    pairs = zip(outputs(one, x), outputs(other, x), strict=True)
    return max(float(np.abs(a - b).max()) for a, b in pairs)


def relative_difference(one: keras.Model, other: keras.Model, x: np.ndarray) -> float:
    scale = max(float(np.abs(output).max()) for output in outputs(one, x))
    return max_difference(one, other, x) / max(scale, 1e-3)


def state(model: keras.Model) -> tuple[str, list[bytes], list[Any]]:
    """All that an operation on `model` must leave alone."""
    weights = [weight.tobytes() for weight in model.get_weights()]
    return json.dumps(model.get_config(), default=str), weights, list(getattr(model, "net2net_history", []))


def expected_parameters(model: keras.Model) -> int:
    """Parameter count by formula, from the channels that flow in and out of each layer."""
    total = 0
    for layer in model.layers:
        made = layer.output.shape[-1]
        taken = layer.input.shape[-1] if not isinstance(layer.input, list) else 0
        if isinstance(layer, L.Conv2D | L.Conv2DTranspose):
            total += layer.kernel_size[0] * layer.kernel_size[1] * taken * made + layer.use_bias * made
        elif isinstance(layer, L.Dense):
            total += taken * made + layer.use_bias * made
        elif isinstance(layer, L.BatchNormalization):
            total += (2 + layer.scale + layer.center) * made
        elif isinstance(layer, L.PReLU):
            total += made if layer.shared_axes else int(np.prod(layer.output.shape[1:]))
    return total


def randomize(model: keras.Model, seed: int) -> None:
    """Weights that hide no mistake: no zero biases, no trivial BatchNormalization statistics."""
    rng = np.random.default_rng(seed)
    for weight in model.weights:
        values = rng.normal(size=weight.shape) / np.sqrt(max(1, np.prod(weight.shape[:-1])))
        if weight.name in ("moving_variance", "gamma"):
            values = rng.uniform(0.5, 1.5, size=weight.shape)
        weight.assign(values)


@st.composite
def models(draw: st.DrawFn, dtype: str = "float64") -> keras.Model:
    """Random small functional models: 1-8 blocks with skips, 1-5 heads."""
    keras.backend.clear_session(free_memory=False)
    inputs = keras.Input((draw(st.integers(7, 12)), draw(st.integers(7, 12)), draw(st.integers(1, 2))), dtype=dtype)
    tensors = [_convolution(draw, inputs, dtype)]
    for _ in range(draw(st.integers(0, 7))):
        block = draw(st.sampled_from([_convolution, _convolution, _pass_through, _normalized, _skip, _concatenation]))
        tensors.append(block(draw, tensors[-1], dtype, tensors))
    heads = [_head(draw, tensors[-1], dtype) for _ in range(draw(st.integers(1, 5)))]
    model = keras.Model(inputs, heads)
    randomize(model, draw(st.integers(0, 99)))
    return model


def _convolution(draw: st.DrawFn, x: Any, dtype: str, *_: Any, activation: str | None = "relu") -> Any:
    sides = x.shape[1:3]
    options: dict[str, Any] = {
        "kernel_size": (draw(st.integers(1, 9)), draw(st.integers(1, 9))),
        "filters": draw(st.integers(1, 4)),
        "use_bias": draw(st.booleans()),
        "activation": activation and draw(st.sampled_from(["relu", "relu", None])),
        "padding": draw(st.sampled_from(["same", "same", "valid"])),
        "dtype": dtype,
    }
    up = draw(st.booleans())
    stride = draw(st.integers(1, 3 if not up or max(sides) <= 12 else 1))
    if not up:
        if min(side - size for side, size in zip(sides, options["kernel_size"], strict=True)) < 0:
            options["padding"] = "same"
        dilation = draw(st.integers(1, 3)) if stride == 1 and options["padding"] == "same" else 1
        return L.Conv2D(strides=stride, dilation_rate=dilation, **options)(x)
    if max(sides) > 20:
        options["padding"] = "same"
    odd = [size % 2 for size in options["kernel_size"]]
    if options["padding"] == "valid":
        options["output_padding"] = draw(st.sampled_from([None, stride - 1]))
    elif stride > 1:
        options["output_padding"] = draw(st.sampled_from([None, tuple(1 - side for side in odd)]))
    return L.Conv2DTranspose(strides=stride, **options)(x)


def _pass_through(draw: st.DrawFn, x: Any, dtype: str, *_: Any) -> Any:
    small, large = min(x.shape[1:3]), max(x.shape[1:3])
    choices = {
        "relu": L.ReLU(dtype=dtype),
        "leaky": L.LeakyReLU(0.2, dtype=dtype),
        "prelu": L.PReLU(shared_axes=draw(st.sampled_from([None, (1, 2)])), dtype=dtype),
        "tanh": L.Activation("tanh", dtype=dtype),
        "dropout": L.Dropout(0.5, dtype=dtype),
        "pad": L.ZeroPadding2D(((1, 0), (0, 2)), dtype=dtype),
    }
    if small >= 3:
        choices["max"] = L.MaxPooling2D(draw(st.integers(1, 3)), dtype=dtype)
        choices["average"] = L.AveragePooling2D(2, strides=1, padding="same", dtype=dtype)
        choices["crop"] = L.Cropping2D(((1, 0), (0, 1)), dtype=dtype)
    if large <= 12:
        choices["up"] = L.UpSampling2D(2, interpolation=draw(st.sampled_from(["nearest", "bilinear"])), dtype=dtype)
    return choices[draw(st.sampled_from(sorted(choices)))](x)


def _normalized(draw: st.DrawFn, x: Any, dtype: str, *_: Any) -> Any:
    x = _convolution(draw, x, dtype, activation=None)
    x = L.BatchNormalization(scale=draw(st.booleans()), center=draw(st.booleans()), epsilon=0.01, dtype=dtype)(x)
    return L.ReLU(dtype=dtype)(x) if draw(st.booleans()) else x


def _skip(draw: st.DrawFn, x: Any, dtype: str, tensors: list[Any]) -> Any:
    """Add, or another merge, of `x` with earlier tensors of its shape and with a convolution of `x`."""
    earlier = [tensor for tensor in tensors[:-1] if tensor.shape == x.shape][-2:]
    kernel = draw(st.integers(1, 4))
    branch = L.Conv2D(x.shape[-1], kernel, padding="same", activation="relu", dtype=dtype)(x)
    merge = draw(st.sampled_from([L.Add, L.Add, L.Maximum, L.Average]))
    return merge(dtype=dtype)([x, branch, *earlier] if draw(st.booleans()) else [branch, x])


def _concatenation(draw: st.DrawFn, x: Any, dtype: str, tensors: list[Any]) -> Any:
    """Concatenate of `x`, a convolution of it and earlier tensors of its size; sometimes the sum of two of these."""
    earlier = [tensor for tensor in tensors if tensor.shape[1:3] == x.shape[1:3]][-2:]
    branch = L.Conv2D(draw(st.integers(1, 3)), 3, padding="same", dtype=dtype)(x)
    joined = L.Concatenate(dtype=dtype)([*earlier, branch])
    if not draw(st.booleans()):
        return joined
    return L.Add(dtype=dtype)([joined, L.Conv2D(joined.shape[-1], 2, padding="same", dtype=dtype)(x)])


def _head(draw: st.DrawFn, x: Any, dtype: str) -> Any:
    kind = draw(st.sampled_from(["conv", "conv", "conv", "dense", "flatten"]))
    if kind == "conv":
        return L.Conv2D(draw(st.integers(1, 2)), 2, padding="same", dtype=dtype)(x)
    if kind == "dense":
        x = L.Dense(3, activation="relu", dtype=dtype)(L.GlobalAveragePooling2D(dtype=dtype)(x))
    else:
        x = L.Flatten(dtype=dtype)(x)
    return L.Dense(2, activation="softmax", dtype=dtype)(x)
