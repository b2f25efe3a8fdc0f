"""The Cornell Grasping Dataset as it is distributed: pcdNNNNr.png, pcdNNNN.txt or pcdNNNNd.tiff, pcdNNNNcpos.txt."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.datasets.raw import Problem, SceneFolder, read_image
from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.inpainting import fill_missing

SHAPE = (480, 640)
"""Rows and columns of the camera, by which a cloud's point index counts pixels."""
_NAME = re.compile(r"(pcd\d{4})(cpos\.txt|r\.png)")
_PLAUSIBLE = (0.05, 20.0)  # metres of median depth; anything else is in another unit


@dataclass(frozen=True)
class CornellFile:
    """One scene of a Cornell folder."""

    name: str
    object_name: str
    folder: Path
    rectangles: tuple[tuple[tuple[float, float], ...], ...]
    """Four corners (row, col) each."""

    def read(self) -> LabelledScene:
        """Read depth and colour.

        Returns:
            The scene, 480x640, depth in metres without missing pixels.

        Raises:
            DatasetError: a file that is missing or damaged, or images of different sizes.
        """
        rgb = read_image(self.folder / f"{self.name}r.png", colour=True)
        tiff = _tiff_of(self.folder, self.name)
        depth = read_depth(tiff) if tiff else read_cloud(self.folder / f"{self.name}.txt")
        if rgb.shape[:2] != depth.shape:
            raise DatasetError(
                f"expected colour and depth of {self.name} in one size, received {rgb.shape[:2]} and {depth.shape}"
            )
        return LabelledScene(self.name, self.object_name, depth, rgb, np.array(self.rectangles))


def open_cornell(path: Path) -> SceneFolder:
    """The scenes of a Cornell folder, ordered by name.

    Scenes lie in the folder itself or in its sub-folders (01 to 10). A list of objects, z.txt, is looked for in the
    folder and in its sub-folder processedData; without it each scene counts as an object of its own.

    Args:
        path: the folder.

    Returns:
        The scenes, and the files that were left out and why.

    Raises:
        DatasetError: no usable scene in it.
    """
    problems: list[Problem] = []
    found: dict[str, Path] = {}
    for file in sorted([*path.glob("pcd*"), *path.glob("*/pcd*")]):
        match = _NAME.fullmatch(file.name)
        if match and found.setdefault(match[1], file.parent) != file.parent:
            problems.append(
                Problem(_within(path, file), f"left out: {match[1]} is also in {_within(path, found[match[1]])}")
            )
    listed = _read_objects(path, problems)
    files = []
    for name, folder in sorted(found.items()):
        lacking = _lacking(folder, name)
        if lacking:
            problems.append(Problem(_within(path, folder / name), f"scene left out: no {lacking}"))
            continue
        labels = folder / f"{name}cpos.txt"
        rectangles, flaws = read_rectangles(labels)
        problems += [Problem(_within(path, labels), flaw) for flaw in flaws]
        if len(rectangles):
            corners = tuple(tuple((row, col) for row, col in corners) for corners in rectangles.tolist())
            files.append(CornellFile(name, (listed or {}).get(name, name), folder, corners))
        else:
            problems.append(Problem(_within(path, labels), "scene left out: no usable rectangle"))
    if not files:
        raise DatasetError(
            f"expected scenes pcdNNNNr.png, pcdNNNNcpos.txt and pcdNNNN.txt or pcdNNNNd.tiff in {path} or its "
            f"sub-folders, found none" + "".join(f"; {problem.file}: {problem.problem}" for problem in problems[:3])
        )
    unlisted = [file.name for file in files if file.name not in (listed or {})]
    if listed is not None and unlisted:
        problems.append(
            Problem(
                "z.txt",
                f"{len(unlisted)} scenes are not in it, {unlisted[0]} for one: each counts as an object of its own",
            )
        )
    return SceneFolder(path, "cornell", tuple(files), tuple(problems))


