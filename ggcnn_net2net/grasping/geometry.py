"""Grasps and grasp rectangles in image coordinates.

Frame: pixels, rows grow downwards, columns to the right, integers at pixel centres. An angle is measured from the
column axis, counter-clockwise as one sees the image, and is the direction in which the jaws close. A parallel gripper
turned by π is the same gripper, so angles lie in [-π/2, π/2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import GraspError


@dataclass(frozen=True)
class Grasp:
    """An antipodal grasp in the image (RSS 2018, section III-A)."""

    row: float
    """Row of the centre in pixels."""
    col: float
    """Column of the centre in pixels."""
    angle: float
    """Closing direction of the jaws in radians, [-π/2, π/2)."""
    width_px: float
    """Opening of the gripper in pixels: the length of the grasp rectangle."""
    quality: float = 1.0
    """Predicted quality, 0 to 1."""


def wrap_angle(angle: float) -> float:
    """The same closing direction in [-π/2, π/2), radians.

    Args:
        angle: radians, any number of turns.

    Returns:
        The angle plus a multiple of π.
    """
    return float(_wrapped(np.asarray(angle, dtype=np.float64)))


def closing_angles(rectangles: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Closing directions of rectangles (n, 4, 2), (n,) radians in [-π/2, π/2); 0 where edge 0-1 has no length.

    Args:
        rectangles: (n, 4, 2) corners (row, col) in pixels, the closing direction along the edge 0-1.

    Returns:
        (n,) radians, counter-clockwise from the column axis.
    """
    start, end = rectangles[:, 0], rectangles[:, 1]
    return _wrapped(np.arctan2(start[:, 0] - end[:, 0], end[:, 1] - start[:, 1]))


def _wrapped(angles: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    wrapped = (angles + np.pi / 2) % np.pi - np.pi / 2
    return np.where(wrapped >= np.pi / 2, -np.pi / 2, wrapped)  # just below a multiple of π, % may round up to π


def grasp_to_rectangle(grasp: Grasp, jaw_px: float | None = None) -> npt.NDArray[np.float64]:
    """Corners of a grasp rectangle.

    Args:
        grasp: the grasp.
        jaw_px: the rectangle's other side, along the jaws, in pixels. None: half of the opening, as the public GG-CNN
            code draws it.

    Returns:
        (4, 2) corners (row, col). The edge from corner 0 to corner 1 runs in the closing direction and is
        `grasp.width_px` long.
    """
    if jaw_px is None:
        jaw_px = grasp.width_px / 2
    closing = np.array([-np.sin(grasp.angle), np.cos(grasp.angle)])  # (row, col); rows grow downwards
    along_jaw = np.array([np.cos(grasp.angle), np.sin(grasp.angle)])
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    corners = np.outer(signs[:, 0] * grasp.width_px, closing) + np.outer(signs[:, 1] * jaw_px, along_jaw)
    return corners + np.array([grasp.row, grasp.col])


def rectangle_to_grasp(corners: npt.ArrayLike) -> tuple[Grasp, float]:
    """Grasp of a rectangle: the inverse of `grasp_to_rectangle`.

    Args:
        corners: (4, 2) corners (row, col) in order, the closing direction along the edge 0-1 (as in Cornell's files).

    Returns:
        The grasp and the side along the jaws in pixels.

    Raises:
        GraspError: another shape, values that are not finite, or an edge 0-1 of length zero.
    """
    points = np.asarray(corners, dtype=np.float64)
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise GraspError(f"expected 4 finite corners (row, col), received shape {points.shape}: {points.tolist()}")
    closing = points[1] - points[0]
    width = float(np.hypot(*closing))
    if width == 0:
        raise GraspError(f"expected a rectangle with an edge 0-1 of positive length, received {points.tolist()}")
    row, col = points.mean(axis=0)
    angle = wrap_angle(np.arctan2(-closing[0], closing[1]))
    return Grasp(float(row), float(col), angle, width), float(np.hypot(*(points[2] - points[1])))
