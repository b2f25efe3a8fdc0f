"""Depth images of any camera as metres: units, and which pixels were measured."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DepthImageError

UNITS = {"m": 1.0, "mm": 0.001}
"""Unit -> metres."""

_PLAUSIBLE = {"m": (0.05, 20.0), "mm": (100.0, 20_000.0)}
"""Ranges of values by which a unit is detected. They are disjoint."""


def to_metres(depth: npt.ArrayLike, depth_unit: str | None = None) -> tuple[npt.NDArray[np.float32], str]:
    """Depth in metres, and the unit in which it was received.

    Pixels that are NaN, infinite, zero or negative are missing. The unit is the given one; without one it is detected
    by this rule:

    * "m" if the array is of floating-point numbers, and more than half of the measured pixels lie in 0.05 to 20;
    * "mm" if more than half of the measured pixels lie in 100 to 20,000, whatever the type;
    * everything else is ambiguous and refused.

    So whole numbers are never metres, which is also what ROS says of depth images (REP 118: 16UC1 is millimetres, 32FC1
    is metres). Cameras whose counts are neither, such as 0.25 mm, need a multiplication first.

    Args:
        depth: (H, W), or (n, H, W) images in one unit; integers or floating-point numbers.
        depth_unit: "m", "mm", or None to detect it. A given unit is not questioned.

    Returns:
        Float32 of the same shape, in metres along the optical axis, NaN where a pixel is missing; and "m" or "mm".

    Raises:
        DepthImageError: another shape or type, no pixel, or a unit that is unknown or cannot be told.
    """
    values = np.asarray(depth)
    if values.dtype.kind not in "iuf":
        raise DepthImageError(f"expected a depth image of integers or floats, received {values.dtype}")
    if values.ndim not in (2, 3) or 0 in values.shape[-2:]:
        raise DepthImageError(f"expected depth as (H, W) or (n, H, W) with pixels in it, received shape {values.shape}")
    if values.ndim == 3 and values.shape[-1] <= 4:
        raise DepthImageError(
            f"expected depth as (H, W) or (n, H, W), received shape {values.shape}, which looks like channels: hand "
            "over depth[..., 0] if that is the depth"
        )
    if depth_unit is not None and depth_unit not in UNITS:
        raise DepthImageError(f"expected a depth unit of {', '.join(UNITS)} or None, received {depth_unit!r}")
    with np.errstate(over="ignore"):  # what is too large for float32 is infinite, so missing
        metres = np.array(values, dtype=np.float32, order="C")
    metres[~(np.isfinite(metres) & (metres > 0))] = np.nan
    if depth_unit is None:
        depth_unit = _detected_unit(metres, values.dtype)
    if depth_unit == "mm":
        metres /= 1000
    return metres, depth_unit


def _detected_unit(values: npt.NDArray[np.float32], dtype: np.dtype) -> str:
    """The unit of values that are NaN where missing, by the rule of `to_metres`."""
    measured = np.count_nonzero(values > 0)
    if measured == 0:
        if values.size == 0:
            return "m"  # a batch of no images
        raise DepthImageError("expected depth, every pixel is missing (NaN, infinite, zero or negative)")
    for unit, (low, high) in _PLAUSIBLE.items():
        plausible = np.count_nonzero((values >= low) & (values <= high)) * 2 > measured
        if plausible and (unit == "mm" or dtype.kind == "f"):
            return unit
    raise DepthImageError(
        f"expected depth in metres (floats, mostly 0.05 to 20) or in millimetres (mostly 100 to 20,000), "
        f"received {dtype} with a median of {np.nanmedian(values):g}: say which it is with depth_unit, or convert it"
    )


def depth_at(metres: npt.NDArray[np.float32], row: float, col: float) -> tuple[float, bool]:
    """Depth at a place of an image.

    Args:
        metres: (H, W), NaN where missing.
        row: row in pixels; the nearest pixel counts.
        col: the same for the column.

    Returns:
        The depth of the pixel and True; where it is missing, the median of the measured pixels in the smallest square
        around it that holds any, and False.

    Raises:
        DepthImageError: every pixel is missing.
    """
    height, width = metres.shape
    r, c = min(max(round(row), 0), height - 1), min(max(round(col), 0), width - 1)
    for half in range(max(height, width)):
        square = metres[max(r - half, 0) : r + half + 1, max(c - half, 0) : c + half + 1]
        if not np.isnan(square).all():
            return float(np.nanmedian(square)), half == 0
    raise DepthImageError("expected depth, every pixel is missing (NaN, infinite, zero or negative)")
