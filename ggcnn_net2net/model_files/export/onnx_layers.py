"""Keras layers as ONNX operators. Tensors have the channels first here, (batch, channels, height, width).

Where Keras pads 'same', it adds the odd pixel below and on the right; ONNX takes the padding as numbers, so they are
computed from the sizes of the images before and after the layer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import ExportError

_ACTIVATIONS = {"relu": "Relu", "sigmoid": "Sigmoid", "tanh": "Tanh"}


class OnnxGraph:
    """Operators and constants in the order in which they were added."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def add(self, operator: str, inputs: list[str], output: str, **attributes: Any) -> str:
        """Add an operator with one output; return the output's name."""
        from onnx import helper

        self.nodes.append(helper.make_node(operator, inputs, [output], name=output, **attributes))
        return output

    def add_layer(self, operator: str, inputs: list[str], layer: Any, **attributes: Any) -> str:
        """Add an operator that does the work of a layer; return its output's name, which is never a head's alone."""
        return self.add(operator, inputs, f"{layer.name}/{operator}", **attributes)

    def constant(self, name: str, values: npt.ArrayLike) -> str:
        """Add a constant; return its name."""
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name


def _convolution(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    kernel = layer.kernel.numpy().transpose(3, 2, 0, 1)  # (h, w, in, out) -> (out, in, h, w)
    paddings = _paddings(layer, layer.input.shape, layer.output.shape)
    return _convolve(graph, layer, inputs, "Conv", kernel, group=layer.groups, pads=paddings)


def _transposed_convolution(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    kernel = layer.kernel.numpy().transpose(3, 2, 0, 1)  # (h, w, out, in) -> (in, out, h, w)
    sides = []
    for axis in (0, 1):
        small, large = layer.input.shape[1 + axis], layer.output.shape[1 + axis]
        reach = (layer.kernel_size[axis] - 1) * layer.dilation_rate[axis] + 1
        sides.append((small - 1) * layer.strides[axis] + reach - large)  # pixels more than are wanted
    return _convolve(
        graph,
        layer,
        inputs,
        "ConvTranspose",
        kernel,
        pads=_halves([max(side, 0) for side in sides]),
        output_padding=[max(-side, 0) for side in sides],
    )


def _convolve(
    graph: OnnxGraph, layer: Any, inputs: list[str], operator: str, kernel: npt.NDArray[Any], **attributes: Any
) -> str:
    constants = [graph.constant(f"{layer.name}/kernel", kernel)]
    if layer.use_bias:
        constants.append(graph.constant(f"{layer.name}/bias", layer.bias.numpy()))
    result = graph.add_layer(
        operator,
        [*inputs, *constants],
        layer,
        kernel_shape=list(layer.kernel_size),
        strides=list(layer.strides),
        dilations=list(layer.dilation_rate),
        **attributes,
    )
    return _activation(graph, layer, [result])


def _activation(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    name = layer.activation.__name__
    if name == "linear":
        return inputs[0]
    if name not in _ACTIVATIONS:
        raise ExportError(
            f"expected one of the activations linear, {', '.join(_ACTIVATIONS)}, received {name!r} in {layer.name!r}: "
            "export to keras, savedmodel or tflite, which take every activation"
        )
    return graph.add_layer(_ACTIVATIONS[name], inputs, layer)


def _relu(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    if layer.max_value is not None or layer.negative_slope or layer.threshold:
        raise ExportError(f"expected a plain ReLU, received {layer.name!r} with a slope, a threshold or a limit")
    return graph.add_layer("Relu", inputs, layer)


def _leaky_relu(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    return graph.add_layer("LeakyRelu", inputs, layer, alpha=float(layer.negative_slope))


def _normalisation(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    channels = layer.moving_mean.shape
    values = {
        "gamma": layer.gamma if layer.scale else np.ones(channels, np.float32),
        "beta": layer.beta if layer.center else np.zeros(channels, np.float32),
        "mean": layer.moving_mean,
        "variance": layer.moving_variance,
    }
    constants = [graph.constant(f"{layer.name}/{name}", np.asarray(value)) for name, value in values.items()]
    return graph.add_layer("BatchNormalization", [*inputs, *constants], layer, epsilon=float(layer.epsilon))


def _max_pooling(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    return graph.add_layer(
        "MaxPool",
        inputs,
        layer,
        kernel_shape=list(layer.pool_size),
        strides=list(layer.strides),
        pads=_paddings(layer, layer.input.shape, layer.output.shape),
    )


def _upsampling(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    options = {
        "nearest": {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"},
        "bilinear": {"mode": "linear", "coordinate_transformation_mode": "half_pixel"},
    }
    if layer.interpolation not in options:
        raise ExportError(
            f"expected interpolation {' or '.join(options)}, received {layer.interpolation!r} in {layer.name!r}"
        )
    scales = graph.constant(f"{layer.name}/scales", np.array([1, 1, *layer.size], np.float32))
    return graph.add_layer("Resize", [*inputs, "", scales], layer, **options[layer.interpolation])


def _zero_padding(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    (top, bottom), (left, right) = layer.padding
    pads = graph.constant(f"{layer.name}/pads", np.array([0, 0, top, left, 0, 0, bottom, right], np.int64))
    return graph.add_layer("Pad", [*inputs, pads], layer)


def _cropping(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    (top, _), (left, _) = layer.cropping
    height, width = layer.output.shape[1:3]
    limits = {"starts": [top, left], "ends": [top + height, left + width], "axes": [2, 3]}
    constants = [graph.constant(f"{layer.name}/{name}", np.array(value, np.int64)) for name, value in limits.items()]
    return graph.add_layer("Slice", [*inputs, *constants], layer)


def _sum(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    return graph.add_layer("Sum", inputs, layer)


def _concatenation(graph: OnnxGraph, layer: Any, inputs: list[str]) -> str:
    if layer.axis not in (-1, 3):
        raise ExportError(f"expected channels to be concatenated, received axis {layer.axis} in {layer.name!r}")
    return graph.add_layer("Concat", inputs, layer, axis=1)


def _nothing(_graph: OnnxGraph, _layer: Any, inputs: list[str]) -> str:
    """What acts in training alone."""
    return inputs[0]


WRITERS: dict[str, Callable[[OnnxGraph, Any, list[str]], str]] = {
    "Conv2D": _convolution,
    "Conv2DTranspose": _transposed_convolution,
    "Activation": _activation,
    "ReLU": _relu,
    "LeakyReLU": _leaky_relu,
    "BatchNormalization": _normalisation,
    "MaxPooling2D": _max_pooling,
    "UpSampling2D": _upsampling,
    "ZeroPadding2D": _zero_padding,
    "Cropping2D": _cropping,
    "Add": _sum,
    "Concatenate": _concatenation,
    "Dropout": _nothing,
    "SpatialDropout2D": _nothing,
}


def _paddings(layer: Any, before: tuple[int, ...], after: tuple[int, ...]) -> list[int]:
    """Padding of a window that slides over an image: [top, left, bottom, right]."""
    if layer.padding != "same":
        return [0, 0, 0, 0]
    sizes = getattr(layer, "kernel_size", None) or layer.pool_size
    dilations = getattr(layer, "dilation_rate", (1, 1))
    sides = []
    for axis in (0, 1):
        reach = (sizes[axis] - 1) * dilations[axis] + 1
        sides.append(max((after[1 + axis] - 1) * layer.strides[axis] + reach - before[1 + axis], 0))
    return _halves(sides)


def _halves(sides: list[int]) -> list[int]:
    """[top, left, bottom, right] of paddings in all; the odd pixel goes to the end."""
    return [*(side // 2 for side in sides), *(side - side // 2 for side in sides)]
