"""The Jacquard dataset as it is distributed: OBJECT/K_OBJECT_grasps.txt, _RGB.png, _perfect_depth.tiff, ..."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.datasets.raw import Problem, SceneFolder, read_image
from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle
from ggcnn_net2net.inpainting import fill_missing

SIDE = 300
"""Side in pixels of the scenes read. Jacquard's images have 1024; a network that sees 300 sees the whole image so."""
_LABELS = "_grasps.txt"


@dataclass(frozen=True)
class JacquardFile:
    """One view of an object."""

    name: str
    """K_OBJECT."""
    object_name: str
    labels: Path
    depth: str
    """"perfect" (rendered) or "stereo" (from rendered stereo images, with holes)."""

    def read(self) -> LabelledScene:
        """Read the images and grasps, reduced to `SIDE` pixels (the mean of the pixels that a new one covers).

        Returns:
            The scene, (`SIDE`, `SIDE`), depth in metres without missing pixels.

        Raises:
            DatasetError: a file that is missing or damaged, or an image that is not square.
        """
        import cv2

        stem = str(self.labels)[: -len(_LABELS)]
        rgb = read_image(Path(f"{stem}_RGB.png"), colour=True)
        path = Path(f"{stem}_{self.depth}_depth.tiff")
        depth = read_image(path)
        side = depth.shape[0]
        if depth.dtype != np.float32 or depth.shape != (side, side) or rgb.shape != (side, side, 3):
            raise DatasetError(
                f"expected square float32 depth and colour of one size for {self.name}, received {depth.dtype} "
                f"{depth.shape} and {rgb.shape}"
            )
        filled = fill_missing(depth, ~(np.isfinite(depth) & (depth > 0)))  # the stereo images have -1 in holes
        small_depth, small_rgb = (
            cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA) for image in (filled, rgb)
        )
        rectangles = read_grasps(self.labels, SIDE / side)
        return LabelledScene(
            self.name, self.object_name, small_depth.astype(np.float32), small_rgb.astype(np.uint8), rectangles
        )


def open_jacquard(path: Path, depth: str = "perfect") -> SceneFolder:
    """The scenes of a Jacquard folder, at any level below it, ordered by object and view.

    Args:
        path: the folder.
        depth: "perfect" or "stereo".

    Returns:
        The scenes, and the files that were left out and why.

    Raises:
        DatasetError: another kind of depth, or no usable scene.
    """
    if depth not in ("perfect", "stereo"):
        raise DatasetError(f"expected the depth of Jacquard as perfect or stereo, received {depth!r}")
    problems: list[Problem] = []
    files: list[JacquardFile] = []
    found: set[str] = set()
    for labels in sorted(path.rglob(f"*{_LABELS}"), key=lambda file: (file.parent, file.name)):
        name = labels.name[: -len(_LABELS)]
        where = str(labels.relative_to(path))
        lacking = [
            f"{name}_{suffix}"
            for suffix in ("RGB.png", f"{depth}_depth.tiff")
            if not labels.with_name(f"{name}_{suffix}").is_file()
        ]
        if lacking:
            problems.append(Problem(where, f"scene left out: no {' and no '.join(lacking)}"))
            continue
        if name in found:
            problems.append(Problem(where, "scene left out: another folder has one of this name"))
            continue
        try:
            read_grasps(labels)
        except DatasetError as error:
            problems.append(Problem(where, f"scene left out: {error}"))
        else:
            found.add(name)
            files.append(JacquardFile(name, name.partition("_")[2] or name, labels, depth))
    if not files:
        raise DatasetError(
            f"expected scenes K_OBJECT_grasps.txt, _RGB.png and _{depth}_depth.tiff below {path}, found none"
            + "".join(f"; {problem.file}: {problem.problem}" for problem in problems[:3])
        )
    return SceneFolder(path, "jacquard", tuple(files), tuple(problems), depth)


def read_grasps(path: Path, scale: float = 1.0) -> npt.NDArray[np.float64]:
    """Rectangles of a grasps.txt: lines "x;y;angle in degrees;opening;jaw size", in pixels of the image.

    The angle is clockwise as one sees the image, so its sign changes.

    Args:
        path: the file.
        scale: by which all lengths are multiplied; pixel centres stay pixel centres.

    Returns:
        (n, 4, 2) corners (row, col), the edge 0-1 being the opening.

    Raises:
        DatasetError: other lines, values that are not finite, an opening of 0, or no line at all.
    """
    try:
        values = np.loadtxt(path, delimiter=";", ndmin=2)
    except (OSError, ValueError) as error:
        raise DatasetError(f"expected lines 'x;y;angle;opening;jaw' in {path}: {error}") from error
    if values.size == 0 or values.shape[1] != 5 or not np.isfinite(values).all() or (values[:, 3:] <= 0).any():
        raise DatasetError(f"expected lines of 5 finite numbers 'x;y;angle;opening;jaw', sizes above 0, in {path}")
    rectangles = [
        grasp_to_rectangle(Grasp(y, x, -np.radians(angle), opening), jaw) for x, y, angle, opening, jaw in values
    ]
    return (np.array(rectangles) + 0.5) * scale - 0.5