def read_rectangles(path: Path) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Rectangles of a cpos.txt: four lines "x y" each, corner after corner; the edge 0-1 is the opening.

    The public code rounds corners to whole pixels; here they stay as they are.

    Args:
        path: the labels, pcdNNNNcpos.txt.

    Returns:
        (n, 4, 2) corners (row, col), and what was left out: NaN, text, corners that coincide, less than four lines.
    """
    lines = [line for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    flaws, rectangles = [], []
    if len(lines) % 4:
        flaws.append(f"the last {len(lines) % 4} lines left out: expected 4 a rectangle, received {len(lines)} in all")
    for first in range(0, len(lines) - 3, 4):
        corners = _corners(lines[first : first + 4])
        if corners is None:
            flaws.append(f"rectangle in lines {first + 1}-{first + 4} left out: not four different corners 'x y'")
        else:
            rectangles.append(corners)
    return np.array(rectangles).reshape(-1, 4, 2), flaws


def read_depth(path: Path) -> npt.NDArray[np.float32]:
    """Depth in metres of a tiff: floating-point metres, or whole millimetres; 0 and NaN are missing and filled in.

    Args:
        path: the tiff, pcdNNNNd.tiff.

    Returns:
        (H, W) float32 metres without missing pixels.

    Raises:
        DatasetError: not a depth image, or one in another unit.
    """
    image = read_image(path)
    if image.ndim != 2 or image.dtype not in (np.uint16, np.float32, np.float64):
        raise DatasetError(
            f"expected (H, W) depth as float metres or uint16 millimetres in {path}, received {image.dtype} "
            f"{image.shape}"
        )
    metres = image / 1000 if image.dtype == np.uint16 else image
    return _checked_depth(path, metres)


def read_cloud(path: Path) -> npt.NDArray[np.float32]:
    """Depth in metres of a cloud: lines "x y z rgb index" after "DATA ascii", millimetres in the robot's frame.

    Depth is the distance sqrt(x² + y² + z²), as in the public GG-CNN code. Point `index` lies in row index // 640 and
    column index % 640. Pixels without a point are filled in.

    Args:
        path: the cloud, pcdNNNN.txt.

    Returns:
        (480, 640) float32 metres without missing pixels.

    Raises:
        DatasetError: not such a cloud.
    """
    try:
        with path.open(encoding="ascii") as stream:
            header = next((line for line in stream if line.startswith("DATA")), "")
            if header.split() != ["DATA", "ascii"]:
                raise DatasetError(f"expected a cloud with a line 'DATA ascii' in {path}")
            points = np.loadtxt(stream, usecols=(0, 1, 2, 4), ndmin=2)
    except (OSError, ValueError) as error:
        raise DatasetError(f"expected a cloud with lines 'x y z rgb index' in {path}: {error}") from error
    index = points[:, 3].astype(np.int64)
    if len(index) == 0 or index.min() < 0 or index.max() >= SHAPE[0] * SHAPE[1]:
        raise DatasetError(f"expected points with an index of 0 to {SHAPE[0] * SHAPE[1] - 1} in {path}")
    metres = np.zeros(SHAPE)
    metres.flat[index] = np.linalg.norm(points[:, :3], axis=1) / 1000
    return _checked_depth(path, metres)


def _checked_depth(path: Path, metres: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    missing = ~(np.isfinite(metres) & (metres > 0))
    median = 0.0 if missing.all() else float(np.median(metres[~missing]))
    if not _PLAUSIBLE[0] <= median <= _PLAUSIBLE[1]:
        raise DatasetError(
            f"expected depth with a median of {_PLAUSIBLE[0]} to {_PLAUSIBLE[1]} m in {path}, received {median:g}: "
            "another unit?"
        )
    return fill_missing(metres, missing)


def _corners(lines: list[str]) -> list[list[float]] | None:
    try:
        corners = [[float(y), float(x)] for x, y in (line.split() for line in lines)]
    except ValueError:
        return None
    usable = np.isfinite(corners).all() and corners[0] != corners[1] and corners[1] != corners[2]
    return corners if usable else None


def _within(path: Path, file: Path) -> str:
    """Name of a file within the dataset: the same wherever the dataset lies."""
    return str(file.relative_to(path))


def _lacking(folder: Path, name: str) -> str | None:
    for suffix in ("r.png", "cpos.txt"):
        if not (folder / f"{name}{suffix}").is_file():
            return f"{name}{suffix}"
    if not (folder / f"{name}.txt").is_file() and _tiff_of(folder, name) is None:
        return f"{name}d.tiff, {name}d.tif or {name}.txt"
    return None


def _tiff_of(folder: Path, name: str) -> Path | None:
    candidates = (folder / f"{name}d.{suffix}" for suffix in ("tiff", "tif"))
    return next((path for path in candidates if path.is_file()), None)


def _read_objects(path: Path, problems: list[Problem]) -> dict[str, str] | None:
    """Scene -> object, from lines "NNNN object-number description ..." of z.txt; None where there is no such list."""
    table = next((file for file in (path / "z.txt", path / "processedData" / "z.txt") if file.is_file()), None)
    if table is None:
        problems.append(Problem("z.txt", "no list of objects: each scene counts as an object of its own"))
        return None
    objects: dict[str, str] = {}
    for number, line in enumerate(table.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        match = re.match(r"\s*(\d+)\s+(\d+)\s+(\S+)", line)
        if match:
            objects.setdefault(f"pcd{int(match[1]):04d}", f"{match[2]} {match[3]}")
        elif line.strip():
            problems.append(
                Problem(_within(path, table), f"line {number} left out: expected 'image object description'")
            )
    return objects
