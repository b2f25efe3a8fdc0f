"""`ggcnn-net2net train`: train a network on grasp data."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ggcnn_net2net.cli.networks import file_of, keep_record, made_by, note_other_loss, open_network
from ggcnn_net2net.cli.options import DISTIL_WEIGHT, PROTOCOL, OutputFile, OutputFolder, command_line, taught
from ggcnn_net2net.versions import versions

if TYPE_CHECKING:
    from rich.table import Table

    from ggcnn_net2net.datasets.build import FreshAugmentations
    from ggcnn_net2net.datasets.hdf5 import GraspDataset
    from ggcnn_net2net.training import Recipe, TrainingResult
    from ggcnn_net2net.training.stages import Stage
    from ggcnn_net2net.training.train import OnProgress

_SHOWN = 10  # epochs of the final table
POSITIVE = click.IntRange(min=1)


@click.command("train")
@click.argument("network")
@click.argument("dataset", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=OutputFile(), help="Model to write.")
@click.option("--epochs", default=30, show_default=True, type=POSITIVE, help="Epochs per stage.")
@click.option("--ops", help='Grow on the way: operations in order ("deeper(3), wider(3)"), each with a stage after it.')
@click.option("--repeat", default=1, show_default=True, type=POSITIVE, help="Stages if there is no --ops.")
@click.option(
    "--final-epochs", default=0, show_default=True, type=click.IntRange(min=0), help="Added to the last stage."
)
@click.option("--batch-size", default=4, show_default=True, type=POSITIVE, help="Images a step.")
@PROTOCOL
@click.option("--optimizer", default="rmsprop-keras2", show_default=True, help="The paper's, or a name Keras knows.")
@click.option("--learning-rate", default=1e-3, show_default=True, type=click.FloatRange(0, min_open=True))
@click.option(
    "--schedule",
    type=click.Choice(["cosine"]),
    help="Let the learning rate fall to 0, in the last stage. [default: constant]",
)
@click.option("--images-per-epoch", type=POSITIVE, help="Images of an epoch. [default: all]")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of new weights and the order.")
@click.option("--threads", default=os.cpu_count() or 1, show_default="number of cores", type=POSITIVE)
@click.option(
    "--validation/--no-validation", default=True, show_default=True, help="Report the loss on the test split."
)
@click.option("--checkpoint-dir", type=OutputFolder(), help="[default: OUTPUT.training]")
@click.option("--restart", is_flag=True, help="Start from epoch 1 even if there is a checkpoint.")
@click.option(
    "--fresh-from",
    "scenes",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Raw folder that DATASET was built from: draw new augmentations of its scenes in every epoch. Reads more.",
)
@click.option(
    "--distil",
    is_eager=True,
    metavar="TEACHER",
    help="Learn the maps of this network, too: a file, published, zoo:NAME.",
)
@DISTIL_WEIGHT
def train_command(
    network: str,
    dataset: Path,
    output: Path,
    epochs: int,
    ops: str | None,
    repeat: int,
    final_epochs: int,
    batch_size: int,
    protocol_name: str,
    optimizer: str,
    learning_rate: float,
    schedule: str | None,
    images_per_epoch: int | None,
    seed: int,
    threads: int,
    validation: bool,
    checkpoint_dir: Path | None,
    restart: bool,
    scenes: Path | None,
    distil: str | None,
    distil_weight: float,
) -> None:
    """Train NETWORK on the "train" split of DATASET, an HDF5 file of `dataset build`.

    NETWORK is an architecture (C9x9x8_T9x9x8, or original, extended, optimized, narrow, shallow), which starts with new
    weights, or a model file, "published" or "zoo:NAME", which goes on from its own. The protocol chooses the loss and
    the order of the images. Beside the model come its losses (.csv, .png) and what made it (.json). The same command
    goes on where an interrupted one stopped; the same seed and threads give the same weights.

    With --ops the network is grown on the way. --repeat of as many stages is the control: the same training, with an
    optimizer that starts afresh as often, and no surgery.

    \b
    Example: ggcnn-net2net train original cornell.h5 -o cornell.hdf5 --epochs 30 --protocol corrected
             ggcnn-net2net train published cornell.h5 -o extended.hdf5 --epochs 2 --final-epochs 8 \\
                 --ops "deeper(3), deeper(4), wider(3), deeper(3)"
    """
    from rich.console import Console

    from ggcnn_net2net.datasets.hdf5 import GraspDataset  # --help must not load what the work needs
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.model_files.load import opened_name, source_path
    from ggcnn_net2net.model_files.save import check_writable, save_ggcnn
    from ggcnn_net2net.net2net import parse_operations
    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reference_data import sha256_of
    from ggcnn_net2net.training import Recipe, set_threads
    from ggcnn_net2net.training.distillation import Distilled
    from ggcnn_net2net.training.stages import is_staged, stages_of, train_stages

    if ops is not None and repeat > 1:
        raise click.UsageError("expected --ops or --repeat, received both: the operations are the stages")
    operations = [None] * repeat if ops is None else parse_operations(ops)
    source, teacher = file_of(network), None if distil is None else source_path(distil)
    check_writable(output, dataset, source, teacher)
    for read in (network, distil):
        keep_record(output, read)
    stored = GraspDataset(dataset, "train")
    data = stored if scenes is None else _fresh_augmentations(stored, scenes)
    protocol = protocol_named(protocol_name)
    recipe = Recipe(
        epochs=epochs,
        batch_size=batch_size,
        optimizer=optimizer,
        learning_rate=learning_rate,
        learning_rate_schedule=schedule,
        images_per_epoch=images_per_epoch,
        seed=seed,
        protocol=protocol if distil is None else taught(protocol),
    )
    stages = stages_of(recipe, operations, final_epochs)
    import_tensorflow()
    set_threads(threads)
    model, name = open_network(network, stored.shape[0], seed)
    if teacher is None:
        note_other_loss(name, protocol)
    earlier = made_by(network)
    checkpoint_dir = checkpoint_dir or Path(f"{output}.training")
    console = Console()
    try:
        with _progress(sum(stage.recipe.epochs for stage in stages), batch_size, console) as on_progress:
            result = train_stages(
                model,
                data if teacher is None else Distilled(data, load_ggcnn(teacher), distil_weight),
                recipe,
                operations,
                final_epochs,
                validation=GraspDataset(dataset, "test") if validation else None,
                checkpoint_dir=checkpoint_dir,
                on_progress=on_progress,
                resume=not restart,
            )
    except KeyboardInterrupt:
        command = f"the same command{' without --restart' if restart else ''}"
        click.echo(f"Finished epochs are kept in {checkpoint_dir}: {command} goes on from there.", err=True)
        raise
    save_ggcnn(result.model, output)
    facts = {"network": name, "threads": threads, "fresh_augmentations": scenes is not None}
    if distil is not None and teacher is not None:
        facts["teacher"] = {
            "network": opened_name(distil, teacher),
            "sha256": sha256_of(teacher),
            "weight": distil_weight,
        }
    if earlier is not None:
        facts["network_made_by"] = earlier
    staged = is_staged(operations)
    _write_records(output, result, recipe if staged else stages[0].recipe, stored, facts, stages if staged else [])
    console.print(_table(result))
    click.echo(f"written to {output}, with .csv, .png and .json beside it")


def _fresh_augmentations(stored: GraspDataset, folder: Path) -> FreshAugmentations:
    """New samples of the scenes in a dataset, with its augmentation and seed; epoch 0 is what the dataset holds."""
    import numpy as np

    from ggcnn_net2net.datasets.augmentation import Augmentation
    from ggcnn_net2net.datasets.build import FreshAugmentations
    from ggcnn_net2net.datasets.raw import open_scenes
    from ggcnn_net2net.errors import DatasetError

    names = set(stored.image_ids)
    found = open_scenes(folder, depth=stored.attributes.get("depth", "perfect")).only(names)
    settings = stored.attributes.get("augmentation")
    if not settings:
        raise DatasetError(
            f"expected a file of `dataset build`, which holds how its samples were drawn, received {stored.path} "
            "without: leave --fresh-from out, or build the file anew"
        )
    if len(found) != len(names):
        raise DatasetError(
            f"expected {stored.path} to be made by `dataset build` of {folder}, received one of {len(names)} scenes, "
            f"{len(found)} of which are in the folder"
        )
    fresh = FreshAugmentations(found, Augmentation.from_dict(settings), stored.attributes["seed"])
    for row in (0, len(fresh) - 1):  # other folders may have scenes of the same names
        if not np.allclose(fresh.sample(row).depth, stored.depth(row), atol=1e-4):
            raise DatasetError(
                f"expected {stored.path} to be made by `dataset build` of {folder}, received one of other scenes with "
                f"the same names: the depth of {stored.image_ids[row]} differs"
            )
    return fresh


@contextmanager
def _progress(epochs: int, batch_size: int, console: Any) -> Iterator[OnProgress]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[speed]}"),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("starting", total=None, speed="")
        started, images = time.monotonic(), 0

        def show(epoch: int, step: int, steps: int, loss: float) -> None:
            nonlocal images
            images += batch_size
            progress.update(
                task,
                total=epochs * steps,
                completed=epoch * steps + step,
                description=f"epoch {epoch + 1}/{epochs}, loss {loss:.5f}",
                speed=f"{images / (time.monotonic() - started):.1f} images/s",
            )

        yield show


def _write_records(
    output: Path,
    result: TrainingResult,
    recipe: Recipe,
    data: GraspDataset,
    facts: dict[str, Any],
    stages: Sequence[Stage],
) -> None:
    """Write losses as CSV and PNG, and the provenance as JSON, beside the model; `stages` is empty for a plain run."""
    import json

    from ggcnn_net2net.atomic import write_text
    from ggcnn_net2net.reference_data import sha256_of
    from ggcnn_net2net.training.report import write_curves, write_history
    from ggcnn_net2net.training.stages import write_stage_curves

    provenance = {
        "command": command_line(),
        **facts,
        "recipe": recipe.as_dict(),
        **(_growth(output, recipe, stages) if stages else {}),
        "data": {"file": data.path.name, "images": len(data), "sha256": data.fingerprint, "made_by": data.attributes},
        "parameters": result.model.count_params(),
        "model_sha256": sha256_of(output),
        "last_epoch": result.history[-1],
        "versions": versions(),
    }
    write_text(output.with_suffix(".json"), json.dumps(provenance, indent=2) + "\n")
    write_history(result.history, output.with_suffix(".csv"))
    picture, title = output.with_suffix(".png"), f"{facts['network']} on {data.path.name}"
    if stages:
        write_stage_curves(result.history, stages, picture, title)
    else:
        write_curves(result.history, picture, title)


def _growth(output: Path, recipe: Recipe, stages: Sequence[Stage]) -> dict[str, Any]:
    """What became of the network on the way."""
    from ggcnn_net2net.model_files.summary import model_summary

    summary = model_summary(output)
    return {
        "stages": [stage.as_dict() for stage in stages],
        "wider_noise": recipe.protocol.wider_noise,
        "operations": summary.history,  # with those before this run
        "architecture": summary.architecture,
    }


def _table(result: TrainingResult) -> Table:
    from rich.table import Table

    from ggcnn_net2net.training.report import columns_of

    columns = [name for name in columns_of(result.history) if name in ("loss", "val_loss", "learning_rate", "seconds")]
    table = Table("epoch", *columns)
    for entry in result.history[-_SHOWN:]:
        table.add_row(str(entry["epoch"] + 1), *(f"{entry[name]:.4g}" if name in entry else "" for name in columns))
    return table
