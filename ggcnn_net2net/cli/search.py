"""`ggcnn-net2net search`: beam search over surgeries, resuming it, its report."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ggcnn_net2net.cli.networks import note_other_loss, open_network
from ggcnn_net2net.cli.options import DISTIL_WEIGHT, PROTOCOL, command_line, taught

if TYPE_CHECKING:
    from ggcnn_net2net.parallel import Workers
    from ggcnn_net2net.search.history import SearchHistory
    from ggcnn_net2net.search.settings import SearchSettings

POSITIVE = click.IntRange(min=1)
SEARCH_FOLDER = click.Path(path_type=Path, exists=True, file_okay=False)
WORKERS = click.option("--workers", type=POSITIVE, help="Worker processes. [default: one per core]")
SCHEDULER = click.option(
    "--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786, whose workers train candidates."
)


class RunByDefault(click.Group):
    """A group whose command `run` needs not be named."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put `run` in front of arguments that name no command."""
        if args and args[0] not in {*self.commands, *ctx.help_option_names}:
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group("search", cls=RunByDefault)
def search_command() -> None:
    """Search for a better network: grow it step by step, train every candidate, keep the best.

    \b
    ggcnn-net2net search MODEL DATASET -o DIR [OPTIONS]   the same as `search run`, see `search run --help`
    ggcnn-net2net search resume DIR                       go on after an interruption
    ggcnn-net2net search report DIR                       tables and pictures, during a search and after it

    \b
    Example: ggcnn-net2net search published simulated.h5 -o search --budget quick --protocol corrected
    """


