"""`ggcnn-net2net reproduce fig1|fig2|fig3|epochs|all`: the paper's figures, from shipped results or run again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ggcnn_net2net.cli.networks import note_other_loss
from ggcnn_net2net.cli.options import OBJECTS, PROTOCOL, SEED, Picture, command_line

if TYPE_CHECKING:
    from ggcnn_net2net.reproduce.experiments import Experiment
    from ggcnn_net2net.reproduce.run_experiment import Views

RESULTS = Path("results")

OUTPUT = click.option(
    "-o", "--output", type=click.Path(path_type=Path, file_okay=False), help="Folder. [default: results/NAME]"
)
NETWORK = click.option(
    "--network",
    metavar="MODEL",
    help='With --run: what to start from, "published" or a model file. [default: published]',
)
NETWORKS = click.option(
    "--networks",
    metavar="CURVE=MODEL,...",
    help="With --run: what to start from, narrow=FILE,shallow=FILE. [default: zoo:narrow_paper and zoo:shallow_paper, "
    "in protocol corrected zoo:narrow and zoo:shallow]",
)
CURVES = click.option("--curves", metavar="NAMES", help="With --run: only these, separated by commas. [default: all]")
_RUN = (
    click.option("--run", "run_again", is_flag=True, help="Run the searches again, or go on with them. Hours to days."),
    click.option(
        "--data",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        help="With --run: file of `dataset build`.",
    ),
    click.option(
        "--budget",
        default="standard",
        show_default=True,
        type=click.Choice(["quick", "short", "standard", "paper"]),
        help="With --run, of each search: from minutes to an hour up to days on 2 cores.",
    ),
    click.option(
        "--max-params",
        "max_parameters",
        type=click.IntRange(min=1),
        help="With --run: consider no larger networks, which are the slowest. [default: no limit, as in the paper]",
    ),
    click.option(
        "--learning-rate",
        default=1e-3,
        show_default=True,
        type=click.FloatRange(0, min_open=True),
        help="With --run: of each search. Less for a network whose training ended with less.",
    ),
    click.option(
        "--protocol",
        "protocol_name",
        type=click.Choice(["paper", "corrected"], case_sensitive=False),
        help="With --run: only this one. [default: those of the figure]",
    ),
    click.option(
        "--objects",
        "objects_spec",
        default="procedural40",
        show_default=True,
        metavar="SET",
        help="With --run: objects of SIM.",
    ),
    click.option(
        "--poses", default=5, show_default=True, type=click.IntRange(min=1), help="With --run: poses of each object."
    ),
    click.option(
        "--seed", default=0, show_default=True, type=click.IntRange(min=0), help="With --run: of searches and scenes."
    ),
    click.option("--workers", type=click.IntRange(min=1), help="With --run: processes. [default: one per core]"),
)


def running(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options with which an experiment is run again."""
    for option in reversed(_RUN):
        function = option(function)
    return function


@click.command(short_help="Fig. 1: the simulator, and what a network predicts.")
@click.option("--model", default="published", show_default=True, help='A model file, "published" or zoo:NAME.')
@OBJECTS
@click.option("--object", "object_name", default="hammer", show_default=True, help="Name of the object within the set.")
@click.option("--pose", default=0, show_default=True, type=click.IntRange(min=0), help="Index of its pose.")
@SEED
@PROTOCOL
@click.option(
    *("-o", "--output"),
    default="results/fig1/fig1.png",
    show_default=True,
    type=Picture(),
)
def fig1(
    model: str, objects_spec: str, object_name: str, pose: int, seed: int, protocol_name: str, output: Path
) -> None:
    """Fig. 1: the simulator, and what a network predicts: quality, angle, width, and its best grasp.

    \b
    Example: python -m ggcnn_net2net.reproduce fig1 --model my_network.hdf5 --object mug -o mug.png
    """
    from ggcnn_net2net.errors import ResultsError
    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reproduce.fig1 import draw, predict
    from ggcnn_net2net.reproduce.networks import load_networks
    from ggcnn_net2net.simulation.object_sets import load_object_set

    import_tensorflow()
    protocol = protocol_named(protocol_name)
    objects = load_object_set(objects_spec, protocol)
    chosen = objects.named(object_name)
    (network,) = load_networks([model])
    if network.model is None:
        raise ResultsError(f"expected a network with weights, {network.name} has none: {network.note}")
    prediction = predict(network.model, chosen, pose, seed, protocol)
    draw(output, prediction, f"GG-CNN {network.name}", protocol)
    click.echo(f"{network.name}, {prediction.scene.key}: {prediction.outcome}")
    click.echo(f"Written to {output}")


