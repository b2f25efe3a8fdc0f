"""From the four maps of a GG-CNN to grasps (RSS 2018, section IV, and the public code that goes with it)."""

from __future__ import annotations

from collections.abc import Iterable
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
    angle_sigma: float = 0.0
    """The same for the angle, 0 for none. Angles on either side of ±π/2, which mean the same, average to 0: a defect of
    the public code that smooths them."""
    border: str = "nearest"
    """How maps go on beyond the border when they are smoothed, in SciPy's words: "nearest", as scikit-image's
    `gaussian` takes it, or "reflect", as SciPy's `gaussian_filter` does."""
    width_scale: float = 150.0
    """Pixels that a width of 1 stands for."""
    min_distance: int = 20
    """Least distance in pixels between two grasps, and between a grasp and the image border."""
    peaks_at_border: bool = False
    """Whether grasps may lie nearer than `min_distance` to the image border."""
    threshold: float = 0.2
    """Least smoothed quality of a grasp."""
    angle_window: int = 0
    """Half side of the window from which the angle is taken: its largest angle where the peak's is positive, else its
    smallest (`ang_threshold` of the public code: 5 in the simulator, 0 for the IoU rate). 0: the peak's own angle."""


RSS_2018 = Decoding()
"""Those of GG-CNN's own code (RSS 2018), with the peak's own angle."""

_TRUNCATE = 4.0
"""Standard deviations after which a Gaussian ends, in SciPy and scikit-image."""


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
    smooth_quality = _smooth(maps[0], decoding.quality_sigma, decoding.border)
    return [
        Grasp(
            row=float(row),
            col=float(col),
            angle=wrap_angle(_angle_at(maps[1], maps[2], row, col, decoding)),
            width_px=max(_width_at(maps[3], row, col, decoding), 0.0),
            quality=float(smooth_quality[row, col]),
        )
        for row, col in _peaks(smooth_quality, n_grasps, decoding)
    ]


def best_grasp(maps: Iterable[npt.ArrayLike], decoding: Decoding = RSS_2018) -> Grasp | None:
    """The best grasp of the four maps (4, H, W) of one image, as `decode_maps` finds it; None where there is none."""
    quality, cos, sin, width = maps
    return next(iter(decode_maps(quality, cos, sin, width, decoding=decoding)), None)


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


def _smooth(values: FloatMap, sigma: float, border: str) -> FloatMap:
    return gaussian(values, sigma, mode=border, truncate=_TRUNCATE, preserve_range=True) if sigma > 0 else values


def _peaks(quality: FloatMap, n_grasps: int, decoding: Decoding) -> list[list[int]]:
    """Rows and columns of the best local maxima, as `peak_local_max` finds them."""
    margin = 0 if decoding.peaks_at_border else decoding.min_distance
    row, col = divmod(int(quality.argmax()), quality.shape[1])
    highest = quality[row, col]
    inside = margin <= row < quality.shape[0] - margin and margin <= col < quality.shape[1] - margin
    if n_grasps == 1 and inside and (quality < highest).any():
        # The highest pixel of all is the first of the maxima, and the others need not be looked for.
        return [[row, col]] if highest > decoding.threshold else []
    peaks = peak_local_max(
        quality,
        min_distance=decoding.min_distance,
        threshold_abs=decoding.threshold,
        num_peaks=n_grasps,
        exclude_border=not decoding.peaks_at_border,
    )
    found: list[list[int]] = peaks.tolist()
    return found


# Width and angle are needed at a few peaks only, so they are smoothed in a window around each peak that is as large as
# the Gaussian reaches: the same bits as smoothing whole maps, in a fraction of the time.


def _width_at(width: FloatMap, row: int, col: int, decoding: Decoding) -> float:
    (rows, cols), centre = _window(width.shape, row, col, _reach(decoding.width_sigma))
    return float(_smooth(width[rows, cols], decoding.width_sigma, decoding.border)[centre]) * decoding.width_scale


def _angle_at(cos: FloatMap, sin: FloatMap, row: int, col: int, decoding: Decoding) -> float:
    """Angle of a peak; the angle window is cut at the image border (a negative index would wrap around to the other
    side)."""
    half_side = decoding.angle_window
    (rows, cols), (r, c) = _window(cos.shape, row, col, half_side + _reach(decoding.angle_sigma))
    angle = _smooth(np.arctan2(sin[rows, cols], cos[rows, cols]) / 2, decoding.angle_sigma, decoding.border)
    if half_side == 0:
        return float(angle[r, c])
    window = angle[max(r - half_side, 0) : r + half_side + 1, max(c - half_side, 0) : c + half_side + 1]
    return float(window.max() if angle[r, c] > 0 else window.min())


def _reach(sigma: float) -> int:
    """Radius in pixels at which a Gaussian is cut off."""
    return int(_TRUNCATE * sigma + 0.5)


def _window(shape: tuple[int, ...], row: int, col: int, half_side: int) -> tuple[tuple[slice, slice], tuple[int, int]]:
    """The part of an image within `half_side` of a pixel, and the pixel's place in it."""
    top, left = max(row - half_side, 0), max(col - half_side, 0)
    region = slice(top, min(row + half_side + 1, shape[0])), slice(left, min(col + half_side + 1, shape[1]))
    return region, (row - top, col - left)
