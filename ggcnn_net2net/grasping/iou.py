"""The IoU rate: how often a predicted grasp rectangle matches a labelled one (RSS 2018 and its public code).

A grasp is a success if some labelled rectangle of its image has a closing direction within π/6 of its own and shares
with it more than a quarter of the pixels that the two cover. As in the public code, corners are whole pixels (fractions
are cut off), pixels on a rectangle's outline belong to it, and pixels above or left of the image do not count, whereas
those below or right of it do.

Pixels are counted, not drawn: a convex quadrilateral with whole corners meets each row of pixels in one span, whose
ends follow from its four edges without rounding. All pairs of a test set are counted in one go, with the result
that `skimage.draw.polygon` has on a canvas.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skimage.draw import polygon

from ggcnn_net2net.errors import GraspError
from ggcnn_net2net.grasping.geometry import Grasp, closing_angles, grasp_to_rectangle

FloatArray = npt.NDArray[np.float64]

LEAST_IOU = 0.25
"""An IoU has to be above it."""
LARGEST_ANGLE = np.pi / 6
"""Radians that the closing directions may differ by."""

_PAIRS_AT_ONCE = 256  # keeps the arrays of one step within the processor's cache
_FARTHEST = 1e6  # px from the image's corner
_WIDEST = 1e4  # px; such a grasp covers many times the image, so that no label shares a quarter with it


@dataclass(frozen=True)
class IouRate:
    """What became of each image of a test set."""

    grasps: tuple[Grasp | None, ...]
    """The predicted grasps; None where the network saw none, which is a failure."""
    success: tuple[bool, ...]
    """Whether each matches a label of its image."""

    @property
    def successes(self) -> int:
        """Images whose grasp matches."""
        return sum(self.success)

    @property
    def total(self) -> int:
        """All images."""
        return len(self.success)

    @property
    def rate(self) -> float:
        """Share of successes; NaN without images."""
        return self.successes / self.total if self.total else float("nan")

    @property
    def without_grasp(self) -> int:
        """Images in which the network saw no grasp."""
        return sum(grasp is None for grasp in self.grasps)


def joined(rates: Iterable[IouRate]) -> IouRate:
    """The rate over the images of several test sets, one after the other."""
    parts = list(rates)
    return IouRate(
        tuple(grasp for part in parts for grasp in part.grasps),
        tuple(success for part in parts for success in part.success),
    )


def iou_rate(
    grasps: Sequence[Grasp | None], rectangles: Sequence[npt.ArrayLike], *, wrapped_angle_difference: bool
) -> IouRate:
    """Judge one predicted grasp an image.

    Args:
        grasps: n grasps in pixels; None where the network saw none.
        rectangles: for each image its positive rectangles, (k, 4, 2) corners (row, col), edge 0-1 in the closing
            direction. k may differ and be 0. Rectangles with NaN, as a few of Cornell's files have, are left out.
        wrapped_angle_difference: field of `Protocol`: compare directions modulo π both ways, or as published.

    Returns:
        Whether each image is a success, and their share.

    Raises:
        GraspError: another number of images in `grasps` than in `rectangles`, rectangles of another shape or millions
            of pixels away, or a grasp that is not finite.
    """
    if len(grasps) != len(rectangles):
        raise GraspError(f"expected a grasp, or None, for each of {len(rectangles)} images, received {len(grasps)}")
    # A width of NaN is not left out here: it is refused below.
    judged = [(index, grasp) for index, grasp in enumerate(grasps) if grasp and not grasp.width_px > _WIDEST]
    predicted = [published_rectangle(grasp) for _, grasp in judged]
    labels = [_labels(rectangles[index]) for index, _ in judged]
    counts = [len(of_image) for of_image in labels]
    image = np.repeat(np.array([index for index, _ in judged], dtype=int), counts)
    ious = _ious(
        np.repeat(np.reshape(predicted, (-1, 4, 2)), counts, axis=0),
        np.concatenate([np.empty((0, 4, 2)), *labels]),
        wrapped_angle_difference,
    )
    success = np.zeros(len(grasps), dtype=bool)
    success[image[ious > LEAST_IOU]] = True
    return IouRate(tuple(grasps), tuple(success.tolist()))


def iou_success(grasp: Grasp | None, rectangles: npt.ArrayLike, *, wrapped_angle_difference: bool) -> bool:
    """Whether `grasp` matches one of an image's (k, 4, 2) rectangles: `iou_rate` for one image.

    Args:
        grasp: in pixels; None where the network saw none.
        rectangles: (k, 4, 2) corners (row, col), edge 0-1 in the closing direction.
        wrapped_angle_difference: as of `iou_rate`.

    Returns:
        Whether one of them matches.
    """
    return iou_rate([grasp], [rectangles], wrapped_angle_difference=wrapped_angle_difference).success[0]


def grasp_iou(a: npt.ArrayLike, b: npt.ArrayLike, *, wrapped_angle_difference: bool) -> float:
    """Pixels that two grasp rectangles share, divided by those that they cover together.

    Args:
        a: (4, 2) corners (row, col), edge 0-1 in the closing direction; fractions are cut off.
        b: the same of the other rectangle.
        wrapped_angle_difference: field of `Protocol`.

    Returns:
        0 to 1; 0 where the closing directions differ by more than π/6.

    Raises:
        GraspError: another shape, or values that are not finite or in the millions.
    """
    pair = [np.asarray(corners, dtype=np.float64) for corners in (a, b)]
    for corners in pair:
        if corners.shape != (4, 2) or not np.isfinite(corners).all():
            raise GraspError(f"expected 4 finite corners (row, col), received shape {corners.shape}: {corners}")
    one, other = (_whole_pixels(corners[None]) for corners in pair)
    return float(_ious(one, other, wrapped_angle_difference)[0])


def published_rectangle(grasp: Grasp) -> FloatArray:
    """(4, 2) corners of a predicted grasp as the public code judges it: half as high as long, fractions cut off.

    Args:
        grasp: in pixels.

    Returns:
        (4, 2) corners (row, col), whole numbers as floats.

    Raises:
        GraspError: a grasp that is not finite.
    """
    corners = grasp_to_rectangle(grasp)
    if not np.isfinite(corners).all():
        raise GraspError(f"expected a finite grasp, received {grasp}: check the network's outputs")
    return np.trunc(corners)


def _labels(rectangles: npt.ArrayLike) -> FloatArray:
    """Rectangles of one image without those that hold NaN, fractions cut off."""
    corners = np.asarray(rectangles, dtype=np.float64)
    if corners.size == 0:
        return np.empty((0, 4, 2))
    if corners.ndim != 3 or corners.shape[1:] != (4, 2):
        raise GraspError(f"expected rectangles as (n, 4, 2) corners (row, col), received shape {corners.shape}")
    return _whole_pixels(corners[np.isfinite(corners).all(axis=(1, 2))])


def _whole_pixels(corners: FloatArray) -> FloatArray:
    """Cut off fractions; refuse what would take gigabytes to count."""
    if np.abs(corners).max(initial=0) > _FARTHEST:
        raise GraspError(
            f"expected corners within {_FARTHEST:.0f} px, received {corners.flat[np.abs(corners).argmax()]}"
        )
    return np.trunc(corners)


def _ious(a: FloatArray, b: FloatArray, wrapped: bool) -> FloatArray:
    """IoU of n pairs of rectangles (n, 4, 2) with whole corners; pixels are counted only where it can be above 0."""
    boxes_meet = ((a.min(axis=1) <= b.max(axis=1)) & (b.min(axis=1) <= a.max(axis=1))).all(axis=1)
    candidates = np.flatnonzero(boxes_meet & _angles_agree(a, b, wrapped))
    ious = np.zeros(len(a))
    for start in range(0, len(candidates), _PAIRS_AT_ONCE):
        pairs = candidates[start : start + _PAIRS_AT_ONCE]
        common, union = pixel_counts(a[pairs], b[pairs])
        ious[pairs] = common / np.maximum(union, 1)
    return ious


def _angles_agree(a: FloatArray, b: FloatArray, wrapped: bool) -> npt.NDArray[np.bool_]:
    apart = np.abs(closing_angles(a) - closing_angles(b))  # below π; as published, 89° and -89° are 178° apart
    return (np.minimum(apart, np.pi - apart) if wrapped else apart) <= LARGEST_ANGLE


def pixel_counts(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels that pairs of quadrilaterals share, and pixels that they cover together.

    Args:
        a: (n, 4, 2) corners (row, col), whole numbers of less than a million.
        b: the same of their partners.

    Returns:
        Two arrays (n,) of whole numbers.
    """
    common, union = np.zeros(len(a)), np.zeros(len(a))
    convex = _are_convex(a) & _are_convex(b)
    common[convex], union[convex] = _count_spans(a[convex], b[convex])
    for index in np.flatnonzero(~convex):
        common[index], union[index] = _count_drawn(a[index], b[index])
    return common, union


