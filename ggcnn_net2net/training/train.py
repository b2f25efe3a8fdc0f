"""Train a GG-CNN: `train(model, data, recipe)`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.net2net.history import history_of, set_history
from ggcnn_net2net.training.checkpoint import (
    History,
    OptimizerState,
    fingerprint_of,
    load_checkpoint,
    save_checkpoint,
)
from ggcnn_net2net.training.data import TrainingData, batches_of_epoch, read_ahead
from ggcnn_net2net.training.distillation import Distilled
from ggcnn_net2net.training.losses import losses_of
from ggcnn_net2net.training.recipe import Recipe
from ggcnn_net2net.training.step import Evaluation, Step, step_and_loss

if TYPE_CHECKING:
    import keras

OnProgress = Callable[[int, int, int, float], None]
"""Called after every step with epoch (from 0), steps done and steps of this epoch, and the mean loss so far."""


@dataclass(frozen=True)
class TrainingResult:
    """What `train` returns."""

    model: keras.Model
    """The trained network, compiled with its optimizer."""

    history: History
    """One dict an epoch: epoch (from 0), loss, pos_out_loss ... width_out_loss, the same with `val_` in front where
    there is validation data, learning_rate of its first step, seconds."""


def train(
    model: keras.Model,
    data: TrainingData,
    recipe: Recipe,
    *,
    validation: TrainingData | None = None,
    checkpoint_dir: str | Path | None = None,
    callbacks: Sequence[keras.callbacks.Callback] = (),
    on_progress: OnProgress | None = None,
    resume: bool = True,
    carry_optimizer: bool = False,
) -> TrainingResult:
    """Train a copy of a GG-CNN.

    The result is a function of the arguments and the number of threads, bit for bit, interrupted or not.

    Args:
        model: the network to start from; it is not changed.
        data: images to train on.
        recipe: settings.
        validation: images whose loss is reported after every epoch.
        checkpoint_dir: folder for the state after each epoch; None keeps none.
        callbacks: Keras callbacks, called at the beginning and end of training, epochs and steps. Their own state is
            not part of a checkpoint.
        on_progress: called after every step.
        resume: go on from the checkpoint, if there is one; False starts afresh and overwrites it.
        carry_optimizer: start with the state of the optimizer that `model` is compiled with, as surgery with
            `carry_optimizer=True` leaves it, instead of a fresh one, with which the paper's children start. It must be
            an optimizer like the recipe's. Learning rate and schedule stay the recipe's; a schedule counts the steps
            of this run alone.

    Returns:
        The trained network, with the operation history of `model`, and the losses.

    Raises:
        TrainingError: data that does not fit, a checkpoint of another run, a loss that is not finite, or no state of
            such an optimizer to carry over.
    """
    import keras

    if recipe.protocol.masked_loss and any(isinstance(images, Distilled) for images in (data, validation)):
        raise TrainingError(
            "expected a protocol with masked_loss=False for distillation, received masked_loss=True, which masks by "
            "the quality of labels and not of a teacher: use dataclasses.replace(protocol, masked_loss=False)"
        )
    trained = _copy(model)
    _seed_random_layers(trained, recipe.seed)
    n_steps = len(_batches(recipe, data, 0))
    trained.compile(optimizer=recipe.new_optimizer(n_steps), jit_compile=False)
    trained.optimizer.build(trained.trainable_variables)
    run = {"recipe": recipe.fingerprint, "data": data.fingerprint, "network": fingerprint_of(model)}
    if carry_optimizer:
        run["optimizer state"] = _carry_optimizer(model, trained)
    history: History = []
    if checkpoint_dir is not None and resume:
        history = load_checkpoint(Path(checkpoint_dir), trained, run)
    if len(history) > recipe.epochs:
        raise TrainingError(
            f"expected a checkpoint of at most {recipe.epochs} epochs in {checkpoint_dir}, received one of "
            f"{len(history)}: ask for more epochs, or name another checkpoint folder"
        )
    step, evaluate = step_and_loss(trained, losses_of(recipe.protocol))
    hooks = keras.callbacks.CallbackList(list(callbacks), model=trained, epochs=recipe.epochs, steps=n_steps, verbose=0)
    trained.stop_training = False
    hooks.on_train_begin()
    for epoch in range(len(history), recipe.epochs):
        hooks.on_epoch_begin(epoch)
        started = time.monotonic()
        rate = float(trained.optimizer.learning_rate)
        entry = _run_epoch(trained, data, recipe, epoch, step, hooks, on_progress)
        if validation is not None:
            entry |= {f"val_{name}": loss for name, loss in _validate(trained, validation, recipe, evaluate).items()}
        hooks.on_epoch_end(epoch, dict(entry))
        seconds = time.monotonic() - started
        history.append({"epoch": epoch, **entry, "learning_rate": rate, "seconds": seconds})
        if checkpoint_dir is not None:
            save_checkpoint(Path(checkpoint_dir), trained, run, history)
        if trained.stop_training:
            break
    hooks.on_train_end()
    return TrainingResult(trained, history)


def _copy(model: keras.Model) -> keras.Model:
    import keras

    copied = keras.models.clone_model(model)
    for layer, original in zip(copied.layers, model.layers, strict=True):
        for variable, value in zip(layer.variables, original.variables, strict=True):
            variable.assign(value)
    set_history(copied, history_of(model))
    return copied


def _seed_random_layers(model: keras.Model, seed: int) -> None:
    """Start dropout and noise from the seed of the run: Keras draws their state anew whenever a model is built."""
    for number, layer in enumerate(model.layers):
        weights = {id(weight) for weight in layer.weights}
        for variable in layer.variables:
            if id(variable) not in weights:
                # Keras counts the second one up with every batch; neighbouring layers must not follow each other.
                variable.assign([np.random.SeedSequence((seed, number)).generate_state(1)[0], 0])


def _carry_optimizer(model: keras.Model, trained: keras.Model) -> str:
    """Start the optimizer of `trained` with the state of that of `model`.

    Returns:
        Hash of the state.
    """
    state = OptimizerState.of(model)
    state.assign_to(trained.optimizer)
    step_count, *others = trained.optimizer.variables
    if all(variable.name != "learning_rate" for variable in others):  # then it has a schedule
        step_count.assign(0)
    return state.fingerprint


def _batches(recipe: Recipe, data: TrainingData, epoch: int) -> list[list[int]]:
    return batches_of_epoch(
        len(data),
        recipe.batch_size,
        epoch,
        seed=recipe.seed,
        shuffled_rows=recipe.protocol.shuffled_rows,
        budget=recipe.images_per_epoch,
    )


def _run_epoch(
    model: keras.Model,
    data: TrainingData,
    recipe: Recipe,
    epoch: int,
    step: Step,
    hooks: keras.callbacks.CallbackList,
    on_progress: OnProgress | None,
) -> dict[str, float]:
    """Take all steps of one epoch.

    Returns:
        The mean losses by name.

    Raises:
        TrainingError: a loss or a gradient that is not finite.
    """
    batches = _batches(recipe, data, epoch)
    total = np.zeros(len(HEADS))
    with closing(read_ahead(data, batches, epoch)) as reader:
        for number, (inputs, targets) in enumerate(reader):
            _check_batch(model, inputs, targets)
            hooks.on_train_batch_begin(number)
            losses, gradient_norm = (value.numpy() for value in step(inputs, targets))
            # relu turns NaN into 0, so a network full of NaN still has a finite loss.
            if not np.isfinite([*losses, gradient_norm]).all():
                raise TrainingError(
                    f"expected a finite loss and gradient, received a loss of {losses.sum()} and a gradient of norm "
                    f"{gradient_norm} in epoch {epoch}, step {number}, at learning rate "
                    f"{float(model.optimizer.learning_rate):.3g}: lower the learning rate, or look for NaN in the data"
                )
            total += losses
            mean = total / (number + 1)
            hooks.on_train_batch_end(number, _named(mean))
            if on_progress is not None:
                on_progress(epoch, number + 1, len(batches), float(mean.sum()))
    return _named(total / len(batches))


def mean_loss(model: keras.Model, data: TrainingData, recipe: Recipe) -> float:
    """The loss of a network, summed over the heads and averaged over all images (of epoch 0).

    With `masked_loss` a batch's loss is a mean over its labelled pixels, and the mean here is one of batches by their
    images: it depends a little on the batch size.

    Args:
        model: a GG-CNN; need not be compiled.
        data: images and targets.
        recipe: its protocol chooses the loss, its batch size how many images are computed at once.

    Returns:
        The loss that `train` reports as `val_loss`.

    Raises:
        TrainingError: data that does not fit.
    """
    _, evaluate = step_and_loss(model, losses_of(recipe.protocol))
    return _validate(model, data, recipe, evaluate)["loss"]


def _validate(model: keras.Model, data: TrainingData, recipe: Recipe, evaluate: Evaluation) -> dict[str, float]:
    """Mean losses by name over all images, in batches; the images of epoch 0."""
    if not len(data):
        raise TrainingError("expected images to compute the loss of, received a split without any")
    total = np.zeros(len(HEADS))
    rows = range(len(data))
    batches = [rows[start : start + recipe.batch_size] for start in rows[:: recipe.batch_size]]
    with closing(read_ahead(data, batches, epoch=0)) as reader:
        for inputs, targets in reader:
            _check_batch(model, inputs, targets)
            total += len(inputs) * evaluate(inputs, targets).numpy()
    return _named(total / len(data))


def _named(losses: npt.NDArray[np.floating]) -> dict[str, float]:
    return {
        "loss": float(losses.sum()),
        **{f"{name}_loss": float(loss) for name, loss in zip(HEADS, losses, strict=True)},
    }


def _check_batch(model: keras.Model, inputs: npt.NDArray[np.float32], targets: npt.NDArray[np.float32]) -> None:
    height, width = model.inputs[0].shape[1:3]
    expected = (len(inputs), height or inputs.shape[1], width or inputs.shape[2])
    if inputs.shape != (*expected, 1) or targets.shape != (*expected, len(HEADS)):
        raise TrainingError(
            f"expected inputs of shape {(*expected, 1)} and targets of shape {(*expected, len(HEADS))}, received "
            f"{inputs.shape} and {targets.shape}: make the data for the input size of the network"
        )
