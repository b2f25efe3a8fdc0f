"""Simulated scenes with antipodal labels, written as raw Cornell scenes: any GG-CNN tool can train on them.

A training object (none of the benchmark's) comes to rest under the benchmark's camera, which sees a larger image from a
varied height and offset. Labels come from the object's true geometry (`simulation.antipodal`), one closing direction a
place: a network that is told several at one place learns their mean, which is none of them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ggcnn_net2net.atomic import alone, replacing, write_text
from ggcnn_net2net.datasets.simulated_labels import ALIKE, TRIES, label_grasps, label_rectangles, tried_grasps
from ggcnn_net2net.errors import DatasetError, ObjectSetError
from ggcnn_net2net.inpainting import fill_missing
from ggcnn_net2net.parallel import Crash, run_parallel
from ggcnn_net2net.protocol import CORRECTED, PAPER, Protocol
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec
from ggcnn_net2net.simulation.antipodal import LOOSE_RULE, AntipodalRule
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.scenes import Scene, drop_object
from ggcnn_net2net.simulation.training_objects import SIDES, WIDEST, shape_of, training_object
from ggcnn_net2net.simulation.world import World, process_world

FORMAT = "ggcnn_net2net simulated scenes 1"
FOLDER_SIZE = 100
"""Scenes in each numbered sub-folder, as in Cornell's."""
MAX_SCENES = 10_000
"""Cornell's names have four digits."""
_IMAGE = (480, 640)
_ATTEMPTS = 50
_PREFIX = "pcd"
_EDGE = 0.01  # metres from pixel to pixel


@dataclass(frozen=True)
class Simulation:
    """What simulated scenes are like; with the same settings they are the same."""

    seed: int = 0
    camera_heights: tuple[float, float] = (1.3, 1.7)
    """Range of the camera's height in metres; the benchmark's is 1.5."""
    camera_offset: float = 0.1
    """Most distance of the camera from the middle, along x and along y, in metres."""
    noise: float = 0.0
    """Standard deviation of the depth noise in metres at 1 m; it grows with the square of the depth."""
    missing: float = 0.0
    """Share of the pixels along depth edges that are lost, and filled in from around them as Cornell's are."""
    least_labels: int = 5
    """Scenes with fewer labels are drawn again."""
    tried_labels: bool = False
    """Whether a scene with too few labels gets labels that were tried in simulation (`simulated_labels.tried_grasps`)
    before it is drawn again. Without, objects that are hard to grasp are never seen."""
    sides: tuple[float, float] | None = None
    """Range of the objects' longest sides in metres; None: 0.04 to 0.32, more small ones than large ones."""
    place: float = 0.06
    """Metres within which labels have to agree on the closing direction and the opening."""
    protocol: Protocol = PAPER
    """Decides where an object's centre lies."""
    gripper: GripperSpec = PAPER_GRIPPER
    """What is to grasp: labels have its openings, and fingers and palm find room."""

    def __post_init__(self) -> None:
        low, high = self.camera_heights
        if not (0.5 <= low <= high <= 4 and 0 <= self.camera_offset <= 0.5):
            raise DatasetError(
                "expected camera heights of 0.5 to 4 m and an offset of 0 to 0.5 m, received "
                f"{self.camera_heights} and {self.camera_offset}"
            )
        if self.seed < 0 or self.noise < 0 or not 0 <= self.missing <= 1 or self.least_labels < 1:
            raise DatasetError(
                "expected a seed and noise of 0 or more, missing within [0, 1] and least_labels of 1 or more, received "
                f"seed={self.seed}, noise={self.noise}, missing={self.missing}, least_labels={self.least_labels}"
            )
        low, high = self.sides or SIDES
        if not (SIDES[0] <= low <= high <= SIDES[1] and low <= WIDEST):
            raise DatasetError(
                f"expected sides from {SIDES[0]} to {SIDES[1]} m, the lower one first and at most {WIDEST} m, received "
                f"{self.sides}"
            )

    def as_dict(self) -> dict[str, Any]:
        """As JSON holds them; what was added to the settings later only where it is not the default."""
        protocol = self.protocol.name if self.protocol in (PAPER, CORRECTED) else self.protocol.as_dict()
        values = asdict(self) | {"camera_heights": list(self.camera_heights), "protocol": protocol}
        for name in ("gripper", "tried_labels", "sides"):
            del values[name]
        values |= self.gripper.as_setting()
        values["label_rule"] = asdict(AntipodalRule())  # labels of other rules must not mix in a folder
        if self.tried_labels:
            values["tried_labels"] = {"label_rule": asdict(LOOSE_RULE), "tries": TRIES, "alike": list(ALIKE)}
        if self.sides:
            values["sides"] = list(self.sides)
        return values