@search_command.command()
@click.argument("model")
@click.argument("dataset", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", "directory", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder."
)
@click.option("--beam", "width", default=3, show_default=True, type=POSITIVE, help="Width of the beam, in networks.")
@click.option("--depth", default=5, show_default=True, type=POSITIVE, help="Operations one after the other.")
@click.option("--epochs", default=2, show_default=True, type=POSITIVE, help="Of training each candidate.")
@click.option(
    "--retrain", default=0, show_default=True, type=click.IntRange(min=0), help="Extra epochs for what is committed to."
)
@click.option("--transpose", is_flag=True, help="Change transposed convolutions, too.")
@click.option("--lookahead/--no-lookahead", default=True, show_default=True, help="Commit to one level at a time.")
@click.option(
    "--budget",
    default="standard",
    show_default=True,
    type=click.Choice(["quick", "short", "standard", "paper"]),
    help="Images of an epoch and for a score: 25 and 40, 100 each, 1,500 and 500, all. Minutes to days.",
)
@click.option("--images-per-epoch", type=POSITIVE, help="[default: of the budget]")
@click.option("--score-images", type=POSITIVE, help="Images of the test split that score. [default: of the budget]")
@click.option(
    "--heuristic",
    default="iou",
    show_default=True,
    type=click.Choice(["iou", "loss", "sim"]),
    help="IoU rate on the test split, loss on it, or success rate in simulation.",
)
@click.option("--sim-objects", default="training:40:1", show_default=True, metavar="SET", help='Objects of "sim".')
@click.option("--sim-poses", default=1, show_default=True, type=POSITIVE, help="Poses of each of them.")
@click.option("--max-params", type=POSITIVE, help="Consider no larger networks.")
@click.option("--patience", type=POSITIVE, help="Stop after this many commitments without a better score.")
@click.option("--batch-size", default=4, show_default=True, type=POSITIVE, help="Images a step.")
@click.option("--optimizer", default="rmsprop-keras2", show_default=True, help="The paper's, or a name Keras knows.")
@click.option("--learning-rate", default=1e-3, show_default=True, type=click.FloatRange(0, min_open=True))
@PROTOCOL
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of every random choice.")
@WORKERS
@click.option("--threads", type=POSITIVE, help="Of each worker. [default: cores / workers; 1 with --scheduler]")
@SCHEDULER
@click.option("--max-failures", default=5, show_default=True, type=POSITIVE, help="In a row, at which to stop.")
@click.option("--halving", is_flag=True, help="Beyond the paper: stop the worse half of a level's children early.")
@click.option("--replicates", default=1, show_default=True, type=POSITIVE, help="Beyond the paper: mean of N seeds.")
@click.option("--wider-noise", type=click.FloatRange(0), help="Beyond the paper: unequal copies. [default: protocol's]")
@click.option("--carry-optimizer", is_flag=True, help="Beyond the paper: children keep their parent's optimizer state.")
@click.option(
    "--distil",
    is_eager=True,
    metavar="TEACHER",
    help='Beyond the paper: learn from "parent" or from a model file, too.',
)
@DISTIL_WEIGHT
@click.option("--reuse", multiple=True, type=SEARCH_FOLDER, help="Search whose trained candidates to reuse.")
def run(
    model: str,
    dataset: Path,
    directory: Path,
    workers: int | None,
    scheduler: str | None,
    reuse: tuple[Path, ...],
    **options: Any,
) -> None:
    """Search from MODEL, judged on DATASET, an HDF5 file of `dataset build`, and write everything to a folder.

    MODEL is "published", "zoo:NAME", a model file, or an architecture (narrow, C9x9x8_T9x9x8), untrained. The best
    network of the path becomes best.hdf5. Ctrl-C at any time; `search resume` goes on.

    \b
    Example: ggcnn-net2net search published simulated.h5 -o search --protocol corrected --max-params 67644
    """
    from ggcnn_net2net.datasets.hdf5 import GraspDataset  # --help must not load what the work needs
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.search import start_search
    from ggcnn_net2net.search.reuse import differences

    cores = os.cpu_count() or 1
    options["threads"] = options["threads"] or (1 if scheduler else max(1, cores // (workers or cores)))
    settings = _settings(**options)
    size = GraspDataset(dataset, "train").shape[0]
    import_tensorflow()
    network, name = open_network(model, size, settings.seed)
    if settings.distil is None:
        note_other_loss(name, settings.recipe.protocol)
    for other in reuse:
        differing = differences(network, settings, dataset, other)
        if differing:
            click.echo(f"Nothing can be taken from {other}, it differs in {', '.join(differing)}", err=True)
    _watch(
        directory,
        _workers(scheduler, workers, cores),
        lambda pool, on_event: start_search(
            network,
            dataset,
            settings,
            directory,
            pool,
            name=name,
            command=command_line(),
            reuse=reuse,
            on_event=on_event,
        ),
    )


@search_command.command()
@click.argument("directory", type=SEARCH_FOLDER)
@WORKERS
@SCHEDULER
@click.option("--retry-failed", is_flag=True, help="Train candidates again that failed before.")
def resume(directory: Path, workers: int | None, scheduler: str | None, retry_failed: bool) -> None:
    """Go on with the search in DIRECTORY where it stopped. It ends as it would have without the interruption.

    \b
    Example: ggcnn-net2net search resume results/search
    """
    from ggcnn_net2net.search import load_history, resume_search

    threads = load_history(directory).settings.threads
    _watch(
        directory,
        _workers(scheduler, workers, max(1, (os.cpu_count() or 1) // threads)),
        lambda pool, on_event: resume_search(directory, pool, retry_failed=retry_failed, on_event=on_event),
    )


@search_command.command()
@click.argument("directory", type=SEARCH_FOLDER)
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), help="[default: DIRECTORY/report]")
def report(directory: Path, output: Path | None) -> None:
    """Tables and pictures of the search in DIRECTORY, which may still run: all candidates, the path, the tree.

    \b
    Example: ggcnn-net2net search report results/search
    """
    from ggcnn_net2net.search import load_history

    _report(load_history(directory), output or directory / "report")


def _settings(**options: Any) -> SearchSettings:
    """The settings that the options ask for."""
    from dataclasses import replace

    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.search.settings import BUDGETS, SearchSettings
    from ggcnn_net2net.training import Recipe

    budget = BUDGETS[options.pop("budget")]
    protocol = protocol_named(options.pop("protocol_name"))
    noise = options.pop("wider_noise")
    if noise is not None:
        protocol = replace(protocol, wider_noise=noise)
    if options["distil"] is not None:
        protocol = taught(protocol)
    recipe = Recipe(
        **{name: options.pop(name) for name in ("epochs", "batch_size", "optimizer", "learning_rate")},
        images_per_epoch=options.pop("images_per_epoch") or budget.images_per_epoch,
        protocol=protocol,
    )
    options["score_images"] = options["score_images"] or budget.score_images
    return SearchSettings(max_parameters=options.pop("max_params"), recipe=recipe, **options)


def _workers(scheduler: str | None, given: int | None, usual: int) -> AbstractContextManager[Workers]:
    if scheduler is not None and given is not None:
        raise click.UsageError("expected --workers or --scheduler, received both: a cluster has workers of its own")
    if scheduler is None:
        from ggcnn_net2net.parallel import LocalWorkers

        return LocalWorkers(given or usual)
    from ggcnn_net2net.cluster import DaskWorkers

    return DaskWorkers(scheduler)


def _watch(
    directory: Path,
    workers: AbstractContextManager[Workers],
    search: Callable[[Workers, Callable[[dict[str, Any]], None]], SearchHistory],
) -> None:
    """Run a search with its live view, and report on it."""
    from rich.console import Console

    from ggcnn_net2net.search.journal import JOURNAL_FILE, read_events, resume_command
    from ggcnn_net2net.search.live import LiveView

    try:
        with workers as pool, LiveView(Console(), workers=pool.count) as view:
            history = search(pool, view.on_event)
    except KeyboardInterrupt:
        if read_events(directory / JOURNAL_FILE):
            click.echo(f"Everything so far is kept: {resume_command(directory)}", err=True)
        raise
    _report(history, directory / "report")
    click.echo(f"The best network of the path: {directory / 'best.hdf5'}")


def _report(history: SearchHistory, folder: Path) -> None:
    from rich.console import Console

    from ggcnn_net2net.search.report import rich_summary, write_report

    Console().print(rich_summary(history))
    for path in write_report(history, folder):
        click.echo(f"written: {path}")
