"""Samples from scenes: rotated, cropped, zoomed and centred as GG-CNN's training data (public code of RSS 2018)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.datasets.label_maps import LabelMaps, checked_rectangles, draw_label_maps
from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.errors import DatasetError


@dataclass(frozen=True)
class Augmentation:
    """How samples are drawn from a scene. The defaults are those of the public GG-CNN code."""

    size: int = 300
    """Side of a sample in pixels."""
    zoom: tuple[float, float] = (0.4, 1.0)
    """Range of the zoom factor: a sample shows the middle `zoom` x size pixels of the crop. Depth values stay."""
    rotate: bool = True
    """Whether to rotate by a uniformly random angle."""
    per_scene: int = 10
    """Samples drawn from each scene."""

    def __post_init__(self) -> None:
        low, high = self.zoom
        if not (self.size >= 1 and 0 < low <= high <= 1 and self.per_scene >= 1):
            raise DatasetError(
                "expected a size and per_scene of 1 or more and a zoom range within (0, 1], "
                f"received size={self.size}, zoom={self.zoom}, per_scene={self.per_scene}"
            )

    def as_dict(self) -> dict[str, Any]:
        """Field names and values, for provenance."""
        return {**asdict(self), "zoom": list(self.zoom)}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Augmentation:
        """The inverse of `as_dict`."""
        return cls(**{**values, "zoom": tuple(values["zoom"])})


PLAIN = Augmentation(zoom=(1.0, 1.0), rotate=False, per_scene=1)
"""Only the crop around the grasps: for scoring on what the camera saw."""


@dataclass(frozen=True)
class Sample:
    """One training image with its labels."""

    name: str
    """Name of the scene that it was drawn from."""
    depth: npt.NDArray[np.float32]
    """(H, W) metres minus their mean, clipped to [-1, 1]: a network's input."""
    rgb: npt.NDArray[np.uint8]
    """(H, W, 3)."""
    rectangles: npt.NDArray[np.float64]
    """(n, 4, 2) corners (row, col) of all grasps, those outside of the image included."""
    maps: LabelMaps
    """Labels drawn from the rectangles."""


def augment(scene: LabelledScene, rng: np.random.Generator, settings: Augmentation) -> Sample:
    """Draw a sample from a scene.

    In order: a rotation by U(-π, π) about the mean of all corners; a crop of `size` x `size` around that point, moved
    to lie within the image; a zoom to the crop's middle; the mean subtracted and clipping to ±1 m. What lies outside of
    the image is its mirror image.

    The three steps are one bilinear interpolation here, and two in the public code. The public code also truncates
    corners, and the zoomed window, to whole pixels; here rectangles follow the image exactly.

    Args:
        scene: the scene; an image of at least `size` x `size`.
        rng: is asked for the angle (if `rotate`), then for the zoom factor.
        settings: size, zoom and rotation.

    Returns:
        The sample, `size` x `size`: depth in metres minus its mean, colour, rectangles in its pixels, label maps.

    Raises:
        DatasetError: the image is too small, has missing depth, or there is no rectangle to crop around.
    """
    rectangles = checked_rectangles(scene.rectangles)
    _check_scene(scene, len(rectangles), settings.size)
    angle = rng.uniform(-np.pi, np.pi) if settings.rotate else 0.0
    zoom = rng.uniform(*settings.zoom)
    to_sample = _transform(rectangles.mean(axis=(0, 1)), scene.depth.shape, settings.size, angle, zoom)
    corners = rectangles @ to_sample[:, :2].T + to_sample[:, 2]
    depth = _warp(scene.depth.astype(np.float32, copy=False), to_sample, settings.size)
    shape = (settings.size, settings.size)
    return Sample(
        scene.name,
        np.clip(depth - depth.mean(), -1, 1),
        _warp(scene.rgb, to_sample, settings.size),
        corners,
        draw_label_maps(corners, shape),
    )


def _transform(
    centre: npt.NDArray[np.float64], shape: tuple[int, ...], size: int, angle: float, zoom: float
) -> npt.NDArray[np.float64]:
    """(2, 3) matrix that takes (row, col) of the scene to (row, col) of the sample."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])  # counter-clockwise as seen
    corner = np.clip(np.floor(centre) - size // 2, 0, np.array(shape[:2]) - size)
    middle = (size - 1) / 2
    # rotated = turn (p - centre) + centre; sample = (rotated - corner - middle) / zoom + middle
    offset = (centre - turn @ centre - corner - middle) / zoom + middle
    return np.column_stack([turn / zoom, offset])


def _warp(image: npt.NDArray[Any], to_sample: npt.NDArray[np.float64], size: int) -> npt.NDArray[Any]:
    import cv2

    # OpenCV counts (x, y) = (col, row): both axes of the matrix are exchanged.
    matrix = np.column_stack([to_sample[::-1, 1::-1], to_sample[::-1, 2]])
    return cv2.warpAffine(image, matrix, (size, size), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


def _check_scene(scene: LabelledScene, rectangles: int, size: int) -> None:
    if min(scene.depth.shape) < size or scene.rgb.shape[:2] != scene.depth.shape:
        raise DatasetError(
            f"expected depth and colour of {scene.name} in one size of at least {size}x{size}, received depth "
            f"{scene.depth.shape}, colour {scene.rgb.shape}"
        )
    if rectangles == 0:
        raise DatasetError(f"expected grasp rectangles in {scene.name}, received none: leave the scene out")
    if not np.isfinite(scene.depth).all():
        raise DatasetError(f"expected finite depth in {scene.name}, received NaN or infinity: fill in missing pixels")
