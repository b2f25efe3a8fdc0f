"""What the network sees of a depth image: a window of it, filled in, resized, centred and clipped."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.inference.presets import Preset
from ggcnn_net2net.inpainting import fill_missing

FloatMap = npt.NDArray[np.float32]

_STRIDE = 12
"""Product of a GG-CNN's downward strides, 3 * 2 * 2: maps have the image's size only if it is a multiple of this."""


@dataclass(frozen=True)
class Window:
    """A part of the image, and the size in which the network sees it; pixels, (0, 0) is the image's first one."""

    top: int
    left: int
    height: int
    width: int
    scale: float = 1.0
    """Image pixels a network pixel."""

    @property
    def network_shape(self) -> tuple[int, int]:
        """Rows and columns of the network's image."""
        return round(self.height / self.scale), round(self.width / self.scale)

    def cut(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The window's part of an image (H, W)."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def to_image(self, grasp: Grasp) -> Grasp:
        """A grasp of the network's image in pixels of the whole image. Rows and columns are scaled alike: angles
        stay."""
        return replace(
            grasp,
            row=self.top + (grasp.row + 0.5) * self.scale - 0.5,
            col=self.left + (grasp.col + 0.5) * self.scale - 0.5,
            width_px=grasp.width_px * self.scale,
        )


def crop_window(shape: tuple[int, ...], preset: Preset, network_side: int) -> Window:
    """The centre square of an image that a preset shows the network.

    Args:
        shape: (H, W) of the image.
        preset: its `crop` and `crop_up`; cut down to the image.
        network_side: side of the network's image in pixels.
    """
    height, width = shape
    side = min(height, width, preset.crop or max(height, width))
    top = min(max((height - side) // 2 - preset.crop_up, 0), height - side)
    return Window(top, (width - side) // 2, side, side, side / network_side)


def network_input(metres: FloatMap, window: Window, preset: Preset) -> tuple[FloatMap, npt.NDArray[np.bool_]]:
    """The network's image of a depth image.

    Args:
        metres: (H, W), NaN where missing.
        window: part of the image.
        preset: order of the steps and constants.

    Returns:
        (h, w) depth in metres minus its mean, of the window's `network_shape`; and (h, w) which of its pixels are
        missing.

    Raises:
        DepthImageError: every pixel of the window is missing.
    """
    view = window.cut(metres)
    if preset.resize_before_filling:
        view = _resized(view, window.network_shape)
    missing = np.isnan(view)
    if preset.missing_margin:
        missing = _widened(missing, preset.missing_margin)
    if missing.all():
        raise DepthImageError(
            f"expected depth, every pixel of rows {window.top} to {window.top + window.height - 1} and columns "
            f"{window.left} to {window.left + window.width - 1}, which the network sees, is missing"
        )
    filled = _resized(fill_missing(view, missing), window.network_shape)
    centred = filled - filled.mean()
    if preset.clip is not None:
        centred = np.clip(centred, -preset.clip, preset.clip)
    return centred, _resized(missing.astype(np.float32), window.network_shape) > 0.5


def padded(image: FloatMap) -> FloatMap:
    """An image that goes on with its last row and column to the next multiple of the network's stride."""
    height, width = image.shape
    return np.pad(image, ((0, -height % _STRIDE), (0, -width % _STRIDE)), mode="edge")


def _resized(image: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """Bilinear, as the public ROS nodes do it: a pixel is missing (NaN) if one that it is made of is."""
    import cv2

    if image.shape == shape:
        return image
    return cv2.resize(image, shape[::-1], interpolation=cv2.INTER_LINEAR).astype(np.float32, copy=False)


def _widened(missing: npt.NDArray[np.bool_], pixels: int) -> npt.NDArray[np.bool_]:
    import cv2

    return cv2.dilate(missing.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=pixels) > 0
