"""`ggcnn-net2net predict`: depth images on disk -> grasps as JSON and pictures."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ggcnn_net2net.grasping import Grasp
    from ggcnn_net2net.inference.intrinsics import Intrinsics
    from ggcnn_net2net.inference.predictor import GraspPredictor, Prediction

_POLL = 0.5  # seconds between two looks at a watched folder
_PRESETS = ("rss_2018", "kinova", "mvp", "ggcnn_master", "paper_simulator")  # as PRESETS, which --help must not load


@click.command("predict")
@click.argument("images", nargs=-1, type=click.Path(path_type=Path, exists=True), metavar="IMAGE...")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to fill.")
@click.option("--network", default="published", show_default=True, help='A model file, "published" or "zoo:NAME".')
@click.option(
    "--preset",
    default="rss_2018",
    show_default=True,
    type=click.Choice(_PRESETS),
    help="The public GG-CNN code whose crop, smoothing and thresholds to use.",
)
@click.option(
    "--mode",
    default="crop",
    show_default=True,
    type=click.Choice(["crop", "full"]),
    help="Show the network the preset's centre square, or the whole image.",
)
@click.option(
    "--backend",
    default="tensorflow",
    show_default=True,
    type=click.Choice(["tensorflow", "openvino"]),
    help="What computes the maps; openvino is quicker and needs '.[export]'.",
)
@click.option("--depth-unit", type=click.Choice(["m", "mm"]), help="Unit of the images; detected if unmistakable.")
@click.option("--n-grasps", default=1, show_default=True, type=click.IntRange(min=1), help="Most grasps an image.")
@click.option(
    "--fx", type=float, help="Focal length in pixels, along a row; with --fy, --cx and --cy: grasps in metres."
)
@click.option("--fy", type=float, help="The same along a column.")
@click.option("--cx", type=float, help="Column of the optical axis.")
@click.option("--cy", type=float, help="Row of the optical axis.")
@click.option(
    "--camera",
    "camera_file",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help='JSON file {"fx": ..., "fy": ..., "cx": ..., "cy": ...} or {"K": [9 numbers]} in place of these four.',
)
@click.option(
    "--watch",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Also process what is written to this folder from now on, until Ctrl-C.",
)
def predict_command(
    images: tuple[Path, ...],
    output: Path,
    network: str,
    preset: str,
    mode: str,
    backend: str,
    depth_unit: str | None,
    n_grasps: int,
    fx: float | None,
    fy: float | None,
    cx: float | None,
    cy: float | None,
    camera_file: Path | None,
    watch: Path | None,
) -> None:
    """Predict grasps from depth images: .png of 16 bits, .tiff, .npy, .npz, or folders of them.

    Writes NAME_grasps.json and NAME_grasps.png for each image. Depth is metres or millimetres, of any camera; missing
    pixels (NaN, 0) are filled in. With intrinsics, grasps are given in metres in the camera's optical frame, too. An
    image that cannot be used is reported, the others are processed, and the exit code is 1.

    \b
    Example: ggcnn-net2net predict scene.png -o grasps --preset kinova --fx 615 --fy 615 --cx 320 --cy 240
    Example: ggcnn-net2net predict --watch incoming -o grasps --depth-unit mm
    """
    from rich.console import Console

    from ggcnn_net2net.errors import DepthImageError
    from ggcnn_net2net.inference.depth_files import FolderWatch

    if not images and watch is None:
        raise click.UsageError("expected an IMAGE, a folder of images, or --watch FOLDER")
    watched = FolderWatch(watch) if watch is not None else None  # before the network loads, to miss nothing
    camera = _camera((fx, fy, cx, cy), camera_file)
    paths = _expanded(images, watch)
    console = Console()
    predictor, name = _predictor(network, preset, mode, backend)
    job = _Job(predictor, output, name, backend, camera, n_grasps, depth_unit)
    job.process(paths, console)
    if watched is not None:
        console.print(f"Watching {watch}; Ctrl-C ends", markup=False, soft_wrap=True)
        try:
            while True:
                job.process(watched.ready(), console, bar=False)
                time.sleep(_POLL)
        except KeyboardInterrupt:
            console.print("Stopped")
    if job.failures:
        raise DepthImageError(f"{len(job.failures)} of {len(job.outputs)} images could not be used")


@dataclass
class _Job:
    """What is done to each image, and what became of it."""

    predictor: GraspPredictor
    folder: Path
    network: str
    backend: str
    camera: Intrinsics | None
    n_grasps: int
    depth_unit: str | None
    outputs: dict[str, Path] = field(default_factory=dict)
    """NAME -> the image it stands for."""
    failures: dict[Path, str] = field(default_factory=dict)

    def process(self, paths: Sequence[Path], console: Console, bar: bool = True) -> None:
        """Predict, write files, print a table; then say what could not be used."""
        from rich.markup import escape

        from ggcnn_net2net.cli.progress import stages
        from ggcnn_net2net.errors import GGCNNError

        if not paths:
            return
        table, failed = _table(self.camera is not None, self.depth_unit is not None), []
        with stages(console) if bar and len(paths) > 1 else nullcontext(lambda *_: None) as progress:
            for done, path in enumerate(paths, start=1):
                try:
                    prediction = self._one(path)
                    _add_rows(table, (escape(path.name), prediction.depth_unit), prediction.grasps)
                    self.failures.pop(path, None)
                except (GGCNNError, OSError) as error:  # OSError: what it gives cannot be written
                    self.failures[path] = str(error)
                    failed.append(path)
                progress("images", done, len(paths))
        if len(failed) < len(paths):
            console.print(table)
        for path in failed:
            click.echo(f"{path}: {self.failures[path]}", err=True)

    def _one(self, path: Path) -> Prediction:
        from ggcnn_net2net.errors import DepthImageError
        from ggcnn_net2net.inference.depth_files import read_depth_file
        from ggcnn_net2net.inference.prediction_files import write_prediction_json, write_prediction_picture

        name, file = path.stem, path.parent.resolve() / path.name  # the name counts, also of a link to the last image
        if self.outputs.setdefault(name, file) != file:
            self.outputs[str(path)] = path  # counted, but nothing is written
            raise DepthImageError(f"its results would replace those of {self.outputs[name]}: rename one of them")
        prediction = self.predictor.look(read_depth_file(path), self.camera, self.n_grasps, self.depth_unit)
        title = f"{path.name}: {self._unit(prediction)}; {self.network}, preset {self.predictor.preset.name}"
        write_prediction_json(self.folder / f"{name}_grasps.json", prediction, self._origin(path))
        write_prediction_picture(self.folder / f"{name}_grasps.png", prediction, title)
        return prediction

    def _unit(self, prediction: Prediction) -> str:
        return f"{prediction.depth_unit} ({'detected' if self.depth_unit is None else 'told'})"

    def _origin(self, path: Path) -> dict[str, Any]:
        return {
            "image": str(path),
            "network": self.network,
            "backend": self.backend,
            "mode": self.predictor.mode,
            "preset": asdict(self.predictor.preset),
            "camera": None if self.camera is None else asdict(self.camera),
            "depth_unit_is": "detected" if self.depth_unit is None else "told",
        }


def _predictor(network: str, preset: str, mode: str, backend: str) -> tuple[GraspPredictor, str]:
    """The predictor, and the name of its network for the record."""
    from ggcnn_net2net.quiet import import_tensorflow

    import_tensorflow()
    from ggcnn_net2net.inference.predictor import GraspPredictor
    from ggcnn_net2net.model_files.load import opened_name, source_path

    path = source_path(network)
    return GraspPredictor(path, preset=preset, mode=mode, backend=backend), opened_name(network, path)


def _camera(values: tuple[float | None, ...], file: Path | None) -> Intrinsics | None:
    from ggcnn_net2net.inference.intrinsics import Intrinsics, read_intrinsics

    given = [value for value in values if value is not None]
    if file is not None and given:
        raise click.UsageError("expected either --camera or --fx, --fy, --cx and --cy, received both")
    if len(given) not in (0, 4):
        raise click.UsageError("expected all of --fx, --fy, --cx and --cy, or none")
    if file is not None:
        return read_intrinsics(file)
    return Intrinsics(*given) if given else None


def _expanded(images: Sequence[Path], watch: Path | None) -> list[Path]:
    """Files as they are named, folders as the depth images in them; each once. A watched one may still be empty."""
    from ggcnn_net2net.errors import DepthImageError
    from ggcnn_net2net.inference.depth_files import SUFFIXES, depth_files

    paths: list[Path] = []
    for image in images:
        found = depth_files(image) if image.is_dir() else [image]
        if not found and (watch is None or not image.samefile(watch)):
            raise DepthImageError(
                f"expected depth images ({', '.join(SUFFIXES)}; PNGs of 16 bits) in {image}, found none"
            )
        paths += found
    return list(dict.fromkeys(paths))


def _table(in_metres: bool, unit_told: bool) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.caption = f"unit {'told' if unit_told else 'detected'}; pixels are the image's, angles from the column axis"
    table.add_column("image", overflow="fold", min_width=12)
    table.add_column("unit", no_wrap=True)
    for heading in ("row", "col", "angle", "quality", *(["x, y, z m"] if in_metres else []), "opening"):
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _add_rows(table: Table, first: tuple[str, str], grasps: Sequence[Grasp]) -> None:
    """A row a grasp; the first one begins with the image and its unit."""
    from ggcnn_net2net.inference.intrinsics import CameraGrasp

    if not grasps:
        table.add_row(*first, "no grasp")
    for grasp in grasps:
        position: tuple[str, ...] = ()
        opening = f"{grasp.width_px:.1f} px"
        if isinstance(grasp, CameraGrasp):
            position, opening = (" ".join(f"{value:.3f}" for value in grasp.position),), f"{grasp.opening:.3f} m"
        table.add_row(
            *first,
            f"{grasp.row:.1f}",
            f"{grasp.col:.1f}",
            f"{math.degrees(grasp.angle):.1f}°",
            f"{grasp.quality:.2f}",
            *position,
            opening,
        )
        first = ("", "")
