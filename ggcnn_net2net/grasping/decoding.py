"""From the four maps of a GG-CNN to grasps (RSS 2018, section IV, and the public code that goes with it)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skimage.feature import peak_local_max
from skimage.filters import gaussian

from ggcnn_net2net.errors import GraspError
from ggcnn_net2net.grasping.geometry import Grasp, wrap_angle

FloatMap = npt.NDArray[np.floating]


@dataclass(frozen=True)
class Decoding:
    """Constants of the decoding. The defaults are those of the RSS 2018 code."""

    quality_sigma: float = 5.0
    """Standard deviation in pixels of the Gaussian that smooths the quality."""
    width_sigma: float = 1.0
    """The same for the width."""
    width_scale: float = 150.0
    """Pixels that a width of 1 stands for."""
    min_distance: int = 20
    """Least distance in pixels between two grasps, and between a grasp and the image border."""
    threshold: float = 0.2
    """Least smoothed quality of a grasp."""
    angle_window: int = 0
    """Half side of the window from which the angle is taken: its largest angle where the peak's is positive, else its
    smallest (`ang_threshold` of the public code: 5 in the simulator, 0 for the IoU rate). 0: the peak's own angle."""


RSS_2018 = Decoding()


def decode_maps(
    quality: npt.ArrayLike,
    cos: npt.ArrayLike,
    sin: npt.ArrayLike,
    width: npt.ArrayLike,
    n_grasps: int = 1,
    decoding: Decoding = RSS_2018,
) -> list[Grasp]:
    """Find the best grasps in a network's output.

    Args:
        quality: (H, W) or (H, W, 1) output pos_out, 1 at a good grasp.
        cos: output cos_out, cos 2θ.
        sin: output sin_out, sin 2θ.
        width: output width_out, opening divided by `decoding.width_scale`.
        n_grasps: the most grasps to return.
        decoding: constants.

    Returns:
        Up to `n_grasps` grasps, best first; an empty list where no smoothed quality reaches the threshold. Centres are
        whole pixels.

    Raises:
        GraspError: maps of different or wrong shape, values that are not finite, n_grasps below 1.
    """
    if n_grasps < 1:
        raise GraspError(f"expected n_grasps of 1 or more, received {n_grasps}")
    maps = [_as_map(name, values) for name, values in zip(_NAMES, (quality, cos, sin, width), strict=True)]
    if len({values.shape for values in maps}) > 1:
        received = ", ".join(f"{name} {values.shape}" for name, values in zip(_NAMES, maps, strict=True))
        raise GraspError(f"expected four maps of one shape, received {received}")
    smooth_quality = gaussian(maps[0], decoding.quality_sigma, preserve_range=True)
    smooth_width = gaussian(maps[3], decoding.width_sigma, preserve_range=True) * decoding.width_scale
    angle = np.arctan2(maps[2], maps[1]) / 2
    peaks = peak_local_max(
        smooth_quality,
        min_distance=decoding.min_distance,
        threshold_abs=decoding.threshold,
        num_peaks=n_grasps,
    )
    return [
        Grasp(
            row=float(row),
            col=float(col),
            angle=wrap_angle(_angle_at(angle, row, col, decoding.angle_window)),
            width_px=max(float(smooth_width[row, col]), 0.0),
            quality=float(smooth_quality[row, col]),
        )
        for row, col in peaks.tolist()
    ]


_NAMES = ("quality", "cos", "sin", "width")


def _as_map(name: str, values: npt.ArrayLike) -> FloatMap:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 3 and array.shape[-1] == 1:
        array = array[..., 0]
    if array.ndim != 2 or array.size == 0:
        raise GraspError(f"expected the {name} map as (height, width), received shape {array.shape}")
    if not np.isfinite(array).all():
        raise GraspError(f"expected a finite {name} map, received NaN or infinity: check the depth image and weights")
    return array


def _angle_at(angle: FloatMap, row: int, col: int, half_side: int) -> float:
    """Angle of a peak; the window is cut at the image border (a negative index would wrap around to the other side)."""
    if half_side == 0:
        return float(angle[row, col])
    top, left = max(row - half_side, 0), max(col - half_side, 0)
    window = angle[top : row + half_side + 1, left : col + half_side + 1]
    return float(window.max() if angle[row, col] > 0 else window.min())
