"""A new model from an edited config: the weights, the history and, if wanted, the optimizer of its parent."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net.graph import Config
from ggcnn_net2net.net2net.history import history_of, set_history

if TYPE_CHECKING:
    import keras

Weights = dict[str, np.ndarray]
"""Weight name -> value, for one layer."""

Resize = Callable[[str, str, np.ndarray], np.ndarray]
"""(layer name, weight name, array of the weight's old shape) -> array of its new shape."""


def weights_of(layer: keras.Layer) -> Weights:
    """Values of the weights of one layer by name."""
    return {weight.name: weight.numpy() for weight in layer.weights}


def rebuild(model: keras.Model, config: Config, edited: Mapping[str, Weights], entry: Config) -> keras.Model:
    """Build the model of `config`, a child of `model`.

    Args:
        model: the parent, left as it is.
        config: edited functional config.
        edited: layer name -> weights, for all layers that are new or have other weights than in `model`.
        entry: the operation, for the child's history.

    Returns:
        An uncompiled `keras.Model`.
    """
    import keras  # importing the package must not import TensorFlow

    custom_objects = {type(layer).__name__: type(layer) for layer in model.layers}
    child = keras.Model.from_config(config, custom_objects=custom_objects)
    parents = {layer.name: layer for layer in model.layers}
    for layer in child.layers:
        if layer.name in edited:
            for weight in layer.weights:
                weight.assign(edited[layer.name][weight.name])
        else:
            for weight, old in zip(layer.weights, parents[layer.name].weights, strict=True):
                weight.assign(old.numpy())
    set_history(child, [*history_of(model), entry])
    return child


def check_optimizer(model: keras.Model) -> None:
    """Check that `model` has an optimizer to carry over.

    Raises:
        SurgeryError: it is not compiled, or its optimizer has no slots yet.
    """
    optimizer = getattr(model, "optimizer", None)
    if optimizer is None or not optimizer.built:
        raise SurgeryError(
            "expected a compiled model with a built Keras optimizer for carry_optimizer=True, received "
            + ("a model that is not compiled" if optimizer is None else f"one whose {optimizer.name} is not built")
            + ": train it first, or leave carry_optimizer=False"
        )


def copy_optimizer_state(model: keras.Model, child: keras.Model, resize: Resize | None = None) -> None:
    """Compile `child` as `model` is, with the state of its optimizer.

    Slots (moving averages of gradients and the like) of a weight that both models have are copied, cloned
    where its filters were cloned; those of new layers stay as the optimizer makes them. Step count and
    learning rate are copied.

    Args:
        model: the parent, compiled, with a built optimizer.
        child: the model that one operation made of it.
        resize: brings a slot to its weight's new shape; None where no shape changed.
    """
    child.compile_from_config(model.get_compile_config())
    old = _slots(model)
    for key, slot in _slots(child).items():
        if key in old:
            value = old[key].numpy()
            layer, weight, _ = key
            slot.assign(resize(layer, weight, value) if resize and layer else value)


def _slots(model: keras.Model) -> dict[tuple[str, str, str], Any]:
    """(layer name, weight name, slot name) -> variable; no layer and weight for step count and learning rate."""
    owners = {
        f"{weight.path.replace('/', '_')}_": (layer.name, weight.name)
        for layer in model.layers
        for weight in layer.weights
    }
    slots = {}
    for variable in model.optimizer.variables:
        # Keras puts the path of a weight in front of the names of its slots.
        prefix = max((path for path in owners if variable.name.startswith(path)), key=len, default="")
        slots[(*owners.get(prefix, ("", "")), variable.name.removeprefix(prefix))] = variable
    return slots
