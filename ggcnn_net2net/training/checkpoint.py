"""The state of a training run after an epoch, in one file."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ggcnn_net2net import atomic
from ggcnn_net2net.errors import TrainingError

if TYPE_CHECKING:
    import keras

FILE_NAME = "checkpoint.npz"

History = list[dict[str, Any]]
Run = dict[str, str]
"""What makes a run this one and no other: hashes of the recipe, the data and the network it starts from."""


def save_checkpoint(directory: Path, model: keras.Model, run: Run, history: History) -> None:
    """Write weights, optimizer state and history, whole or not at all, over the checkpoint of the epoch before."""
    arrays = [variable.numpy() for variable in _variables(model)]
    with atomic.replacing(directory / FILE_NAME) as temporary:
        np.savez(temporary, *arrays, facts=np.array(json.dumps({"run": run, "history": history})))


def load_checkpoint(directory: Path, model: keras.Model, run: Run) -> History:
    """Bring `model` and its optimizer to the state of the checkpoint.

    Args:
        directory: where checkpoints are; need not exist.
        model: compiled, with a built optimizer.
        run: the run that is to go on.

    Returns:
        The history of the epochs done; empty where there is no checkpoint.

    Raises:
        TrainingError: the checkpoint is damaged or of another run.
    """
    path = directory / FILE_NAME
    if not path.exists():
        return []
    try:
        with np.load(path, allow_pickle=False) as file:
            facts = json.loads(str(file["facts"]))
            arrays = [file[f"arr_{number}"] for number in range(len(file.files) - 1)]
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise TrainingError(f"cannot read {path}: {error}; delete it to start afresh") from error
    other = [name for name in run if facts["run"].get(name) != run[name]]
    if other:
        raise TrainingError(
            f"expected a checkpoint of this run in {path}, received one with another {' and another '.join(other)}: "
            "name another checkpoint folder, or delete it to start afresh"
        )
    for variable, array in zip(_variables(model), arrays, strict=True):
        variable.assign(array)
    history: History = facts["history"]
    return history


def fingerprint_of(model: keras.Model) -> str:
    """Hash of a model's layers and weights."""
    # Names that Keras counts up, such as that of the model itself, are no part of what is trained.
    config = [(type(layer).__name__, layer.get_config()) for layer in model.layers]
    digest = hashlib.sha256(json.dumps(config, sort_keys=True, default=str).encode())
    for weight in model.weights:
        digest.update(np.ascontiguousarray(weight.numpy()).tobytes())
    return digest.hexdigest()


def _variables(model: keras.Model) -> list[Any]:
    """All that a step changes: weights, statistics, states of random layers, and the optimizer's own."""
    return [variable for layer in model.layers for variable in layer.variables] + list(model.optimizer.variables)
