"""A depth camera's intrinsics, and grasps in metres in its frame.

Frame: the camera's optical frame, as ROS names it (REP 103): x to the right, y down, z forward, metres. Depth is the
distance along z, not along the ray.
"""

from __future__ import annotations

import json
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import Grasp


@dataclass(frozen=True, kw_only=True)
class CameraGrasp(Grasp):
    """A grasp in the image, and in metres in the camera's optical frame (x right, y down, z forward).

    `angle` stays that of the image: from the column axis, counter-clockwise as one sees the image. About the optical
    axis, which points away from the viewer, that is a rotation by -angle: a gripper whose jaws close along its x axis
    is to be turned by -angle about the camera's z axis.
    """

    position: tuple[float, float, float]
    """(x, y, z) of the seen surface at the grasp's centre, metres."""
    closing_direction: tuple[float, float, float]
    """Unit vector along which the jaws close, parallel to the image: (cos angle, -sin angle, 0) where fx = fy."""
    opening: float
    """Opening of the gripper in metres: `width_px` * z / f, with f = fx = fy; in general width_px * z * |(cos(angle) /
    fx, sin(angle) / fy)|."""
    measured: bool
    """Whether the camera measured the depth at the grasp's pixel; if not, z is that of the nearest measured pixels."""


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole intrinsics of the image as it is handed over, before any crop; pixels, centres at whole numbers.

    Raises:
        DepthImageError: values that are not finite, or focal lengths that are not positive.
    """

    fx: float
    """Focal length along a row."""
    fy: float
    """Focal length along a column."""
    cx: float
    """Column of the optical axis."""
    cy: float
    """Row of the optical axis."""

    def __post_init__(self) -> None:
        values = astuple(self)
        if not (np.isfinite(values).all() and self.fx > 0 and self.fy > 0):
            raise DepthImageError(
                f"expected finite intrinsics with fx and fy above 0, received fx, fy, cx, cy = {values}: is the camera "
                "calibrated?"
            )

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Intrinsics:
        """Intrinsics of a camera matrix.

        Args:
            matrix: K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], (3, 3) or 9 numbers row by row, as in a ROS CameraInfo.

        Returns:
            The intrinsics, in pixels.

        Raises:
            DepthImageError: another shape, a skewed matrix, or one that is no camera's.
        """
        values = np.asarray(matrix, dtype=np.float64)
        if values.shape not in ((9,), (3, 3)):
            raise DepthImageError(f"expected a camera matrix K of 9 numbers, received shape {values.shape}")
        fx, skew, cx, below, fy, cy, *last = values.ravel().tolist()
        if values.any() and (skew != 0 or below != 0 or last != [0, 0, 1]):  # all zeros: not calibrated, told below
            raise DepthImageError(
                f"expected a camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], received {values.tolist()}"
            )
        return cls(fx, fy, cx, cy)

    def as_camera_grasp(self, grasp: Grasp, z: float, measured: bool = True) -> CameraGrasp:
        """A grasp in the image and in metres.

        Args:
            grasp: in pixels of the image that the intrinsics belong to.
            z: depth at its centre in metres.
            measured: see `CameraGrasp.measured`.

        Returns:
            The grasp with its position, closing direction and opening in the camera's optical frame, metres.
        """
        along = np.array([np.cos(grasp.angle) / self.fx, -np.sin(grasp.angle) / self.fy, 0.0])
        length = float(np.linalg.norm(along))
        x, y, z_direction = (along / length).tolist()
        return CameraGrasp(
            *astuple(grasp),
            position=((grasp.col - self.cx) / self.fx * z, (grasp.row - self.cy) / self.fy * z, z),
            closing_direction=(x, y, z_direction),
            opening=grasp.width_px * z * length,
            measured=measured,
        )


def as_intrinsics(camera: Any) -> Intrinsics:
    """The intrinsics that a camera is given by.

    Args:
        camera: `Intrinsics`, a camera matrix as `Intrinsics.from_matrix` takes it, or a ROS CameraInfo message (with
            `K`, or `k` in ROS 2).

    Returns:
        The intrinsics, in pixels.

    Raises:
        DepthImageError: none of these.
    """
    if isinstance(camera, Intrinsics):
        return camera
    matrix = next((getattr(camera, name) for name in ("K", "k") if hasattr(camera, name)), camera)
    try:
        return Intrinsics.from_matrix(matrix)
    except (TypeError, ValueError) as error:
        raise DepthImageError(f"expected Intrinsics, a camera matrix or a CameraInfo, received {camera!r}") from error


def read_intrinsics(path: Path) -> Intrinsics:
    """Intrinsics of a JSON file: an object with fx, fy, cx and cy, or with a camera matrix K or k.

    Args:
        path: the JSON file.

    Returns:
        The intrinsics, in pixels.

    Raises:
        DepthImageError: no such file, or another content.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        matrix = content.get("K", content.get("k"))
        if matrix is not None:
            return Intrinsics.from_matrix(matrix)
        return Intrinsics(*(float(content[name]) for name in ("fx", "fy", "cx", "cy")))
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise DepthImageError(
            f'expected a camera as {{"fx": ..., "fy": ..., "cx": ..., "cy": ...}} or {{"K": [9 numbers]}} in {path}, '
            f"cannot read it: {error!r}"
        ) from error
