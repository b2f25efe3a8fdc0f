"""From grasp rectangles to the maps that a GG-CNN learns (RSS 2018, section V-B)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import RSS_2018, closing_angles

FloatMap = npt.NDArray[np.float32]


class LabelMaps(NamedTuple):
    """Labels of an image, each (H, W) float32; 0 wherever no grasp is labelled."""

    quality: FloatMap
    """1 where a grasp may be centred."""
    angle: FloatMap
    """Closing direction of that grasp in radians, [-π/2, π/2)."""
    width: FloatMap
    """Its opening in pixels."""


def draw_label_maps(rectangles: npt.ArrayLike, shape: tuple[int, int] = (300, 300)) -> LabelMaps:
    """Draw the centre third (along the opening) of every rectangle, in order: a later one covers earlier ones.

    A pixel belongs to a rectangle when its centre lies in it, the rule of `skimage.draw.polygon`. Unlike the public
    code, corners are not truncated to whole pixels before, which moves labels up and left by half a pixel.

    Args:
        rectangles: (n, 4, 2) corners (row, col) in pixels, the opening along the edge 0-1; parts outside are cut off.
        shape: height and width of the maps.

    Returns:
        Quality, angle in radians and opening in pixels, each of this shape, float32; 0 where there is no label.

    Raises:
        DatasetError: another shape, values that are not finite, or an edge 0-1 of length zero.
    """
    corners = checked_rectangles(rectangles)
    closing = corners[:, 1] - corners[:, 0]
    opening = np.hypot(closing[:, 0], closing[:, 1])
    angle = closing_angles(corners)
    half_jaw = np.hypot(*(corners[:, 2] - corners[:, 1]).T) / 2
    half_third = opening / 6
    centre = corners.mean(axis=1)
    direction = closing / opening[:, None]
    # Half the height and width of the upright box around each centre third.
    reach = np.abs(direction) * half_third[:, None] + np.abs(direction[:, ::-1]) * half_jaw[:, None]
    first = np.clip(np.floor(centre - reach), 0, shape).astype(int)
    last = np.clip(np.ceil(centre + reach) + 1, 0, shape).astype(int)

    drawn = np.zeros(shape, dtype=np.int32)  # 1 + index of the rectangle on top
    for index, ((top, left), (bottom, right)) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        row = np.arange(top, bottom)[:, None] - centre[index, 0]
        col = np.arange(left, right) - centre[index, 1]
        down, rightwards = direction[index]
        along_opening = row * down + col * rightwards
        along_jaw = row * rightwards - col * down
        inside = np.abs(along_opening, out=along_opening) <= half_third[index]
        inside &= np.abs(along_jaw, out=along_jaw) <= half_jaw[index]
        drawn[top:bottom, left:right][inside] = index + 1

    def of_each(values: npt.NDArray[np.float64]) -> FloatMap:
        return np.concatenate([[0.0], values]).astype(np.float32)[drawn]

    return LabelMaps((drawn > 0).astype(np.float32), of_each(angle), of_each(opening))


def targets_of(quality: npt.ArrayLike, angle: npt.ArrayLike, width: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """What the four heads are trained on.

    Args:
        quality: (..., H, W) label map.
        angle: label map in radians.
        width: label map in pixels.

    Returns:
        (..., H, W, 4) quality, cos 2θ, sin 2θ, and the width clipped to 150 px and divided by it. Background has the
        angle 0, hence cos 1 and sin 0.
    """
    double = 2 * np.asarray(angle, dtype=np.float32)
    scale = np.float32(RSS_2018.width_scale)
    fraction = np.clip(np.asarray(width, dtype=np.float32), 0, scale) / scale
    return np.stack([np.asarray(quality, dtype=np.float32), np.cos(double), np.sin(double), fraction], axis=-1)


def checked_rectangles(rectangles: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Rectangles as (n, 4, 2) float64.

    Args:
        rectangles: (n, 4, 2) corners (row, col), or none at all.

    Returns:
        The rectangles as an array; (0, 4, 2) for none.

    Raises:
        DatasetError: another shape, values that are not finite, or an edge 0-1 of length zero.
    """
    corners = np.asarray(rectangles, dtype=np.float64)
    if corners.size == 0:
        return corners.reshape(0, 4, 2)
    if corners.ndim != 3 or corners.shape[1:] != (4, 2):
        raise DatasetError(f"expected grasp rectangles as (n, 4, 2) corners (row, col), received {corners.shape}")
    usable = np.isfinite(corners).all(axis=(1, 2)) & (corners[:, 0] != corners[:, 1]).any(axis=1)
    if not usable.all():
        index = int(np.argmin(usable))
        raise DatasetError(
            f"expected finite grasp rectangles with an opening (edge 0-1) above 0, received number {index}: "
            f"{corners[index].tolist()}"
        )
    return corners
