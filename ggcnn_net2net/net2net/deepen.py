"""*deeper*: insert a layer that is the identity (Chen et al., "Net2Net", 2016, section 2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net.channels import Channels
from ggcnn_net2net.net2net.graph import Config, ModelGraph
from ggcnn_net2net.net2net.operation import Operation
from ggcnn_net2net.net2net.rebuild import Weights, check_optimizer, copy_optimizer_state, rebuild, weights_of
from ggcnn_net2net.net2net.rules import ACTIVATION_LAYERS, RULES, idempotence_refusal, is_linear, refusal

if TYPE_CHECKING:
    import keras


def deeper(
    model: keras.Model,
    layer: int | str,
    kernel_size: int | tuple[int, int] | None = None,
    carry_optimizer: bool = False,
) -> keras.Model:
    """Insert a layer behind `layer` that changes nothing until it is trained.

    The new layer is of the class, number of filters, activation and regularizers of `layer`, with stride 1,
    dilation 1 and 'same' padding. Its kernel is the identity: 1 at the centre tap from each channel to
    itself, 0 elsewhere; its bias is 0.

    A convolution without an activation of its own, followed by BatchNormalization and an activation layer, is
    one block with them, and a copy of the block is inserted behind it. Its BatchNormalization is the identity
    for inference; in training it normalizes by the batch, like any other.

    Args:
        model: a functional `keras.Model`. It is left as it is.
        layer: the paper's index (from 1, over the hidden Conv2D, Conv2DTranspose and Dense layers in model
            order), or the name of such a layer.
        kernel_size: of the new layer; by default that of `layer`.
        carry_optimizer: compile the new model like `model`, with the state of its optimizer; the slots of the
            new layer start afresh.

    Returns:
        A new `keras.Model` that computes the same function. The new layer is called `<layer>_deeper`, the
        next one `<layer>_deeper_2`.

    Raises:
        SurgeryError: no such layer, one that is not supported, or one whose activation f has f(f(x)) != f(x),
            so that no identity can follow it.

    Example:
        >>> str(architecture_of(deeper(build_ggcnn("narrow"), 1)))
        'C9x9x8_C9x9x8_C5x5x4_C3x3x2_T3x3x2_T5x5x4_T9x9x8'
    """
    if carry_optimizer:
        check_optimizer(model)
    graph = ModelGraph.of(model)
    name = Channels.of(graph).layer_name(layer)
    size = _kernel_size(graph.layers[name], kernel_size)
    block = identity_block(graph, name)
    edited: dict[str, Weights] = {}
    last = block[-1]
    for template in block:
        changes = _as_identity(graph.layer_config(template)["config"], size)
        last = graph.insert_copy(template, last, changes)
        edited[last] = _identity_weights(graph.layers[template], size)
    entry = {
        "operation": str(Operation("deeper", layer, kernel_size=None if kernel_size is None else _pair(kernel_size))),
        "layer": name,
        "added": list(edited),
    }
    child = rebuild(model, graph.config, edited, entry)
    if carry_optimizer:
        copy_optimizer_state(model, child)
    return child


def added_parameters(graph: ModelGraph, name: str, kernel_size: int | tuple[int, int] | None) -> int:
    """Number of parameters that *deeper* adds behind layer `name`; arguments and errors as there."""
    size = _kernel_size(graph.layers[name], kernel_size)
    block = [_identity_weights(graph.layers[template], size) for template in identity_block(graph, name)]
    return sum(values.size for weights in block for values in weights.values())


def identity_block(graph: ModelGraph, name: str) -> list[str]:
    """Names of the layers that *deeper* repeats: `name`, and if it is linear its normalization and activation.

    Raises:
        SurgeryError: no identity of their kind can follow them.
    """
    block = [name, *(_followers(graph, name) if is_linear(graph.layers[name]) else ())]
    reason = refusal(graph.layers[name], graph.input_shapes(name), graph.shapes[name])
    for member in block:
        reason = reason or idempotence_refusal(graph.layers[member])
        if reason:
            raise SurgeryError(
                f"cannot add a layer behind {name!r}: layer {member!r} stands in the way, because {reason}"
            )
    return block


def _followers(graph: ModelGraph, name: str) -> list[str]:
    """Normalization and activation layers behind `name`, up to the first activation."""
    followers: list[str] = []
    while len(consumers := graph.consumers(name)) == 1 and consumers[0] not in graph.outputs:
        (name,) = consumers
        kind = type(graph.layers[name]).__name__
        if kind in ("BatchNormalization", *ACTIVATION_LAYERS):
            followers.append(name)
        if kind != "BatchNormalization":
            break
    return followers


def _kernel_size(layer: keras.Operation, kernel_size: int | tuple[int, int] | None) -> tuple[int, ...]:
    """Kernel size of the layer behind `layer`; () for Dense."""
    if not hasattr(layer, "kernel_size") and kernel_size is not None:
        raise SurgeryError(f"expected no kernel_size for {layer.name!r}, a Dense layer, received {kernel_size}")
    if kernel_size is None:
        return tuple(getattr(layer, "kernel_size", ()))
    return _pair(kernel_size)


def _pair(kernel_size: int | tuple[int, int]) -> tuple[int, int]:
    match (kernel_size, kernel_size) if isinstance(kernel_size, int) else kernel_size:
        case (int(height), int(width)) if min(height, width) > 0:
            return height, width
    raise SurgeryError(f"expected a kernel_size of one or two positive integers, received {kernel_size}")


def _as_identity(config: Config, kernel_size: tuple[int, ...]) -> Config:
    """Entries of a layer's config that are different in the identity behind it."""
    wanted = {
        "kernel_size": kernel_size,
        "strides": (1, 1),
        "dilation_rate": (1, 1),
        "padding": "same",
        "output_padding": None,
        "trainable": True,  # behind a frozen layer, too, or it could never become more than the identity
    }
    return {key: value for key, value in wanted.items() if key in config}


def _identity_weights(layer: keras.Layer, kernel_size: tuple[int, ...]) -> Weights:
    """Weights with which a copy of `layer` behind it changes nothing."""
    weights = {name: np.zeros_like(value) for name, value in weights_of(layer).items()}
    width = RULES[type(layer).__name__].width
    if width is not None:
        channels = getattr(layer, width)
        weights["kernel"] = np.zeros((*kernel_size, channels, channels))
        # An even kernel is padded by one less in front than behind, so the tap on the pixel itself is the one
        # before the middle; for Conv2DTranspose, which is the transpose, too.
        weights["kernel"][tuple((side - 1) // 2 for side in kernel_size)] = np.eye(channels)
    if "moving_variance" in weights:
        weights["moving_variance"] += 1 - layer.epsilon
    if "gamma" in weights:
        weights["gamma"] += 1
    return weights