@dataclass(frozen=True)
class SimulatedScene:
    """A scene and its labels."""

    scene: Scene
    """The object at rest; (480, 640) images."""
    rectangles: npt.NDArray[np.float64]
    """(n, 4, 2) corners (row, col) in pixels."""
    tried: bool
    """Whether the labels were tried in simulation, because the usual rule gave too few."""


def simulate_scene(world: World, index: int, settings: Simulation) -> SimulatedScene:
    """Make one scene; it depends on `settings` and `index` alone.

    Objects that cannot have one of the sides, do not come to rest, or offer too few grasps, are replaced by others.

    Args:
        world: is reset first.
        index: which of the endless scenes with these settings.
        settings: camera, noise and labels.

    Returns:
        The object at rest, seen by the camera, and its labels.

    Raises:
        DatasetError: no object offers enough grasps.
    """
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([settings.seed, index, attempt])
        try:
            model = training_object(index * _ATTEMPTS + attempt, settings.seed, settings.protocol, settings.sides)
        except ObjectSetError:  # of a family that no such side fits
            continue
        body, stable, drops = drop_object(world, model, rng)
        if not stable:
            continue
        position, orientation = world.pose_of(body)
        x, y = rng.uniform(-settings.camera_offset, settings.camera_offset, 2)
        camera = _camera(position, (x, y, rng.uniform(*settings.camera_heights)))
        depth, rgb = camera.render(world.client)
        scene = Scene(model, index, position, orientation, stable, drops, depth, rgb, camera)
        tried = False
        labels = label_grasps(world, body, scene, settings.place, settings.gripper)
        if len(labels.grasps) < settings.least_labels and settings.tried_labels:
            tried = True
            labels = tried_grasps(world, body, scene, settings.place, settings.gripper, settings.protocol, rng)
        if len(labels.grasps) >= settings.least_labels:
            rectangles = label_rectangles(labels, depth, camera)
            return SimulatedScene(replace(scene, depth=_degrade(depth, rng, settings)), rectangles, tried)
    raise DatasetError(
        f"expected a scene with {settings.least_labels} labels or more, received none in {_ATTEMPTS} attempts: lower "
        "least_labels, or allow more sides"
    )


def _camera(target: tuple[float, float, float], position: tuple[float, float, float]) -> Camera:
    """The benchmark's camera with a larger image: the same angle a pixel, and Cornell's number of pixels."""
    benchmark = Camera(target)
    fov = 2 * np.degrees(np.arctan(_IMAGE[0] / 2 / benchmark.focal_px))
    return Camera(target, position, fov=float(fov), height=_IMAGE[0], width=_IMAGE[1])


