"""GG-CNN architectures and their names: `C9x9x32_C5x5x16_C3x3x8_T3x3x8_T5x5x16_T9x9x32`.

`C` is a Conv2D and `T` a Conv2DTranspose, followed by kernel height x kernel width x filters. Every network ends in
the four linear 2x2 heads of GG-CNN, which the name leaves out. The notation and the five named networks are those of
"Extending GG-CNN through Automated Model Space Exploration using Knowledge Transfer", section III and Table I.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, repeat
from math import prod
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import ArchitectureError

if TYPE_CHECKING:
    import keras

HEADS = ("pos_out", "cos_out", "sin_out", "width_out")
"""Names of the four outputs, in the order in which every GG-CNN returns them."""

HEAD_KERNEL_SIZE = (2, 2)
INPUT_SIZE = 300
"""Side of the square depth image that the published network was trained on, in pixels."""

_BASE_STRIDES = {9: 3, 5: 2, 3: 2}  # kernel size -> stride of the six base layers, down and up alike
_LAYER = re.compile(r"(?P<kind>[CT])(?P<height>\d+)x(?P<width>\d+)x(?P<filters>\d+)(?:s(?P<stride>\d+))?\Z")
_KERAS_CLASSES = {"C": "Conv2D", "T": "Conv2DTranspose"}
_WITHOUT_WEIGHTS = {"InputLayer", "ZeroPadding2D", "Cropping2D"}  # the last two: padding of the PyTorch GG-CNN


@dataclass(frozen=True)
class ConvLayer:
    """One hidden layer: `kind` "C" (Conv2D) or "T" (Conv2DTranspose), 'same' padding, relu, equal strides both ways."""

    kind: str
    kernel_size: tuple[int, int]
    filters: int
    stride: int

    def parameters(self, channels_in: int) -> int:
        """Number of weights and biases for an input of `channels_in` channels."""
        height, width = self.kernel_size
        return (height * width * channels_in + 1) * self.filters


@dataclass(frozen=True)
class Architecture:
    """The hidden layers of a GG-CNN, first to last. `str()` gives the paper's notation.

    The notation has no stride, and needs none for what *deeper* and *wider* make of a GG-CNN: a 9x9 layer has stride 3,
    a 5x5 or 3x3 layer stride 2, and a layer that follows one of its own kind and kernel size (as *deeper* adds it)
    stride 1. Where a stride differs from this rule, it is written behind the layer: `C7x7x16s2`.
    """

    layers: tuple[ConvLayer, ...]

    def __post_init__(self) -> None:
        if not self.layers:
            raise ArchitectureError("expected an architecture with at least one layer, received none")
        for layer in self.layers:
            if layer.kind not in _KERAS_CLASSES or min(*layer.kernel_size, layer.filters, layer.stride) < 1:
                raise ArchitectureError(
                    f"expected layers of kind C or T with kernel size, filters and stride above 0, received {layer}"
                )

    @classmethod
    def parse(cls, text: str) -> Architecture:
        """Read the paper's notation, or one of the names original, extended, optimized, narrow, shallow.

        Args:
            text: for example `C9x9x32_C5x5x16_C3x3x8_T3x3x8_T5x5x16_T9x9x32`; names in any case.

        Returns:
            The architecture; `str()` of it gives the notation back.

        Raises:
            ArchitectureError: the text is neither.

        Example:
            >>> Architecture.parse("C5x5x4_C3x3x2_T3x3x2_T5x5x4").layers[0]
            ConvLayer(kind='C', kernel_size=(5, 5), filters=4, stride=2)
        """
        if text.strip().lower() in NAMED:
            return NAMED[text.strip().lower()]
        layers: list[ConvLayer] = []
        for part in text.strip().split("_"):
            match = _LAYER.match(part)
            if match is None:
                raise ArchitectureError(
                    f"expected layers like C9x9x32 or T3x3x8 joined by '_', or one of the names {', '.join(NAMED)}; "
                    f"received {part!r} in {text!r}"
                )
            kind, kernel_size = match["kind"], (int(match["height"]), int(match["width"]))
            stride = int(match["stride"]) if match["stride"] else _usual_stride(layers, kind, kernel_size)
            layers.append(ConvLayer(kind, kernel_size, int(match["filters"]), stride))
        return cls(tuple(layers))

    def __str__(self) -> str:
        parts = []
        for index, layer in enumerate(self.layers):
            height, width = layer.kernel_size
            usual = _usual_stride(self.layers[:index], layer.kind, layer.kernel_size)
            suffix = "" if layer.stride == usual else f"s{layer.stride}"
            parts.append(f"{layer.kind}{height}x{width}x{layer.filters}{suffix}")
        return "_".join(parts)

    @property
    def n_parameters(self) -> int:
        """Weights and biases of all layers, the four heads included, for a one-channel depth image."""
        channels, total = 1, 0
        for layer in self.layers:
            total += layer.parameters(channels)
            channels = layer.filters
        head = ConvLayer("C", HEAD_KERNEL_SIZE, 1, 1)
        return total + len(HEADS) * head.parameters(channels)

    def multiplications(self, input_size: int = INPUT_SIZE) -> int:
        """Number of multiplications per image, heads included: the network's cost, where `n_parameters` is its size.

        Args:
            input_size: side of the image in pixels.

        Returns:
            Products of a weight and a value, those with padding included.
        """
        side, channels, total = input_size, 1, 0
        for layer in self.layers:
            # A convolution applies its kernel once per output pixel, a transposed convolution once per input pixel.
            below = side
            side = side * layer.stride if layer.kind == "T" else -(-side // layer.stride)
            total += min(side, below) ** 2 * prod(layer.kernel_size) * channels * layer.filters
            channels = layer.filters
        return total + side**2 * prod(HEAD_KERNEL_SIZE) * channels * len(HEADS)

    @property
    def name(self) -> str | None:
        """original, extended, optimized, narrow or shallow; None for every other architecture."""
        return next((name for name, known in NAMED.items() if known == self), None)


def _usual_stride(before: Sequence[ConvLayer], kind: str, kernel_size: tuple[int, int]) -> int:
    if before and before[-1].kind == kind and before[-1].kernel_size == kernel_size:
        return 1
    height, width = kernel_size
    return _BASE_STRIDES.get(height, 1) if height == width else 1


NAMED: dict[str, Architecture] = {}
ORIGINAL = NAMED["original"] = Architecture.parse("C9x9x32_C5x5x16_C3x3x8_T3x3x8_T5x5x16_T9x9x32")
"""GG-CNN as it was published: 62,420 parameters."""
EXTENDED = NAMED["extended"] = Architecture.parse(
    "C9x9x32_C5x5x16_C3x3x16_C3x3x16_C3x3x8_C3x3x8_T3x3x8_T5x5x16_T9x9x32"
)
"""What the paper's search made of it: 67,644 parameters."""
OPTIMIZED = NAMED["optimized"] = Architecture.parse(
    "C9x9x8_C9x9x8_C5x5x4_C3x3x2_T3x3x2_T5x5x4_T5x5x4_T5x5x4_T5x5x4_T9x9x8_T9x9x8"
)
"""What the paper's search made of `NARROW`: 16,104 parameters."""
NARROW = NAMED["narrow"] = Architecture.parse("C9x9x8_C5x5x4_C3x3x2_T3x3x2_T5x5x4_T9x9x8")
"""A fourth of the filters: 4,508 parameters."""
SHALLOW = NAMED["shallow"] = Architecture.parse("C5x5x4_C3x3x2_T3x3x2_T5x5x4")
"""`NARROW` without its first and last layer."""


