"""Depth where the camera saw none."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DatasetError


def fill_missing(depth: npt.NDArray[np.floating], missing: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Depth with missing pixels filled in from around them, as in the public GG-CNN code.

    Navier-Stokes inpainting with radius 1, of the image scaled to ±1 and with a border of one mirrored pixel, because
    OpenCV leaves missing pixels at the border as they are.

    Args:
        depth: (H, W).
        missing: (H, W).

    Returns:
        (H, W) float32, in the unit of `depth`.

    Raises:
        DatasetError: everything is missing.
    """
    import cv2

    if missing.all():
        raise DatasetError("expected depth, every pixel is missing")
    known = np.where(missing, 0, depth).astype(np.float32)
    if not missing.any():
        return known
    scale = np.abs(known).max()
    bordered = cv2.copyMakeBorder(known / scale, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    mask = cv2.copyMakeBorder(missing.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    filled = cv2.inpaint(bordered, mask, 1, cv2.INPAINT_NS)[1:-1, 1:-1]
    return np.where(missing, filled * scale, known)
