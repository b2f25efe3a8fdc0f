"""`ggcnn-net2net dataset ...`: read, convert, join and look at grasp data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ggcnn_net2net.cli.options import GRIPPER, PROTOCOL, WORKERS, OutputFile, Picture, gripper_of

if TYPE_CHECKING:
    from ggcnn_net2net.datasets.raw import Problem

FOLDER = click.Path(path_type=Path)
OUTPUT = click.option("-o", "--output", required=True, type=OutputFile(), help="File to write.")
FORM = click.option(
    "--form", type=click.Choice(["cornell", "jacquard"]), help="What FOLDER holds. [default: by its file names]"
)
DEPTH = click.option(
    "--depth", default="perfect", show_default=True, type=click.Choice(["perfect", "stereo"]), help="Of Jacquard."
)
FRACTION = click.option(
    "--test-fraction",
    default=0.2,
    show_default=True,
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="Part of the scenes, or of the objects, to test on.",
)
UNCOMPRESSED = click.option(
    "--uncompressed", is_flag=True, help="A file several times as large, which is quicker to train a small network on."
)
SEED = click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Seed of all draws.")
_SHOWN = 20  # problems of a folder that are printed


@click.group()
def dataset() -> None:
    """Read, convert, join and look at grasp data.

    Example: ggcnn-net2net dataset build cornell -o cornell.h5
    """


@dataset.command()
@click.argument("folder", type=FOLDER)
@OUTPUT
@FORM
@DEPTH
@click.option(
    "--split",
    "split_spec",
    default="image",
    show_default=True,
    metavar="image|object|FILE",
    help="Test on scenes drawn at random, on objects drawn at random, or as a split file says.",
)
@FRACTION
@click.option("--augmentations", default=10, show_default=True, type=click.IntRange(min=1), help="Samples of a scene.")
@click.option(
    "--zoom",
    nargs=2,
    default=(0.4, 1.0),
    show_default=True,
    type=click.FloatRange(0, 1, min_open=True),
    help="Range of the part of the crop that a sample shows; 1 1 for none.",
)
@click.option("--rotate/--no-rotate", default=True, show_default=True, help="Rotate samples at random.")
@UNCOMPRESSED
@SEED
@WORKERS
def build(
    folder: Path,
    output: Path,
    form: str | None,
    depth: str,
    split_spec: str,
    test_fraction: float,
    augmentations: int,
    zoom: tuple[float, float],
    rotate: bool,
    uncompressed: bool,
    seed: int,
    workers: int,
) -> None:
    """Make training data, an HDF5 file, of the raw scenes in FOLDER.

    \b
    Example: ggcnn-net2net dataset build cornell -o cornell.h5 --split object --augmentations 10
    """
    from rich.console import Console

    from ggcnn_net2net.cli.progress import stages
    from ggcnn_net2net.datasets.augmentation import Augmentation
    from ggcnn_net2net.datasets.build import build_dataset
    from ggcnn_net2net.datasets.raw import open_scenes
    from ggcnn_net2net.datasets.splits import BY, make_split, read_split

    scenes = open_scenes(folder, form, depth)
    if split_spec in BY:
        split = make_split(scenes.objects, split_spec, test_fraction, seed)
    else:
        split = read_split(Path(split_spec))
    settings = Augmentation(zoom=zoom, rotate=rotate, per_scene=augmentations)
    _print_problems(scenes.report)
    with stages(Console()) as progress:
        result = build_dataset(
            scenes,
            split,
            output,
            settings,
            seed,
            workers,
            on_progress=lambda done, total: progress("draw samples", done, total),
            compressed=not uncompressed,
        )
    _print_problems(result.problems[len(scenes.report) :])
    rows = ", ".join(f"{count} {side}" for side, count in result.rows.items())
    click.echo(f"{len(scenes)} {scenes.form} scenes, split {split.sha256[:12]}: {rows} images written to {output}")


@dataset.command()
@click.option("-o", "--output", required=True, type=FOLDER, help="Folder to write, or to go on with.")
@click.option("--scenes", "count", default=1000, show_default=True, type=click.IntRange(1, 10_000), help="How many.")
@click.option(
    "--noise", default=0.0, show_default=True, type=click.FloatRange(0), help="Depth noise at 1 m, in metres (sigma)."
)
@click.option(
    "--missing", default=0.0, show_default=True, type=click.FloatRange(0, 1), help="Share of edge pixels that are lost."
)
@click.option(
    "--tried-labels",
    is_flag=True,
    help="Label objects without sure grasps by what holds in simulation, instead of skipping them. Slow.",
)
@click.option(
    "--sides",
    nargs=2,
    type=float,
    help="Range of the objects' longest sides in metres, such as 0.2 0.32.  [default: 0.04 to 0.32, mostly small]",
)
@SEED
@PROTOCOL
@GRIPPER
@WORKERS
def simulate(
    output: Path,
    count: int,
    noise: float,
    missing: float,
    tried_labels: bool,
    sides: tuple[float, float] | None,
    seed: int,
    protocol_name: str,
    gripper_file: Path | None,
    workers: int,
) -> None:
    """Simulate scenes of training objects, none of the benchmark's, with antipodal grasps for labels.

    They have the form of the Cornell dataset; `dataset build` makes an HDF5 file of them. A stopped run goes on when
    it is called again, and more scenes can be added with a larger --scenes.

    \b
    Example: ggcnn-net2net dataset simulate -o simulated --scenes 1000
             ggcnn-net2net dataset build simulated -o simulated.h5 --split object --zoom 0.7 1
    """
    from rich.console import Console

    from ggcnn_net2net.cli.progress import stages
    from ggcnn_net2net.datasets.simulated import Simulation, simulate_folder
    from ggcnn_net2net.protocol import protocol_named

    settings = Simulation(
        seed=seed,
        noise=noise,
        missing=missing,
        tried_labels=tried_labels,
        sides=sides,
        protocol=protocol_named(protocol_name),
        gripper=gripper_of(gripper_file),
    )
    with stages(Console()) as progress:
        labels = simulate_folder(output, count, settings, workers, lambda done, total: progress("scenes", done, total))
    click.echo(f"{len(labels)} scenes, {sum(labels.values()) / len(labels):.0f} labels a scene, written to {output}")


@dataset.command()
@click.argument("files", nargs=-1, required=True, type=FOLDER)
@OUTPUT
@UNCOMPRESSED
def concat(files: Sequence[Path], output: Path, uncompressed: bool) -> None:
    """Join dataset FILES into one, or write one anew.

    \b
    Example: ggcnn-net2net dataset concat cornell.h5 simulated.h5 -o both.h5
    """
    from ggcnn_net2net.datasets.concatenation import concatenate

    rows = concatenate(files, output, compressed=not uncompressed)
    click.echo(f"{', '.join(f'{count} {side}' for side, count in rows.items())} images written to {output}")


@dataset.command()
@click.argument("folder", type=FOLDER)
@click.option("--by", default="object", show_default=True, type=click.Choice(["image", "object"]), help="What to draw.")
@FRACTION
@SEED
@FORM
@DEPTH
@OUTPUT
def split(folder: Path, by: str, test_fraction: float, seed: int, form: str | None, depth: str, output: Path) -> None:
    """Draw which scenes of FOLDER to train and to test on, as a file to share.

    \b
    Example: ggcnn-net2net dataset split cornell --by object -o split.json
    """
    from ggcnn_net2net.datasets.raw import open_scenes
    from ggcnn_net2net.datasets.splits import make_split, write_split

    scenes = open_scenes(folder, form, depth)
    drawn = make_split(scenes.objects, by, test_fraction, seed)
    write_split(output, drawn)
    _print_problems(scenes.report)
    click.echo(f"{len(drawn.train)} train, {len(drawn.test)} test scenes written to {output}, SHA-256 {drawn.sha256}")


@dataset.command()
@click.argument("path", metavar="FILE|FOLDER", type=FOLDER)
@click.option("-o", "--output", required=True, type=Picture(), help="Picture to write.")
@click.option("--count", default=20, show_default=True, type=click.IntRange(min=1), help="Images to show.")
@DEPTH
def preview(path: Path, output: Path, count: int, depth: str) -> None:
    """Draw images, rectangles and label maps of a dataset or a folder of raw scenes.

    \b
    Example: ggcnn-net2net dataset preview cornell.h5 -o sheet.png --count 10
    """
    from ggcnn_net2net.datasets.preview import preview_samples, write_sheet

    samples = preview_samples(path, count, depth)
    write_sheet(output, samples)
    click.echo(f"{len(samples)} images written to {output}")


@dataset.command()
@click.argument("file", type=FOLDER)
@click.option("--verify", is_flag=True, help="Compute the fingerprints anew and compare.")
def info(file: Path, verify: bool) -> None:
    """Tell what a dataset FILE holds: rows, labels, provenance, fingerprint.

    \b
    Example: ggcnn-net2net dataset info cornell.h5
    """
    import json

    from ggcnn_net2net.datasets.concatenation import splits_of
    from ggcnn_net2net.datasets.summary import summarise_labels
    from ggcnn_net2net.errors import DatasetError

    parts = splits_of(file)
    for part in parts:
        click.echo(
            f"{part.split}: {len(part)} images {part.shape[0]}x{part.shape[1]} of {len(set(part.image_ids))} scenes"
        )
        click.echo(f"  fingerprint {part.fingerprint}")
        if verify and part.fingerprint != part.content_hash():
            raise DatasetError(
                f"expected this fingerprint, the content of {file}:{part.split} has another: it was changed"
            )
        if verify:
            kept = part.has_fingerprint
            click.echo("  the content has it" if kept else "  computed now: the file keeps none to compare with")
        if len(part):
            labels = summarise_labels(part)
            low, middle, high = labels.widths
            click.echo(
                f"  {labels.rows} of them: {labels.rectangles:.1f} rectangles an image, {labels.labelled:.2%} of "
                f"pixels labelled, {labels.unlabelled_images} images without label"
            )
            click.echo(f"  openings {low:.0f}-{high:.0f} px (5-95%), median {middle:.0f} px")
            click.echo(f"  depth {labels.depth[0]:.3f} to {labels.depth[1]:.3f} m about the mean")
    click.echo(json.dumps(parts[0].attributes, indent=1) if parts[0].attributes else "no provenance in the file")


def _print_problems(problems: Sequence[Problem]) -> None:
    for file, problem in problems[:_SHOWN]:
        click.echo(f"{file}: {problem}", err=True)
    if len(problems) > _SHOWN:
        click.echo(f"... {len(problems)} problems in all; a file made of these scenes lists them as left_out", err=True)