def build_ggcnn(
    architecture: Architecture | str = ORIGINAL, input_size: int = INPUT_SIZE, seed: int | None = None
) -> keras.Model:
    """Build an untrained GG-CNN.

    Args:
        architecture: an `Architecture` or its notation.
        input_size: side of the square input in pixels; a multiple of the product of the downward strides.
        seed: seed of the Glorot-uniform weights; None draws new ones every time.

    Returns:
        `keras.Model` with input (batch, input_size, input_size, 1): depth in metres minus its mean; and four outputs
        of the same size named as in `HEADS`: grasp quality, cos 2θ, sin 2θ and opening width / 150 px.

    Raises:
        ArchitectureError: the output would not have the size of the input.
    """
    import keras  # importing the package must not import TensorFlow

    if isinstance(architecture, str):
        architecture = Architecture.parse(architecture)
    # No two layers may start alike, nor the layers of networks with neighbouring seeds.
    layer_seeds: Iterator[int | None] = repeat(None) if seed is None else count(1000 * seed)

    def convolution(layer: ConvLayer, **options: Any) -> keras.layers.Layer:
        return getattr(keras.layers, _KERAS_CLASSES[layer.kind])(
            layer.filters,
            layer.kernel_size,
            strides=layer.stride,
            padding="same",
            kernel_initializer=keras.initializers.GlorotUniform(seed=next(layer_seeds)),
            **options,
        )

    inputs = outputs = keras.Input((input_size, input_size, 1), name="input_1")
    counts = {"C": 0, "T": 0}
    for layer in architecture.layers:
        counts[layer.kind] += 1
        prefix = "conv2d" if layer.kind == "C" else "conv2d_transpose"
        outputs = convolution(layer, activation="relu", name=f"{prefix}_{counts[layer.kind]}")(outputs)
    if outputs.shape[1:3] != inputs.shape[1:3]:
        raise ArchitectureError(
            f"expected strides that lead back to {input_size}x{input_size}, received {architecture}, which gives "
            f"{outputs.shape[1]}x{outputs.shape[2]}: balance the strides of C and T layers"
        )
    head = ConvLayer("C", HEAD_KERNEL_SIZE, 1, 1)
    return keras.Model(inputs, [convolution(head, name=name)(outputs) for name in HEADS])


