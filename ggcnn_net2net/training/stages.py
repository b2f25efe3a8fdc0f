"""Training of a network that is grown on the way: an operation, some epochs, the next operation, some epochs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ggcnn_net2net import atomic
from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.model_files.save import save_ggcnn
from ggcnn_net2net.net2net import Operation, apply_operations
from ggcnn_net2net.training.checkpoint import FILE_NAME, History, epochs_done
from ggcnn_net2net.training.data import Batch, TrainingData
from ggcnn_net2net.training.recipe import Recipe
from ggcnn_net2net.training.report import columns_of, series_of
from ggcnn_net2net.training.train import OnProgress, TrainingResult, train

if TYPE_CHECKING:
    import keras

MODEL_FILE = "model.hdf5"


@dataclass(frozen=True)
class Stage:
    """An operation and the training after it."""

    operation: Operation | None
    """None leaves the network as it is."""

    recipe: Recipe
    """Of this stage alone; its seed is that of *wider*, too."""

    def as_dict(self) -> dict[str, Any]:
        """What differs from stage to stage, as plain JSON values."""
        return {
            "operation": None if self.operation is None else str(self.operation),
            "seed": self.recipe.seed,
            "epochs": self.recipe.epochs,
            "learning_rate_schedule": self.recipe.learning_rate_schedule,
        }


def stages_of(recipe: Recipe, operations: Sequence[Operation | None], final_epochs: int = 0) -> list[Stage]:
    """The stages of a training, one for each operation.

    Args:
        recipe: `epochs` are those of a stage. A learning rate schedule is that of the last stage, the ones before keep
            their learning rate: each goes on from weights that are still to change, and only the last is a result.
        operations: None stands for a stage without surgery.
        final_epochs: extra epochs of the last stage.

    Returns:
        The stages. The first has the seed of `recipe`, the others have seeds derived from it and their number. A single
        stage without `final_epochs` has `recipe` itself.

    Raises:
        TrainingError: no operations, or negative `final_epochs`.
    """
    if not operations or final_epochs < 0:
        raise TrainingError(
            f"expected one operation or more and 0 or more final epochs, received {len(operations)} and {final_epochs}"
        )
    last = len(operations) - 1
    return [
        Stage(
            operation,
            replace(
                recipe,
                seed=_seed(recipe.seed, number),
                epochs=recipe.epochs + (final_epochs if number == last else 0),
                learning_rate_schedule=recipe.learning_rate_schedule if number == last else None,
            ),
        )
        for number, operation in enumerate(operations)
    ]


def _seed(seed: int, stage: int) -> int:
    return int(np.random.SeedSequence((seed, stage)).generate_state(1)[0]) if stage else seed


def train_stages(
    model: keras.Model,
    data: TrainingData,
    recipe: Recipe,
    operations: Sequence[Operation | None],
    final_epochs: int = 0,
    *,
    validation: TrainingData | None = None,
    checkpoint_dir: str | Path | None = None,
    on_progress: OnProgress | None = None,
    resume: bool = True,
) -> TrainingResult:
    """Grow and train a GG-CNN by turns, as the paper made its Extended and Optimized networks (section III).

    Each stage applies its operation, *wider* with `recipe.protocol.wider_noise`, and trains with a fresh optimizer, as
    in the paper. `[None] * n` is the control of n operations: the same training without surgery. `[None]` is `train`.
    The result is a function of the arguments and the number of threads, bit for bit, interrupted or not.

    Args:
        model: the network to start from; it is not changed.
        data: images to train on. Their epochs are counted through all stages, so that images that are made afresh for
            every epoch are not those of the stage before.
        recipe: settings; `stages_of` says how they become those of the stages.
        operations: one for each stage; None stands for a stage without surgery.
        final_epochs: extra epochs of the last stage.
        validation: images whose loss is reported after every epoch.
        checkpoint_dir: folder for the state after each epoch; None keeps none. Stage i, from 0, has its own inside,
            `stage_i`, which also takes the network that the stage ends with, `model.hdf5`. `[None]` uses the folder
            itself, like `train`.
        on_progress: called after every step; epochs are counted through all stages.
        resume: go on from the checkpoints, if there are some; False starts afresh and overwrites them.

    Returns:
        The network after the last stage, with the operations in its history, and the losses of all stages. Each of
        their entries also has its stage, from 0, unless `operations` is `[None]`; epochs are counted through all.

    Raises:
        SurgeryError: an operation that cannot be applied, before any training.
        TrainingError: no operations, more epochs for a stage after which another has begun, or what `train` raises.
    """
    stages = stages_of(recipe, operations, final_epochs)
    noise = recipe.protocol.wider_noise
    apply_operations(model, [one for one in operations if one is not None], noise=noise)  # a wrong one shows at once
    staged = is_staged(operations)
    if staged and checkpoint_dir is not None:
        folders = [stage_dir(checkpoint_dir, number) for number in range(len(stages))]
        if resume:
            _check_begun(folders, stages)
        else:  # also of the later stages, which would be found again if this run were interrupted
            for begun in folders:
                (begun / FILE_NAME).unlink(missing_ok=True)
    history: History = []
    for number, stage in enumerate(stages):
        if stage.operation is not None:
            model = apply_operations(model, [stage.operation], stage.recipe.seed, noise)
        folder = stage_dir(checkpoint_dir, number) if staged and checkpoint_dir is not None else checkpoint_dir
        first = len(history)
        # A stage that is done returns from its last checkpoint, without a step.
        result = train(
            model,
            _LaterEpochs(data, first) if first else data,
            stage.recipe,
            validation=validation,
            checkpoint_dir=folder,
            on_progress=_counted_from(first, on_progress),
            resume=resume,
        )
        model = result.model
        if not staged:
            return result
        history += [{"stage": number, **entry, "epoch": first + entry["epoch"]} for entry in result.history]
        if folder is not None:
            save_ggcnn(model, Path(folder) / MODEL_FILE)
    return TrainingResult(model, history)


def _check_begun(folders: Sequence[Path], stages: Sequence[Stage]) -> None:
    """Refuse more epochs for a stage after which another has begun: that one started from another network."""
    done = [epochs_done(folder) for folder in folders]
    for number, (stage, own, following) in enumerate(zip(stages, done, done[1:], strict=False)):
        if following and own < stage.recipe.epochs:
            raise TrainingError(
                f"expected stage {number} with the {own} epochs that it had in {folders[number]} before the next one "
                f"began, received {stage.recipe.epochs}: only the last stage can go on, with more final epochs; name "
                "another checkpoint folder, or start afresh"
            )


def is_staged(operations: Sequence[Operation | None]) -> bool:
    """Whether this is more than a plain `train`."""
    return list(operations) != [None]


def stage_dir(checkpoint_dir: str | Path, number: int) -> Path:
    """Where a stage, from 0, puts its state after each epoch and the network it ends with."""
    return Path(checkpoint_dir) / f"stage_{number}"


@dataclass(frozen=True)
class _LaterEpochs:
    """Data whose epochs are counted from a later one."""

    data: TrainingData
    first: int

    @property
    def fingerprint(self) -> str:
        return self.data.fingerprint

    def __len__(self) -> int:
        return len(self.data)

    def batch(self, rows: Sequence[int], epoch: int) -> Batch:
        return self.data.batch(rows, self.first + epoch)


def _counted_from(first: int, on_progress: OnProgress | None) -> OnProgress | None:
    if on_progress is None:
        return None
    return lambda epoch, step, steps, loss: on_progress(first + epoch, step, steps, loss)


def write_stage_curves(history: History, stages: Sequence[Stage], path: Path, title: str) -> None:
    """Write a picture of the loss over the epochs of all stages, with a line where each begins.

    Args:
        history: of `train_stages`.
        stages: of `stages_of`, for the names of the operations.
        path: picture to write; its suffix is the format.
        title: stands above.
    """
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(10, 4), layout="constrained")
    axes = figure.subplots()
    epochs = [entry["epoch"] + 1 for entry in history]
    for name, label, style in (("loss", "training", "-"), ("val_loss", "validation", "--")):
        if name in columns_of(history):
            axes.plot(epochs, series_of(history, name), style, marker=".", color="C0", label=label)
    begins: dict[int, float] = {}
    for entry in history:
        begins.setdefault(entry["stage"], entry["epoch"] + 0.5)
    names = [str(stages[number].operation or "no surgery") for number in begins]
    for begin in begins.values():
        axes.axvline(begin, color="C1", linewidth=1)
    axes.secondary_xaxis("top").set_xticks(list(begins.values()), names, rotation=20, ha="left", color="C1")
    axes.set_xlabel("epoch")
    axes.set_ylabel("loss")
    axes.set_yscale("log")
    axes.legend()
    figure.suptitle(title, parse_math=False)
    with atomic.replacing(path) as temporary:
        figure.savefig(temporary, dpi=120)
