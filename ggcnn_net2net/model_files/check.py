"""What makes a Keras model a GG-CNN: one depth image in, the four grasp maps out, finite weights."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import ModelFileError

if TYPE_CHECKING:
    import keras


def check_ggcnn(model: keras.Model, origin: str = "model") -> None:
    """Check that `model` is a working GG-CNN; `origin` names it in the errors.

    Between input and heads any layers may stand: relatives with dilated convolutions, pooling or batch normalisation
    pass, although `architecture_of` has no name for them.

    Args:
        model: what to check.
        origin: what the errors call it.

    Raises:
        ModelFileError: the input is not one depth image, heads are missing, of another shape or in another order, or
            weights are not finite.
    """
    problem = next(problems(model), None)
    if problem:
        raise ModelFileError(f"{origin} does not hold a working GG-CNN: {problem}")


def problems(model: keras.Model) -> Iterator[str]:
    """Every reason for which `check_ggcnn` would refuse `model`, gravest first."""
    import keras  # importing the package must not import TensorFlow

    if not isinstance(model, keras.Model) or type(model).__name__ != "Functional":
        yield (
            f"expected a functional model of Keras {keras.__version__}, received a {type(model).__name__} of "
            f"{type(model).__module__}: rebuild it with keras.Model(inputs, outputs)"
        )
        return
    names = output_names(model)
    missing = [name for name in HEADS if name not in names]
    if missing:
        yield (
            f"expected the four heads {', '.join(HEADS)}, received the outputs {', '.join(names)}; missing "
            f"{', '.join(missing)}"
        )
        return
    if names != list(HEADS):
        yield (
            f"expected the outputs {', '.join(HEADS)} in this order, received {', '.join(names)}; a network with "
            "re-ordered heads would be read wrongly: save keras.Model(inputs, outputs in the right order)"
        )
    yield from _shape_problems(model)
    for weight in model.weights:
        if not np.isfinite(weight.numpy()).all():
            yield (
                f"expected finite weights, received NaN or infinity in {weight.path}: the training that made them "
                "diverged; use an earlier checkpoint"
            )


def output_names(model: keras.Model) -> list[str]:
    """Names of the layers that make the model's outputs, in the order of the outputs."""
    return [tensor._keras_history.operation.name for tensor in model.outputs]


def _shape_problems(model: keras.Model) -> Iterator[str]:
    shapes = [tuple(tensor.shape) for tensor in model.inputs]
    if len(shapes) != 1 or len(shapes[0]) != 4 or shapes[0][-1] != 1:
        yield f"expected one input of shape (batch, height, width, 1), received {shapes}: feed it depth images only"
        return
    for tensor in model.outputs:
        head = tensor._keras_history.operation
        if head.name not in HEADS:
            continue
        if tuple(tensor.shape)[1:] != shapes[0][1:]:
            yield (
                f"expected {head.name} to give a map of the input's size {shapes[0][1:]}, received "
                f"{tuple(tensor.shape)[1:]}"
            )
        activation = getattr(head, "activation", None)
        activation_name = getattr(activation, "__name__", type(activation).__name__)  # it may be a layer
        if type(head).__name__ != "Conv2D" or head.filters != 1 or activation_name != "linear":
            yield (
                f"expected {head.name} to be a linear Conv2D with one filter, received {type(head).__name__} with "
                f"{getattr(head, 'filters', 'no')} filters and activation {activation_name}"
            )