@click.command(short_help="Fig. 2: four searches from the published network.")
@OUTPUT
@NETWORK
@CURVES
@running
def fig2(network: str | None, **options: Any) -> None:
    """Fig. 2: four searches from the published network, IoU and SIM by depth, beside the paper's.

    Drawn from shipped results, or from those of --run in the folder if there are some.

    \b
    Examples:
      python -m ggcnn_net2net.reproduce fig2
      python -m ggcnn_net2net.reproduce fig2 --run --budget quick --data simulated.h5 --curves "e=2" -o mine
    """
    _make("fig2", _for_all("fig2", network), **options)


@click.command(short_help="Fig. 3: searches from small networks.")
@OUTPUT
@NETWORKS
@CURVES
@running
def fig3(networks: str | None, **options: Any) -> None:
    """Fig. 3: searches from the narrow and the shallow network, which change transposed layers, too.

    Drawn from shipped results, or from those of --run in the folder if there are some.

    \b
    Example: python -m ggcnn_net2net.reproduce fig3 --run --data simulated.h5 --networks narrow=my.hdf5 --curves narrow
    """
    _make("fig3", _named(networks), **options)


@click.command(short_help="Searches with 2, 5 and 10 epochs after each operation.")
@OUTPUT
@NETWORK
@CURVES
@running
def epochs(network: str | None, **options: Any) -> None:
    """Searches with 2, 5 and 10 epochs after each operation (the paper shows those with 2).

    Drawn from shipped results, or from those of --run in the folder if there are some.

    \b
    Example: python -m ggcnn_net2net.reproduce epochs --run --budget quick --data simulated.h5
    """
    _make("epochs", _for_all("epochs", network), **options)


@click.command("all", short_help="Table I and all figures.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder, with one for Table I and for each figure in it. [default: results]",
)
@NETWORK
@NETWORKS
@running
@click.pass_context
def everything(
    context: click.Context, output: Path | None, network: str | None, networks: str | None, **options: Any
) -> int:
    """Table I and all figures: from shipped results in minutes, or with --run after running all searches again.

    Table I is that of the zoo's networks in any case. --objects, --poses, --seed, --protocol and --workers hold for
    it, too.

    \b
    Examples:
      python -m ggcnn_net2net.reproduce all
      python -m ggcnn_net2net.reproduce all --run --budget paper --data cornell.h5
    """
    from ggcnn_net2net.cli.reproduce import table1  # which imports this module
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reproduce.experiments import EXPERIMENTS, part_of
    from ggcnn_net2net.reproduce.networks import load_networks

    _need_data(options)
    # Names that are wrong show now, not after hours.
    part_of(EXPERIMENTS["fig3"], networks=_named(networks))
    for model in (network, *_named(networks).values()) if options["run_again"] else ():
        if model is not None:
            import_tensorflow()
            load_networks([model])
    status: int = context.invoke(
        table1,
        objects_spec=options["objects_spec"],
        poses=options["poses"],
        seed=options["seed"],
        protocol_name=options["protocol_name"] or "paper",
        workers=options["workers"] or os.cpu_count() or 1,
        output=None if output is None else output / "table1",
    )
    folder = output or RESULTS
    context.invoke(fig1, output=folder / "fig1" / "fig1.png")
    work = folder / "runs"  # shared: a search that stands in two experiments is run once
    for name in ("fig2", "fig3", "epochs"):
        starts = _named(networks) if name == "fig3" else _for_all(name, network)
        _make(name, starts, folder / name, curves=None, work=work, **options)
    return status


