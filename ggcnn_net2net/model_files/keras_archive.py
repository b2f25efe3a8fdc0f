"""Keras models in the `.keras` format: a zip archive of config.json, metadata.json and model.weights.h5."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import ModelFileError
from ggcnn_net2net.model_files.keras_config import build_model, normalised_config
from ggcnn_net2net.model_files.stored_model import StoredModel, optimizer_facts, parse_history

if TYPE_CHECKING:
    import keras

SUFFIXES = (".keras",)
_CONFIG, _METADATA, _WEIGHTS = "config.json", "metadata.json", "model.weights.h5"
_HISTORY = "ggcnn_net2net_history.json"


def read_keras(path: Path) -> StoredModel:
    """Read a `.keras` file.

    Raises:
        ModelFileError: damaged, parts missing, a configuration that cannot be built or would run code, or weights
            that do not fit it.
    """
    try:
        archive = zipfile.ZipFile(path)
    except zipfile.BadZipFile as error:
        raise ModelFileError(
            f"expected a zip archive, received a damaged or truncated one ({path.stat().st_size} bytes): {error}; "
            "fetch or save it again"
        ) from error
    with archive:
        missing = {_CONFIG, _METADATA, _WEIGHTS} - set(archive.namelist())
        if missing:
            raise ModelFileError(f"expected {', '.join(sorted(missing))} in the archive, received none: save it again")
        damaged = archive.testzip()
        if damaged:
            raise ModelFileError(f"expected an intact archive, received one whose {damaged} is damaged")
        stored = json.loads(archive.read(_CONFIG))
        metadata = json.loads(archive.read(_METADATA))
        history = parse_history(archive.read(_HISTORY)) if _HISTORY in archive.namelist() else []
        stored_weights = _stored_weights(archive.read(_WEIGHTS))
    model = build_model(normalised_config(stored))
    _load_weights(model, path, stored_weights)
    n_slots = sum(name.startswith("optimizer/") for name in stored_weights)
    return StoredModel(
        model=model,
        format="Keras archive",
        keras_version=metadata.get("keras_version", "unknown"),
        optimizer=optimizer_facts((stored.get("compile_config") or {}).get("optimizer"), n_slots),
        history=history,
    )


def write_keras(model: keras.Model, path: Path, history: list[dict[str, Any]]) -> None:
    """Write a model in Keras' own format, with its optimizer if it is compiled with one that Keras knows."""
    import keras

    optimizer = getattr(model, "optimizer", None)
    if optimizer is not None and not type(optimizer).__module__.startswith("keras."):
        # Left out, or only processes that have imported the optimizer's class could open the file.
        model = keras.Model(model.inputs, model.outputs, name=model.name)
    model.save(path)
    if history:  # Keras does not look at other members of the archive
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr(_HISTORY, json.dumps(history))


def _load_weights(model: keras.Model, path: Path, stored: list[str]) -> None:
    """Keras raises for weights that are missing or misshapen; those that are left over are counted here."""
    try:
        model.load_weights(str(path))
    except ValueError as error:
        raise ModelFileError(
            f"expected its weights to fit its configuration, received others: {str(error).strip()}"
        ) from error
    in_layers = [name for name in stored if name.startswith("layers/") and "/seed_generator/" not in name]
    if len(in_layers) != len(model.weights):
        raise ModelFileError(
            f"expected {len(model.weights)} weights for its configuration, received {len(in_layers)}: configuration "
            "and weights are of different models"
        )


def _stored_weights(content: bytes) -> list[str]:
    """Paths of all arrays in the weights file."""
    import h5py  # slow to import

    names: list[str] = []
    with h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return names
