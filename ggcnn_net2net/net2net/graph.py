"""A functional Keras model as a graph of layer configs, which surgery edits instead of the model."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import SurgeryError

if TYPE_CHECKING:
    import keras

Config = dict[str, Any]

_FUNCTIONAL_KEYS = {"layers", "input_layers", "output_layers"}
_ADDED_SUFFIX = re.compile(r"_deeper(_\d+)?\Z")


@dataclass
class ModelGraph:
    """Layers of a model and which of them feed which. Editing `config` leaves the model as it is."""

    config: Config
    """What `keras.Model.from_config` takes."""

    layers: dict[str, keras.Operation]
    """The model's own layers by name, in model order. Never edited."""

    outputs: set[str]
    """Names of the layers whose tensors the model returns."""

    sources: dict[str, list[str]] = field(default_factory=dict)
    """Layer name -> names of the layers it is called on, in the order of the call."""

    shapes: dict[str, tuple[int | None, ...]] = field(default_factory=dict)
    """Layer name -> shape of its output, batch dimension first, channels last."""

    @classmethod
    def of(cls, model: keras.Model) -> ModelGraph:
        """Read the graph of `model`.

        Raises:
            SurgeryError: not a functional model, or one with shared layers, nested models or Lambda layers.
        """
        layers = {operation.name: operation for operation in getattr(model, "operations", [])}
        config = model.get_config() if layers else {}
        if not config.keys() >= _FUNCTIONAL_KEYS:
            raise SurgeryError(
                f"expected a functional keras.Model, received {model!r}: a Sequential model becomes one with "
                "keras.Model(model.inputs, model.outputs)"
            )
        outputs = {tensor._keras_history.operation.name for tensor in model.outputs}
        graph = cls(config, layers, outputs)
        graph.shapes |= {tensor._keras_history.operation.name: tensor.shape for tensor in model.outputs}
        for layer in config["layers"]:
            _refuse(layers[layer["name"]], layer)
            # Shapes that a layer was built with, which go stale with the first edit.
            layer.pop("build_config", None)
            tensors = list(_tensors(layer["inbound_nodes"]))
            graph.sources[layer["name"]] = [tensor["keras_history"][0] for tensor in tensors]
            graph.shapes |= {tensor["keras_history"][0]: tuple(tensor["shape"]) for tensor in tensors}
        return graph

    def layer_config(self, name: str) -> Config:
        """The config of one layer, to be read or edited."""
        return next(layer for layer in self.config["layers"] if layer["name"] == name)

    def input_shapes(self, name: str) -> list[tuple[int | None, ...]]:
        """Shapes of the tensors that layer `name` is called on, in the order of the call."""
        return [self.shapes[source] for source in self.sources[name]]

    def consumers(self, name: str) -> list[str]:
        """Names of the layers that are called on the output of `name`."""
        return [consumer for consumer, sources in self.sources.items() if name in sources]

    def unused_name(self, name: str) -> str:
        """A name for a layer added after `name`: conv2d_3_deeper, then conv2d_3_deeper_2 and so on."""
        stem = _ADDED_SUFFIX.sub("", name) + "_deeper"
        taken = {layer["name"] for layer in self.config["layers"]}
        number = 1
        while (candidate := stem if number == 1 else f"{stem}_{number}") in taken:
            number += 1
        return candidate

    def insert_copy(self, template: str, after: str, changes: Config) -> str:
        """Insert a copy of layer `template` between layer `after` and all its consumers.

        Args:
            template: name of a layer with one input.
            after: name of the layer whose output the new layer takes and whose consumers it takes over.
            changes: entries of the copied layer config that are to be different.

        Returns:
            The new layer's name.
        """
        added = copy.deepcopy(self.layer_config(template))
        name = self.unused_name(template)
        added["name"] = name
        added["config"] |= {"name": name, **changes}
        layers = self.config["layers"]
        for tensor in _tensors([layer["inbound_nodes"] for layer in layers]):
            if tensor["keras_history"][0] == after:
                tensor["keras_history"][0] = name
        for tensor in _tensors(added["inbound_nodes"]):
            tensor["keras_history"][0] = after
        layers.insert(layers.index(self.layer_config(after)) + 1, added)
        return name


def _refuse(layer: keras.Operation, config: Config) -> None:
    import keras  # importing the package must not import TensorFlow

    if isinstance(layer, keras.Model):
        reason = "is a nested model, whose layers are out of reach: build the model without nesting"
    elif isinstance(layer, keras.layers.Lambda):
        reason = "is a Lambda layer, whose code cannot be rebuilt from the model's config"
    elif len(config["inbound_nodes"]) > 1:
        reason = f"is shared: it is called {len(config['inbound_nodes'])} times"
    else:
        return
    raise SurgeryError(f"cannot operate on this model: layer {layer.name!r} {reason}")


def _tensors(node: Any) -> Iterator[Config]:
    """Configs of all tensors in a serialized call, in the order of the call."""
    if isinstance(node, dict):
        if node.get("class_name") == "__keras_tensor__":
            yield node["config"]
            return
        node = list(node.values())
    if isinstance(node, list | tuple):
        for part in node:
            yield from _tensors(part)