def _make(name: str, networks: dict[str, str], output: Path | None, work: Path | None = None, **options: Any) -> None:
    """Draw an experiment, after running it again if that is asked for."""
    from ggcnn_net2net.reproduce.curve_report import not_run, write_report
    from ggcnn_net2net.reproduce.curves import read_points, results_of, shipped_points
    from ggcnn_net2net.reproduce.experiments import EXPERIMENTS
    from ggcnn_net2net.reproduce.run_experiment import RESULTS_FILE

    _need_data(options)
    experiment = EXPERIMENTS[name]
    output = output or RESULTS / name
    if options["run_again"]:
        _run(experiment, networks, output, work, **options)
    own = output / RESULTS_FILE
    points = read_points(own) if own.is_file() else shipped_points()
    source = f"Our numbers: {own}." if own.is_file() else "Our numbers: results that ship with the package."
    results = results_of(experiment, points)
    click.echo("\n".join((f"{experiment.title}. {source}", *not_run(results))))
    for path in write_report(output, experiment, results, source):
        click.echo(f"Written to {path}")


def _run(
    experiment: Experiment,
    networks: dict[str, str],
    output: Path,
    work: Path | None,
    *,
    data: Path,
    budget: str,
    max_parameters: int | None,
    learning_rate: float,
    protocol_name: str | None,
    objects_spec: str,
    poses: int,
    seed: int,
    workers: int | None,
    curves: str | None,
    **_: Any,
) -> None:
    """Run searches and judge their networks."""
    from ggcnn_net2net.parallel import LocalWorkers
    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reproduce.experiments import part_of
    from ggcnn_net2net.reproduce.run_experiment import Conditions, run_experiment
    from ggcnn_net2net.zoo import PREFIX, names

    part = part_of(
        experiment,
        curves=[name.strip() for name in curves.split(",")] if curves else (),
        protocols=[protocol_named(protocol_name)] if protocol_name else (),
        networks=networks,
    )
    for protocol in part.protocols:
        for network in sorted({curve.of_protocol(protocol).network for curve in part.curves}):
            note_other_loss(f"{PREFIX}{network}" if network in names() else network, protocol)
    import_tensorflow()
    try:
        with LocalWorkers(workers or os.cpu_count() or 1) as pool:
            run_experiment(
                part,
                Conditions(data, budget, seed, objects_spec, poses, max_parameters, learning_rate),
                output,
                pool,
                work=work,
                command=command_line(),
                views=_views(pool.count),
            )
    except KeyboardInterrupt:
        click.echo("Everything so far is kept: run the same command again, and it goes on.", err=True)
        raise


def _views(workers: int) -> Views:
    """Live views in the terminal."""
    from rich.console import Console

    from ggcnn_net2net.cli.progress import stages
    from ggcnn_net2net.reproduce.run_experiment import Views
    from ggcnn_net2net.search.live import LiveView

    console = Console()

    @contextmanager
    def search(title: str) -> Iterator[Any]:
        console.rule(title)
        with LiveView(console, workers=workers) as view:
            yield view.on_event

    @contextmanager
    def judging(_: str) -> Iterator[Any]:
        with stages(console) as progress:
            yield progress

    return Views(search, judging)


def _need_data(options: dict[str, Any]) -> None:
    if options["run_again"] and options["data"] is None:
        raise click.UsageError("--run needs --data DATASET.h5, a file of `ggcnn-net2net dataset build`")


def _for_all(name: str, network: str | None) -> dict[str, str]:
    """The same network for all curves."""
    from ggcnn_net2net.reproduce.experiments import EXPERIMENTS

    return {curve.name: network for curve in EXPERIMENTS[name].curves} if network else {}


def _named(networks: str | None) -> dict[str, str]:
    """Networks by curve, from CURVE=MODEL,CURVE=MODEL."""
    pairs = [pair.partition("=") for pair in networks.split(",")] if networks else []
    if any(not model for _, _, model in pairs):
        raise click.BadParameter(f"expected CURVE=MODEL,CURVE=MODEL, received {networks!r}", param_hint="--networks")
    return {curve.strip(): model.strip() for curve, _, model in pairs}