def architecture_of(model: keras.Model) -> Architecture:
    """Read the architecture of a GG-CNN.

    Args:
        model: a `keras.Model` made of Conv2D and Conv2DTranspose layers in a row that ends in the four heads.
            ZeroPadding2D and Cropping2D layers between them, as the PyTorch GG-CNN needs, have no place in the name.

    Returns:
        Its `Architecture`; `str()` of it is the paper's notation.

    Raises:
        ArchitectureError: the model has other layers, or layers that are not as in a GG-CNN, or is not a chain with
            the four heads at its end.
    """
    by_class = {name: kind for kind, name in _KERAS_CLASSES.items()}
    layers = []
    for layer in model.layers:
        class_name = type(layer).__name__
        if class_name in _WITHOUT_WEIGHTS or layer.name in HEADS:
            continue
        if class_name not in by_class:
            raise ArchitectureError(
                f"expected a GG-CNN of Conv2D and Conv2DTranspose layers, received layer {layer.name!r} of class "
                f"{class_name}"
            )
        if layer.strides[0] != layer.strides[1] or set(layer.dilation_rate) != {1}:
            raise ArchitectureError(
                f"expected equal strides both ways and no dilation, received strides {layer.strides} and dilation "
                f"{layer.dilation_rate} in {layer.name!r}: the notation cannot express it"
            )
        layers.append(ConvLayer(by_class[class_name], tuple(layer.kernel_size), layer.filters, layer.strides[0]))
    missing = [name for name in HEADS if name not in {layer.name for layer in model.layers}]
    if missing:
        raise ArchitectureError(f"expected the four heads {', '.join(HEADS)}, missing: {', '.join(missing)}")
    in_a_row = [layer.name for layer in model.layers if layer.name not in HEADS]
    for output in model.outputs:
        if _layers_before(output) != in_a_row:
            raise ArchitectureError(
                f"expected all layers in a row before each head, received a network with branches, {model.name!r}: the "
                "notation cannot express it"
            )
    for layer in model.layers:
        if layer.name in HEADS:
            _check_convolution(layer, kernel_size=HEAD_KERNEL_SIZE, activation="linear")
        elif type(layer).__name__ in by_class:
            _check_convolution(layer, activation="relu")
    return Architecture(tuple(layers))


def _check_convolution(layer: keras.layers.Layer, **expected: Any) -> None:
    """Refuse a layer that the notation would take for another.

    Raises:
        ArchitectureError: no bias, groups, or another activation or kernel size than expected.
    """
    config = layer.get_config()
    for name, value in {"use_bias": True, "groups": 1, **expected}.items():
        received = config.get(name, value)  # a Conv2DTranspose has no groups
        received = tuple(received) if isinstance(received, list) else received
        if received != value:
            raise ArchitectureError(
                f"expected {name} {value!r} in a GG-CNN, received {received!r} in {layer.name!r}: the notation cannot "
                "express it"
            )


def _layers_before(output: keras.KerasTensor) -> list[str]:
    """Names of the layers from the input to the one that a head reads, back to where several tensors meet."""
    names: list[str] = []
    history = output._keras_history
    while len(inputs := history.operation._inbound_nodes[history.node_index].input_tensors) == 1:
        history = inputs[0]._keras_history
        names.insert(0, history.operation.name)
    return names
