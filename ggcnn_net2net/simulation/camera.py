"""The benchmark's depth camera, and the geometry between its pixels and the world.

Frame of the image: row 0 is the top, column 0 the left. Depth is the distance along the optical axis in metres. The
TinyRenderer samples a pixel at its left and lower edge, so column c shows the ray through c - width / 2 and row r the
one through height / 2 - 1 - r (measured with boxes of known size; the public code of the paper is one row off).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera at `position` that looks at `target`. The defaults are the paper's simulator."""

    target: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 1.5)
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov: float = 40.0
    """Vertical field of view in degrees."""
    near: float = 0.1
    far: float = 5.0
    width: int = 300
    height: int = 300

    @cached_property
    def view_matrix(self) -> tuple[float, ...]:
        """World to camera, column-major as pybullet wants it."""
        return pybullet.computeViewMatrix(self.position, self.target, self.up)

    @cached_property
    def projection_matrix(self) -> tuple[float, ...]:
        """Camera to clip coordinates, column-major as pybullet wants it."""
        return pybullet.computeProjectionMatrixFOV(self.fov, self.width / self.height, self.near, self.far)

    @cached_property
    def T_camera_world(self) -> FloatArray:
        """(4, 4) world to camera; the camera looks along its -z, its y is up in the image."""
        return np.array(self.view_matrix).reshape(4, 4).T

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.height / 2 / np.tan(np.radians(self.fov) / 2)

    def render(self, world: Any) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
        """Depth (height, width) in metres and RGB (height, width, 3) of what stands in `world` (a pybullet client).

        Always the TinyRenderer: renderers differ from each other, and it is the one that every machine has.

        Args:
            world: pybullet client of the world.

        Returns:
            Depth float32 and colour uint8.
        """
        _, _, rgba, buffer, _ = world.getCameraImage(
            self.width,
            self.height,
            self.view_matrix,
            self.projection_matrix,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        buffer = np.asarray(buffer, dtype=np.float64).reshape(self.height, self.width)
        depth = self.far * self.near / (self.far - (self.far - self.near) * buffer)
        rgb = np.asarray(rgba, dtype=np.uint8).reshape(self.height, self.width, 4)[..., :3]
        return depth.astype(np.float32), np.ascontiguousarray(rgb)

    def world_from_pixel(self, row: float, col: float, depth: float) -> FloatArray:
        """World point (3,) seen at a pixel at the given depth."""
        camera = np.array(
            [
                (col - self.width / 2) / self.focal_px * depth,
                (self.height / 2 - 1 - row) / self.focal_px * depth,
                -depth,
                1.0,
            ]
        )
        return np.linalg.solve(self.T_camera_world, camera)[:3]

    def world_from_image(self, depth: npt.NDArray[np.floating]) -> FloatArray:
        """World points (height, width, 3) of all pixels of a depth image (height, width)."""
        rows, cols = np.mgrid[: self.height, : self.width]
        x, y = (cols - self.width / 2) / self.focal_px, (self.height / 2 - 1 - rows) / self.focal_px
        camera = np.stack([x * depth, y * depth, -depth, np.ones_like(x)], axis=-1)
        return (camera @ np.linalg.inv(self.T_camera_world).T)[..., :3]

    def pixel_from_world(self, point: npt.ArrayLike) -> tuple[float, float, float]:
        """Row, column and depth at which a world point is seen."""
        x, y, z, _ = self.T_camera_world @ np.append(np.asarray(point, dtype=np.float64), 1.0)
        depth = -z
        return (
            float(self.height / 2 - 1 - y / depth * self.focal_px),
            float(self.width / 2 + x / depth * self.focal_px),
            float(depth),
        )
