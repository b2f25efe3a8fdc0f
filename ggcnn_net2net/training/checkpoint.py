"""The state of a training run after an epoch, in one file, and the state of an optimizer alone."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net import atomic
from ggcnn_net2net.errors import TrainingError

if TYPE_CHECKING:
    import keras

FILE_NAME = "checkpoint.npz"

History = list[dict[str, Any]]
Run = dict[str, str]
"""What makes a run this one and no other: hashes of the recipe, the data, the network it starts from and, unless it
starts with a fresh one, the optimizer's state."""


def save_checkpoint(directory: Path, model: keras.Model, run: Run, history: History) -> None:
    """Write weights, optimizer state and history, whole or not at all, over the checkpoint of the epoch before."""
    arrays = [variable.numpy() for variable in _variables(model)]
    names = [variable.name for variable in model.optimizer.variables]
    optimizer = {"kind": type(model.optimizer).__name__, "variables": names}
    facts = {"run": run, "history": history, "optimizer": optimizer}
    with atomic.replacing(directory / FILE_NAME) as temporary:
        np.savez(temporary, *arrays, facts=np.array(json.dumps(facts)))


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
    facts, arrays = _read(path)
    other = [name for name in {**run, **facts["run"]} if facts["run"].get(name) != run.get(name)]
    if other:
        raise TrainingError(
            f"expected a checkpoint of this run in {path}, received one with another {' and another '.join(other)}: "
            "name another checkpoint folder, or delete it to start afresh"
        )
    for variable, array in zip(_variables(model), arrays, strict=True):
        variable.assign(array)
    history: History = facts["history"]
    return history


def epochs_done(directory: Path) -> int:
    """How many epochs a run has done.

    Args:
        directory: where its checkpoints are; need not exist.

    Returns:
        The epochs of the checkpoint; 0 where there is none.

    Raises:
        TrainingError: a damaged checkpoint.
    """
    path = directory / FILE_NAME
    return len(_read(path)[0]["history"]) if path.exists() else 0


@dataclass(frozen=True)
class OptimizerState:
    """What an optimizer remembers from one step to the next. Its learning rate is a setting and no part of that."""

    kind: str
    """Class of the optimizer."""

    values: tuple[tuple[str, npt.NDArray[Any]], ...]
    """Names and values of its step count and of its slots, such as the moving averages of squared gradients."""

    @classmethod
    def of(cls, model: keras.Model) -> OptimizerState:
        """The state of the optimizer of `model`.

        Args:
            model: compiled, with an optimizer that has been built.

        Returns:
            Step count and slots, copied.

        Raises:
            TrainingError: the model is not compiled, or its optimizer has no slots yet.
        """
        optimizer = _optimizer_of(model)
        if not optimizer.built:
            raise TrainingError(f"expected an optimizer with a state, received {optimizer.name} before its first step")
        variables = optimizer.variables
        return cls(type(optimizer).__name__, _without_rate([(one.name, one.numpy()) for one in variables]))

    @property
    def fingerprint(self) -> str:
        """Hash of everything."""
        digest = hashlib.sha256(json.dumps(_form(self.kind, self.values)).encode())
        for _, value in self.values:
            digest.update(np.ascontiguousarray(value).tobytes())
        return digest.hexdigest()

    def assign_to(self, optimizer: keras.optimizers.Optimizer) -> None:
        """Bring a built optimizer to this state.

        Args:
            optimizer: is changed.

        Raises:
            TrainingError: it is of another class, or was built for other variables.
        """
        variables = _without_rate([(one.name, one) for one in optimizer.variables])
        expected, received = _form(type(optimizer).__name__, variables), _form(self.kind, self.values)
        for wanted, found in zip_longest(expected, received, fillvalue="nothing more"):
            if wanted != found:
                raise TrainingError(
                    f"expected the state of an optimizer with {wanted}, received one with {found}: take the optimizer "
                    "that the network was trained with, or start with a fresh state"
                )
        for (_, variable), (_, value) in zip(variables, self.values, strict=True):
            variable.assign(value)


def load_optimizer(directory: Path, model: keras.Model) -> None:
    """Give the optimizer of a model from a file the state in which the run that made the model left its own.

    Model files hold weights alone; the state is in the checkpoint of the run.

    Args:
        directory: `checkpoint_dir` of the run.
        model: what the run returned, compiled with an optimizer like the run's (`Recipe.new_optimizer`). Its weights
            are compared and stay, and so does its learning rate.

    Raises:
        TrainingError: no checkpoint, a damaged one, one of another network or of another optimizer, or a model that is
            not compiled.

    Example:
        model = load_ggcnn("trained.hdf5")
        model.compile(recipe.new_optimizer(steps_per_epoch))
        load_optimizer(Path("trained.hdf5.training"), model)
        child = apply_operations(model, "wider(3)", carry_optimizer=True)
    """
    path = directory / FILE_NAME
    if not path.exists():
        raise TrainingError(
            f"expected the checkpoint of the run that trained the network, found no {path}: name the checkpoint folder "
            "of that run"
        )
    optimizer = _optimizer_of(model)
    facts, arrays = _read(path)
    variables = _variables_of_layers(model)
    weights = {id(weight) for weight in model.weights}  # a model file has no states of random layers
    if len(arrays) < len(variables) or not all(
        np.array_equal(variable.numpy(), array)
        for variable, array in zip(variables, arrays, strict=False)
        if id(variable) in weights
    ):
        raise TrainingError(
            f"expected the checkpoint of the run that trained the network in {path}, received one of other weights: "
            "name the checkpoint folder of that run"
        )
    if not optimizer.built:
        optimizer.build(model.trainable_variables)
    values = zip(facts["optimizer"]["variables"], arrays[len(variables) :], strict=True)
    OptimizerState(facts["optimizer"]["kind"], _without_rate(values)).assign_to(optimizer)


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
    return _variables_of_layers(model) + list(model.optimizer.variables)


def _variables_of_layers(model: keras.Model) -> list[Any]:
    return [variable for layer in model.layers for variable in layer.variables]


def _optimizer_of(model: keras.Model) -> keras.optimizers.Optimizer:
    optimizer = getattr(model, "optimizer", None)
    if optimizer is None:
        raise TrainingError(
            "expected a model with an optimizer, received one that is not compiled: compile it with that of its recipe "
            "(Recipe.new_optimizer)"
        )
    return optimizer


def _without_rate(values: Iterable[tuple[str, Any]]) -> tuple[tuple[str, Any], ...]:
    return tuple((name, value) for name, value in values if name != "learning_rate")


def _form(kind: str, values: Iterable[tuple[str, Any]]) -> list[str]:
    """What two optimizers must have in common to exchange their states: class, names and shapes of variables."""
    return [kind, *(f"{name} of shape {tuple(value.shape)}" for name, value in values)]


def _read(path: Path) -> tuple[dict[str, Any], list[npt.NDArray[Any]]]:
    """Facts and arrays of a checkpoint.

    Raises:
        TrainingError: it is damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            facts: dict[str, Any] = json.loads(str(file["facts"]))
            return facts, [file[f"arr_{number}"] for number in range(len(file.files) - 1)]
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise TrainingError(f"cannot read {path}: {error}; delete it to start afresh") from error
