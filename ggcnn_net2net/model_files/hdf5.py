"""Keras models in HDF5: read those of Keras 2.0 to 3, write the schema of Keras 2.0, which all of them read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ggcnn_net2net.atomic import new_hdf5
from ggcnn_net2net.errors import ModelFileError
from ggcnn_net2net.model_files.keras_config import build_model, keras2_config, normalised_config
from ggcnn_net2net.model_files.stored_model import StoredModel, optimizer_facts, parse_history

if TYPE_CHECKING:
    import h5py
    import keras

SUFFIXES = (".hdf5", ".h5")

WRITTEN_VERSION = "2.2.4"
"""Keras version that written files name: the last of Keras 2 before tf.keras, whose schema they have."""

_HISTORY = "ggcnn_net2net_history"
_NOT_LAYERS = {"top_level_model_weights"}


def read_hdf5(path: Path) -> StoredModel:
    """Read a whole-model HDF5 file of any Keras from 2.0 on.

    Raises:
        ModelFileError: damaged, weights alone, a configuration that cannot be built or would run code, or weights
            that do not fit it.
    """
    import h5py  # slow to import

    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ModelFileError(
            f"expected an HDF5 file, received a damaged or truncated one ({path.stat().st_size} bytes): {error}; "
            "fetch or save it again"
        ) from error
    with file:
        if "model_config" not in file.attrs:
            raise ModelFileError(
                "expected a whole Keras model, received a file without model_config: save it with model.save(), not "
                "save_weights()"
            )
        model = build_model(normalised_config(json.loads(file.attrs["model_config"])))
        _load_weights(model, file["model_weights"])
        return StoredModel(
            model=model,
            format="Keras HDF5",
            keras_version=_text(file.attrs.get("keras_version", "unknown")),
            optimizer=_optimizer(file),
            history=parse_history(file.attrs[_HISTORY]) if _HISTORY in file.attrs else [],
        )


def write_hdf5(model: keras.Model, path: Path, history: list[dict[str, Any]]) -> None:
    """Write a model, without optimizer, in the schema of Keras 2.0."""
    with new_hdf5(path) as file:
        # Bytes, and arrays of bytes for the lists of names: Keras 2 calls .decode() on what it reads.
        file.attrs["backend"] = b"tensorflow"
        file.attrs["keras_version"] = WRITTEN_VERSION.encode()
        file.attrs["model_config"] = json.dumps(keras2_config(model)).encode()
        if history:
            file.attrs[_HISTORY] = json.dumps(history).encode()
        weights = file.create_group("model_weights")
        weights.attrs["backend"] = b"tensorflow"
        weights.attrs["keras_version"] = WRITTEN_VERSION.encode()
        weights.attrs["layer_names"] = np.array([layer.name.encode() for layer in model.layers])
        for layer in model.layers:
            variables = _ordered_weights(layer)
            group = weights.create_group(layer.name)
            names = [f"{variable.path}:0".encode() for variable in variables]
            group.attrs["weight_names"] = np.array(names)
            for name, variable in zip(names, variables, strict=True):
                group.create_dataset(name, data=variable.numpy())


def _load_weights(model: keras.Model, group: h5py.Group) -> None:
    """Give every layer the weights stored under its name; nothing may be missing, misshapen or left over."""
    if _text(group.attrs.get("backend", "tensorflow")) == "theano":
        raise ModelFileError(
            "expected a file written with the TensorFlow backend, received one of Theano, whose kernels are mirrored: "
            "convert it with Keras 2"
        )
    stored = {name: _names(group[name], "weight_names") for name in _names(group, "layer_names")}
    known = {layer.name for layer in model.layers} | _NOT_LAYERS
    left_over = [name for name, weights in stored.items() if weights and name not in known]
    if left_over:
        raise ModelFileError(f"expected weights of the model's layers only, received more for {', '.join(left_over)}")
    for layer in model.layers:
        variables = _ordered_weights(layer)
        arrays = [np.asarray(group[layer.name][weight]) for weight in stored.get(layer.name, [])]
        expected = [tuple(variable.shape) for variable in variables]
        received = [array.shape for array in arrays]
        if expected != received:
            raise ModelFileError(
                f"expected weights of the shapes {expected} for layer {layer.name!r}, received {received}: the file's "
                "configuration and weights are of different models"
            )
        for variable, array in zip(variables, arrays, strict=True):
            variable.assign(array)


def _ordered_weights(layer: keras.layers.Layer) -> list[keras.Variable]:
    """A layer's weights in the order in which every Keras writes them to HDF5."""
    return [*layer.trainable_weights, *layer.non_trainable_weights]


def _names(group: h5py.Group, attribute: str) -> list[str]:
    """A list of names; Keras splits one that is too long for an attribute into attribute0, attribute1, ..."""
    if attribute in group.attrs:
        return [_text(name) for name in group.attrs[attribute]]
    names, part = [], 0
    while f"{attribute}{part}" in group.attrs:
        names += [_text(name) for name in group.attrs[f"{attribute}{part}"]]
        part += 1
    return names


def _text(value: str | bytes) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _optimizer(file: h5py.File) -> dict[str, Any] | None:
    if "training_config" not in file.attrs:
        return None
    config = json.loads(file.attrs["training_config"]).get("optimizer_config")
    state = file.get("optimizer_weights")
    return optimizer_facts(config, len(_names(state, "weight_names")) if state is not None else 0)
