"""`ggcnn-net2net evaluate ...`: single grasps, failures and comparisons of a benchmark, the IoU rate."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ggcnn_net2net.cli.networks import keep_record
from ggcnn_net2net.cli.options import GRIPPER, OBJECTS, PROTOCOL, SEED, OutputFile, Picture, gripper_of
from ggcnn_net2net.versions import versions

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ggcnn_net2net.grasping import IouRate
    from ggcnn_net2net.reproduce.comparison import Comparison


Progress = Callable[[str, int, int], None]


@click.group()
def evaluate() -> None:
    """Try single grasps of a network, look at failures, compare networks, score one on a dataset.

    The whole benchmark of your own network is `ggcnn-net2net reproduce table1 --models original,FILE`.

    Example: ggcnn-net2net evaluate grasp published --object hammer --film hammer.gif
    """


@evaluate.command()
@click.argument("model")
@OBJECTS
@click.option("--object", "object_name", required=True, help="Name of the object within the set.")
@click.option("--pose", default=0, show_default=True, type=click.IntRange(min=0), help="Index of its pose.")
@SEED
@PROTOCOL
@GRIPPER
@click.option("--picture", type=Picture(), help="Write the phases as a picture.")
@click.option("--film", type=OutputFile(), help="Write a film: .gif or .mp4.")
@click.option("--gui", is_flag=True, help="Show the simulation in a window (needs a display).")
def grasp(
    model: str,
    objects_spec: str,
    object_name: str,
    pose: int,
    seed: int,
    protocol_name: str,
    gripper_file: Path | None,
    picture: Path | None,
    film: Path | None,
    gui: bool,
) -> None:
    """Let MODEL (a file, "published" or "zoo:NAME") grasp one object; the scene is the one of `reproduce table1`.

    \b
    Example: ggcnn-net2net evaluate grasp published --object hammer --picture hammer.png --film hammer.gif
    """
    from ggcnn_net2net.inference import predict_grasps
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.simulation.object_sets import load_object_set
    from ggcnn_net2net.simulation.pictures import Film, save_strips, show_trial, trial_strip
    from ggcnn_net2net.simulation.scenes import make_scene
    from ggcnn_net2net.simulation.trial import decoding_of
    from ggcnn_net2net.simulation.world import World

    gripper = gripper_of(gripper_file)
    import_tensorflow()
    recording = Film(film) if film is not None else None
    protocol = protocol_named(protocol_name)
    objects = load_object_set(objects_spec, protocol)
    chosen = objects.named(object_name)
    network = load_ggcnn(model)
    with World() as world:
        scene = make_scene(world, chosen, pose, seed)
        (found,) = predict_grasps(network, scene.depth[None], decoding_of(protocol))
        if recording is not None:
            recording.watch(world)
        strip, result = trial_strip(world, scene, found, protocol, gripper)
    click.echo(f"{scene.key}: {result.outcome}, {result.distance:.2f} m from the bin's centre, {result.steps} steps")
    if found is not None and result.grasp is not None:
        click.echo(
            f"row {found.row:.0f}, col {found.col:.0f}, angle {found.angle:.2f} rad, opening {found.width_px:.0f} px "
            f"= {result.grasp.opening:.3f} m, quality {found.quality:.2f}"
        )
    if picture is not None:
        save_strips(picture, [strip])
        click.echo(f"Written to {picture}")
    if recording is not None and recording.frames:
        recording.save()
        click.echo(f"Written to {film}")
    elif recording is not None:
        click.echo("Nothing moved, so no film is written", err=True)
    if gui:
        show_trial(scene, found, protocol, gripper)


@evaluate.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option(
    "--objects",
    "objects_spec",
    metavar="SET",
    help="The object set, if it was a folder of yours or shapenetsem:FOLDER.",
)
@click.option("--network", default="original", show_default=True, help="Network, as named in the table.")
@click.option("--count", default=10, show_default=True, type=click.IntRange(min=1), help="Most failures to draw.")
@click.option("-o", "--output", required=True, type=Picture(), help="Picture to write.")
def failures(results: Path, objects_spec: str | None, network: str, count: int, output: Path) -> None:
    """Draw failed grasps of a finished benchmark, spread evenly over the objects, phase by phase.

    \b
    Example: ggcnn-net2net evaluate failures results/table1-procedural40-5poses-seed0-paper -o failures.png
    """
    from ggcnn_net2net.errors import ResultsError
    from ggcnn_net2net.reproduce.results import current_records, read_settings
    from ggcnn_net2net.simulation.object_sets import load_object_set
    from ggcnn_net2net.simulation.pictures import save_strips, trial_strip
    from ggcnn_net2net.simulation.scenes import load_scenes, scene_key
    from ggcnn_net2net.simulation.world import World

    _, settings, protocol, gripper = read_settings(results / "results.json")
    objects = load_object_set(objects_spec or settings.object_set, protocol)
    scenes = {scene.key: scene for scene in load_scenes(results / "scenes.h5", objects, settings)}
    records = current_records(results)
    networks = dict.fromkeys(record.model for record in records)
    if network not in networks:
        raise ResultsError(f"expected one of the networks {'; '.join(networks) or 'none'}, received {network!r}")
    failed = [
        record
        for record in records
        if record.model == network and not record.success and scene_key(record.object, record.pose) in scenes
    ]
    if not failed:
        raise ResultsError(f"expected failures of {network!r} in {results}, found none")
    chosen = [failed[index * len(failed) // count] for index in range(count)] if count < len(failed) else failed
    strips = []
    with World() as world:
        for record in chosen:
            scene = scenes[scene_key(record.object, record.pose)]
            strip, _ = trial_strip(world, scene, record.grasp, protocol, gripper)
            strips.append(strip)
    save_strips(output, strips)
    click.echo(f"{len(chosen)} of {len(failed)} failures written to {output}")


@evaluate.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("first")
@click.argument("second")
def compare(results: Path, first: str, second: str) -> None:
    """Compare the networks FIRST and SECOND of a benchmark in the folder RESULTS, scene by scene.

    Shows both success rates, McNemar's exact test on the scenes that both have grasped, and the objects on which the
    networks differ. A network's name is that of its row in table1.md, or of the column "model" in grasps.csv.

    \b
    Example: ggcnn-net2net evaluate compare results/table1-procedural40-5poses-seed0-paper control extended
    """
    from rich.console import Console

    from ggcnn_net2net.reproduce import comparison
    from ggcnn_net2net.reproduce.results import current_records

    _print_comparison(Console(), comparison.compare(current_records(results), first, second), first, second)


@evaluate.command()
@click.argument("model")
@click.argument("dataset", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--split", default="test", show_default=True, help='Split of the dataset, or "all" for all its images.')
@click.option(
    "--workers",
    default=1,
    show_default=True,
    type=click.IntRange(min=1),
    help="Processes that decode the maps; more than 1 seldom helps. Results do not depend on it.",
)
@click.option("-o", "--output", type=OutputFile(), help="Write the result as JSON.")
@click.option("--csv", "csv_path", type=OutputFile(), help="Write one CSV row per image and protocol.")
def iou(model: str, dataset: Path, split: str, workers: int, output: Path | None, csv_path: Path | None) -> None:
    """IoU rate of MODEL (a file, "published" or "zoo:NAME") on DATASET, an HDF5 file of the GG-CNN layout.

    A grasp counts if its rectangle shares more than a quarter of the pixels (IoU) with a labelled one whose direction
    is within 30 degrees. Printed as published (PAPER) and corrected: the published code takes 89 and -89 degrees for
    178 degrees apart, and subtracts the mean of the depth twice.

    \b
    Example: ggcnn-net2net evaluate iou published cornell.hdf5 -o iou.json
    """
    from rich.console import Console

    from ggcnn_net2net.atomic import is_one_of, write_text
    from ggcnn_net2net.cli.progress import stages
    from ggcnn_net2net.datasets.concatenation import splits_of
    from ggcnn_net2net.datasets.hdf5 import GraspDataset
    from ggcnn_net2net.grasping.iou import joined
    from ggcnn_net2net.inference.iou_rate import iou_rate_of
    from ggcnn_net2net.model_files.load import load_ggcnn, source_path
    from ggcnn_net2net.protocol import CORRECTED, PAPER
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reference_data import sha256_of

    path = source_path(model)
    for written in filter(None, (output, csv_path)):
        keep_record(written, model)
        if is_one_of(written, (path, dataset)):
            raise click.UsageError(f"expected another output file than the inputs, received {str(written)!r}")
    import_tensorflow()
    network = load_ggcnn(path)
    parts = splits_of(dataset) if split == "all" else [GraspDataset(dataset, split)]
    console = Console()
    with stages(console) as progress:
        rates = {
            protocol: joined(
                iou_rate_of(network, images, protocol, workers, _of_split(progress, images.split)) for images in parts
            )
            for protocol in (PAPER, CORRECTED)
        }
    console.print(_iou_table({protocol.name: rate for protocol, rate in rates.items()}))
    if output is not None:
        content = {
            "experiment": "iou",
            "model": {"file": str(path), "sha256": sha256_of(path), "parameters": network.count_params()},
            "dataset": {
                "file": str(dataset),
                "split": split,
                "images": sum(map(len, parts)),
                "fingerprint": "+".join(images.fingerprint for images in parts),
            },
            "rates": [{"protocol": protocol.as_dict(), **_iou_as_dict(rate)} for protocol, rate in rates.items()],
            "versions": versions(),
        }
        write_text(output, json.dumps(content, indent=2) + "\n")
        click.echo(f"Written to {output}")
    if csv_path is not None:
        image_ids = [name for images in parts for name in images.image_ids]
        write_text(csv_path, _iou_csv(image_ids, {protocol.name: rate for protocol, rate in rates.items()}))
        click.echo(f"Written to {csv_path}")


def _print_comparison(console: Console, found: Comparison, first: str, second: str) -> None:
    """Rates, test, and the objects with other counts."""
    from rich.markup import escape

    rates = _new_table(("network", "success", "rate (95% interval)"))
    for name, rate in ((first, found.first), (second, found.second)):
        low, high = rate.interval
        rates.add_row(escape(name), f"{rate.successes}/{rate.trials}", f"{rate.value:.3f} ({low:.3f}-{high:.3f})")
    paired = found.paired
    test = (
        f"{second} against {first}, same scenes: {paired.only_second} won, {paired.only_first} lost, "
        f"p = {paired.p_value:.3g} (McNemar's exact test)"
    )
    differing = [item for item in found.objects if item.first != item.second]
    objects = _new_table(("object", escape(first), escape(second), "poses"))
    for item in differing:
        objects.add_row(escape(item.name), str(item.first), str(item.second), str(item.poses))
    console.print(rates)
    console.print(test, highlight=False, markup=False, soft_wrap=True)
    if differing:
        console.print(objects)
    console.print(f"As many successes with both: {len(found.objects) - len(differing)} of {len(found.objects)} objects")


def _of_split(progress: Progress, split: str) -> Progress:
    """A bar of its own for each split."""
    return lambda stage, done, total: progress(f"{stage}, {split}", done, total)


def _new_table(headings: tuple[str, ...], title: str | None = None) -> Table:
    """The first column holds names, the others numbers."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in headings:
        table.add_column(heading, justify="left" if heading == headings[0] else "right", no_wrap=True)
    return table


