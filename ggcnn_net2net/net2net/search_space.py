"""Sequences of operations: what can be applied to a model, and applying it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net import deepen, widen
from ggcnn_net2net.net2net.channels import Channels
from ggcnn_net2net.net2net.deepen import deeper, identity_block
from ggcnn_net2net.net2net.graph import ModelGraph
from ggcnn_net2net.net2net.operation import Operation, parse_operations
from ggcnn_net2net.net2net.widen import wider

if TYPE_CHECKING:
    import keras

EXTENDED_OPERATIONS = "deeper(3), deeper(4), wider(3), deeper(3)"
"""Lead from `ORIGINAL` to `EXTENDED`, as the paper says in section III."""

OPTIMIZED_OPERATIONS = "deeper(1), deeper(6), deeper(6), deeper(6), deeper(10)"
"""Lead from `NARROW` to `OPTIMIZED`. The paper gives the two networks alone. These five steps are the only
way from one to the other, but for their order and for which of two equal layers is deepened."""


def apply_operations(
    model: keras.Model,
    operations: str | Sequence[Operation],
    seed: int = 0,
    noise: float = 0.0,
    carry_optimizer: bool = False,
) -> keras.Model:
    """Apply operations one after the other.

    Args:
        model: a functional `keras.Model`. It is left as it is.
        operations: a text like `EXTENDED_OPERATIONS`, or a sequence of `Operation`. An index counts the layers of the
            model that the operations before it have made.
        seed: the operation at position i, from 0, uses the seed `seed + i`.
        noise: of every *wider*, see there.
        carry_optimizer: compile the new model like `model` with the state of its optimizer.

    Returns:
        A new `keras.Model` that computes the same function; `model` itself if there are no operations.

    Raises:
        SurgeryError: an operation that cannot be read or applied; the message names it and its position.

    Example:
        >>> extended = apply_operations(load_ggcnn("published"), EXTENDED_OPERATIONS)
        >>> architecture_of(extended).name
        'extended'
    """
    if isinstance(operations, str):
        operations = parse_operations(operations)
    for position, operation in enumerate(operations):
        try:
            if operation.name == "deeper":
                model = deeper(model, operation.layer, operation.kernel_size, carry_optimizer)
            else:
                model = wider(
                    model,
                    operation.layer,
                    operation.factor,
                    filters=operation.filters,
                    noise=noise,
                    seed=seed + position,
                    carry_optimizer=carry_optimizer,
                )
        except SurgeryError as error:
            raise SurgeryError(f"operation {position + 1} of {len(operations)}, {operation}: {error}") from error
    return model


def operations(model: keras.Model, transpose: bool = False) -> list[Operation]:
    """The operations of the paper's search space that can be applied to `model` (sections II and III).

    Args:
        model: a functional `keras.Model`.
        transpose: whether Conv2DTranspose layers are searched, too; the paper's main search takes the
            feature-extraction layers alone.

    Returns:
        *deeper* of every layer in model order, then *wider* of every layer; without those that would raise.

    Raises:
        SurgeryError: a model on which no operation is possible at all: not functional, with shared layers,
            nested models or Lambda layers.

    Example:
        >>> [str(operation) for operation in operations(build_ggcnn("original"))]
        ['deeper(1)', 'deeper(2)', 'deeper(3)', 'wider(1)', 'wider(2)', 'wider(3)']
    """
    graph = ModelGraph.of(model)
    channels = Channels.of(graph)
    layers = [
        (index, name)
        for index, name in enumerate(channels.expandable, start=1)
        if transpose or type(graph.layers[name]).__name__ != "Conv2DTranspose"
    ]
    checks: dict[str, Callable[[str], object]] = {
        "deeper": lambda name: identity_block(graph, name),
        "wider": channels.check_copyable,
    }
    return [
        Operation(operation, index)
        for operation, check in checks.items()
        for index, name in layers
        if _passes(check, name)
    ]


def parameters_after(model: keras.Model, operations: Sequence[Operation]) -> list[int]:
    """Number of parameters that `model` would have after each one of `operations`. No model is built for it.

    Args:
        model: a functional `keras.Model`.
        operations: alternatives, each applied to `model`. Where *wider* of other channels gives another number, as it
            can behind a Concatenate, seed 0 counts.

    Returns:
        One number for each operation.

    Raises:
        SurgeryError: an operation that cannot be applied.

    Example:
        >>> parameters_after(build_ggcnn("original"), parse_operations("deeper(3), wider(3)"))
        [63004, 64156]
    """
    graph = ModelGraph.of(model)
    channels = Channels.of(graph)
    return [model.count_params() + _added(graph, channels, operation) for operation in operations]


def _added(graph: ModelGraph, channels: Channels, operation: Operation) -> int:
    name = channels.layer_name(operation.layer)
    if operation.name == "deeper":
        return deepen.added_parameters(graph, name, operation.kernel_size)
    return widen.added_parameters(graph, channels, name, operation.factor, operation.filters)


def _passes(check: Callable[[str], object], layer: str) -> bool:
    try:
        check(layer)
    except SurgeryError:
        return False
    return True