def _are_convex(corners: FloatArray) -> npt.NDArray[np.bool_]:
    edge = np.roll(corners, -1, axis=1) - corners
    following = np.roll(edge, -1, axis=1)
    turn = edge[..., 0] * following[..., 1] - edge[..., 1] * following[..., 0]
    bends = (turn != 0).any(axis=1)  # of a flat one, skimage draws the corners without what is between them
    return bends & ((turn >= 0).all(axis=1) | (turn <= 0).all(axis=1))


def _count_spans(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`pixel_counts` of convex quadrilaterals."""
    rows = np.concatenate([a[..., 0], b[..., 0]], axis=1)
    first = np.maximum(rows.min(axis=1), 0)
    height = np.maximum(rows.max(axis=1) - first + 1, 0).astype(int)
    pair = np.repeat(np.arange(len(a)), height)  # one entry for each row of pixels of each pair
    row = np.arange(len(pair)) - np.repeat(np.cumsum(height) - height - first, height)
    left_a, right_a = _spans(a, pair, row)
    left_b, right_b = _spans(b, pair, row)

    def total(left: FloatArray, right: FloatArray) -> FloatArray:
        return np.bincount(pair, np.maximum(right - left + 1, 0), minlength=len(a)).astype(np.float64)

    common = total(np.maximum(left_a, left_b), np.minimum(right_a, right_b))
    return common, total(left_a, right_a) + total(left_b, right_b) - common


def _spans(corners: FloatArray, owner: npt.NDArray[np.int_], row: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and last column that the quadrilateral `corners[owner]` has in each row; inf and -inf where it has none.

    Exact: a quotient of whole numbers that is no whole number is farther from the next one than floats round.
    """
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for edge in range(4):
        (row_0, col_0), (row_1, col_1) = corners[:, edge].T, corners[:, (edge + 1) % 4].T
        height = np.where(row_1 == row_0, 1, row_1 - row_0)  # a level edge counts with its start
        down = row - row_0[owner]
        col = col_0[owner] + (col_1 - col_0)[owner] * down / height[owner]
        meets = (row >= np.minimum(row_0, row_1)[owner]) & (row <= np.maximum(row_0, row_1)[owner])
        left = np.where(meets, np.minimum(left, col), left)
        right = np.where(meets, np.maximum(right, col), right)
    return np.maximum(np.ceil(left), 0), np.floor(right)


def _count_drawn(a: FloatArray, b: FloatArray) -> tuple[int, int]:
    """`pixel_counts` of one pair of any shape: crossed labels, and tiny grasps dented by the cut of fractions."""
    one, other = (set(zip(*polygon(*corners.T), strict=True)) for corners in (a, b))
    return len(one & other), len(one | other)