def _iou_table(rates: dict[str, IouRate]) -> Table:
    from ggcnn_net2net.reproduce.statistics import Rate

    table = _new_table(("protocol", "success", "rate (95% interval)", "no grasp found"), "IoU rate")
    for name, rate in rates.items():
        low, high = Rate(rate.successes, rate.total).interval
        interval = f"{rate.rate:.3f} ({low:.3f}-{high:.3f})"
        table.add_row(name, f"{rate.successes}/{rate.total}", interval, str(rate.without_grasp))
    return table


def _iou_as_dict(rate: IouRate) -> dict[str, Any]:
    from ggcnn_net2net.reproduce.statistics import Rate

    return {
        "successes": rate.successes,
        "images": rate.total,
        "rate": rate.rate,
        "wilson_95": list(Rate(rate.successes, rate.total).interval),
        "without_grasp": rate.without_grasp,
    }


def _iou_csv(image_ids: list[str], rates: dict[str, IouRate]) -> str:
    """A row an image and protocol; the grasp's cells are empty where there is none."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("image", "img_id", "protocol", "success", "row", "col", "angle", "width_px", "quality"))
    for name, rate in rates.items():
        for index, (grasp, success) in enumerate(zip(rate.grasps, rate.success, strict=True)):
            cells = astuple(grasp) if grasp is not None else ("",) * 5
            writer.writerow((index, image_ids[index], name, int(success), *cells))
    return text.getvalue()