def _degrade(depth: npt.NDArray[np.float32], rng: np.random.Generator, settings: Simulation) -> npt.NDArray[np.float32]:
    """Depth with the noise and the missing pixels of a real camera."""
    noisy = depth + rng.normal(size=depth.shape) * settings.noise * depth**2 if settings.noise else depth
    if not settings.missing:
        return noisy.astype(np.float32)
    edges = np.hypot(*np.gradient(depth)) > _EDGE
    lost = cv2.dilate(edges.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    return fill_missing(noisy, lost & (rng.random(depth.shape) < settings.missing))


def simulate_folder(
    folder: Path,
    scenes: int,
    settings: Simulation,
    workers: int,
    on_progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, int]:
    """Write scenes in the form of the Cornell dataset; those that are there are kept: a stopped call goes on.

    Layout: NN/pcdNNNNr.png, d.tiff (float32 metres), cpos.txt (corners "x y", four lines a rectangle) and scene.json
    (object, pose, camera), a hundred scenes a sub-folder; z.txt (scene, number and name of the shape); simulation.json.

    Args:
        folder: where to write; need not exist.
        scenes: how many; more can be added later by calling again with more.
        settings: what they are like.
        workers: processes; the files do not depend on their number.
        on_progress: called with (scenes that are there, scenes in all).

    Returns:
        Number of labels of each scene.

    Raises:
        DatasetError: the folder holds scenes with other settings, too many scenes are asked for, or another process
            writes to the folder.
    """
    if not 1 <= scenes <= MAX_SCENES:
        raise DatasetError(f"expected 1 to {MAX_SCENES} scenes, received {scenes}")
    refusal = DatasetError(
        f"expected {folder} to be free, another process writes scenes there: wait for it, or choose another folder"
    )
    with alone(folder / "scenes.lock", refusal):
        _claim(folder, settings)
        try:
            _write_missing(folder, scenes, settings, workers, on_progress)
        finally:
            records = _list_objects(folder)
    return {record["name"]: record["labels"] for record in records[:scenes]}


def _list_objects(folder: Path) -> list[dict[str, Any]]:
    """Write z.txt of the scenes that are there, and return what is known of them."""
    written = [file for index in range(MAX_SCENES) if (file := _file(folder, index, "scene.json")).is_file()]
    records = [json.loads(file.read_text()) for file in written]
    shapes = {record["name"]: record.get("shape", record["object"]) for record in records}
    numbers = {shape: number for number, shape in enumerate(sorted(set(shapes.values())))}
    lines = (f"{name.removeprefix(_PREFIX)} {numbers[shape]} {shape}\n" for name, shape in shapes.items())
    write_text(folder / "z.txt", "".join(lines))
    return records


def _write_missing(
    folder: Path, scenes: int, settings: Simulation, workers: int, on_progress: Callable[[int, int], None]
) -> None:
    missing = [index for index in range(scenes) if not _file(folder, index, "scene.json").is_file()]
    done = scenes - len(missing)
    on_progress(done, scenes)
    inputs = ((folder, index, settings) for index in missing)
    for position, result in run_parallel(_write_scene, inputs, workers):
        if isinstance(result, Crash):
            raise DatasetError(
                f"a worker died {result.attempts} times on scene {missing[position]} (exit code {result.exit_code}): "
                "memory full? Call again to go on"
            )
        done += 1
        on_progress(done, scenes)


def _claim(folder: Path, settings: Simulation) -> None:
    """Write the settings into a new folder, or see that they are those of an old one."""
    expected = {"format": FORMAT, **settings.as_dict()}
    path = folder / "simulation.json"
    if not path.is_file():
        write_text(path, json.dumps(expected, indent=1) + "\n")
        return
    try:
        found = dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise DatasetError(f"expected the settings of simulated scenes in {path}: {error}") from error
    usual = {"gripper": "the paper's", "tried_labels": "none", "sides": "all"}
    here, there = ({**usual, **values} for values in (expected, found))
    differing = [name for name in here if there.get(name) != here[name]]
    if differing:
        raise DatasetError(
            f"expected scenes with these settings in {folder}, it differs in "
            + ", ".join(f"{name} ({there.get(name)} there, {here[name]} here)" for name in differing)
            + ": choose another folder, or its settings"
        )


def _name(index: int) -> str:
    return f"{_PREFIX}{index:04d}"


def _file(folder: Path, index: int, suffix: str) -> Path:
    return folder / f"{index // FOLDER_SIZE + 1:02d}" / f"{_name(index)}{suffix}"


def _write_scene(folder: Path, index: int, settings: Simulation) -> None:
    """Make and write one scene, its JSON last: a scene that has it is whole. Runs in a worker process."""
    made = simulate_scene(process_world(), index, settings)
    scene = made.scene
    with replacing(_file(folder, index, "r.png")) as path:
        _write_image(path, scene.rgb[..., ::-1])
    with replacing(_file(folder, index, "d.tiff")) as path:
        _write_image(path, scene.depth, [cv2.IMWRITE_TIFF_COMPRESSION, 8])  # 8: deflate
    corners = made.rectangles.reshape(-1, 2)
    write_text(_file(folder, index, "cpos.txt"), "".join(f"{col:.2f} {row:.2f}\n" for row, col in corners.tolist()))
    record = {
        "name": _name(index),
        "object": scene.model.name,
        "shape": shape_of(scene.model),
        "longest_side": scene.model.longest_side,
        "position": scene.position,
        "orientation": scene.orientation,
        "camera": asdict(scene.camera),
        "labels": len(made.rectangles),
        "tried": made.tried,
    }
    write_text(_file(folder, index, "scene.json"), json.dumps(record) + "\n")


def _write_image(path: Path, image: npt.NDArray[Any], options: list[int] | None = None) -> None:
    if not cv2.imwrite(str(path), image, options or []):  # OpenCV does not raise
        raise DatasetError(f"cannot write {path}: is the disk full?")
