"""The IoU rule against a plain reference that draws both rectangles of a pair on a canvas, as the public code does."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.draw import polygon

from ggcnn_net2net.errors import GraspError
from ggcnn_net2net.grasping import (
    Grasp,
    IouRate,
    grasp_iou,
    grasp_to_rectangle,
    iou_rate,
    iou_success,
    published_rectangle,
)
from ggcnn_net2net.grasping.iou import pixel_counts

CANVAS = 800  # larger than anything drawn here: only the upper and the left border cut

# Centres off the image, on its border and in it; from nothing to half the image.
grasps = st.builds(
    Grasp,
    row=st.floats(-60, 360),
    col=st.floats(-60, 360),
    angle=st.floats(-math.pi / 2, math.pi / 2, exclude_max=True),
    width_px=st.one_of(st.floats(0, 8), st.floats(0, 150)),
)
whole = st.integers(-6, 12)
crooked = st.lists(st.tuples(whole, whole), min_size=4, max_size=4)
"""Four corners in any order, so flat, dented and crossed shapes, too."""


@st.composite
def pairs(draw):
    """A grasp rectangle and another near it, on fractions of pixels."""
    grasp = draw(grasps)
    moved, turned = draw(st.tuples(st.floats(-20, 20), st.floats(-20, 20))), draw(st.floats(-0.7, 0.7))
    label = Grasp(
        grasp.row + moved[0], grasp.col + moved[1], grasp.angle + turned, grasp.width_px * draw(st.floats(0.5, 2))
    )
    return grasp_to_rectangle(grasp), grasp_to_rectangle(label, draw(st.floats(0, 60)))


@st.composite
def images(draw):
    """A predicted grasp or none, and none to four labels, the first of which may be a good match."""
    grasp = draw(grasps | st.none())
    labels = [label for _, label in draw(st.lists(pairs(), max_size=3))]
    if grasp is not None and draw(st.booleans()):
        labels.insert(0, published_rectangle(grasp) + 2)
    return grasp, labels


def reference_angle(corners):
    (row_0, col_0), (row_1, col_1) = corners[0].tolist(), corners[1].tolist()
    return (math.atan2(row_0 - row_1, col_1 - col_0) + math.pi / 2) % math.pi - math.pi / 2


def drawn(corners):
    canvas = np.zeros((CANVAS, CANVAS), dtype=bool)
    canvas[polygon(corners[:, 0], corners[:, 1])] = True
    return canvas


def reference_counts(a, b):
    one, other = drawn(a), drawn(b)
    return int((one & other).sum()), int((one | other).sum())


def reference_iou(a, b, wrapped):
    a, b = (np.asarray(corners).astype(int) for corners in (a, b))
    apart = abs(reference_angle(a) - reference_angle(b)) % math.pi
    if (min(apart, math.pi - apart) if wrapped else apart) > math.pi / 6:
        return 0.0
    common, union = reference_counts(a, b)
    return common / union if union else 0.0


@given(pairs(), st.booleans())
def test_iou_of_rectangles_equals_the_reference(pair, wrapped):
    assert grasp_iou(*pair, wrapped_angle_difference=wrapped) == reference_iou(*pair, wrapped)


@given(crooked, crooked)
def test_pixel_counts_of_any_four_corners_equal_the_reference(a, b):
    a, b = np.array(a, dtype=float), np.array(b, dtype=float)
    common, union = pixel_counts(a[None], b[None])
    assert (common[0], union[0]) == reference_counts(a, b)


@given(st.lists(images(), max_size=6), st.booleans())
def test_rate_equals_the_reference_image_by_image(images, wrapped):
    found, labels = [grasp for grasp, _ in images], [of_image for _, of_image in images]
    expected = tuple(
        grasp is not None
        and any(reference_iou(published_rectangle(grasp), label, wrapped) > 0.25 for label in of_image)
        for grasp, of_image in zip(found, labels, strict=True)
    )
    result = iou_rate(found, labels, wrapped_angle_difference=wrapped)
    assert result.success == expected
    assert result.grasps == tuple(found)
    assert result.successes == sum(expected)
    assert result.without_grasp == found.count(None)


def test_many_images_at_once_equal_one_by_one():
    rng = np.random.default_rng(0)
    labels = [grasp_to_rectangle(Grasp(*rng.normal(150, 15, 2), angle, 60)) for angle in rng.uniform(-1, 1, 700)]
    found = [Grasp(150, 150, angle, 70) for angle in rng.uniform(-1, 1, 700)]
    together = iou_rate(found, [[label] for label in labels], wrapped_angle_difference=True).success
    alone = [
        iou_success(grasp, [label], wrapped_angle_difference=True) for grasp, label in zip(found, labels, strict=True)
    ]
    assert list(together) == alone
    assert 10 < sum(alone) < 690


@given(grasps)
def test_predicted_rectangle_is_that_of_the_public_code(grasp):
    cos, sin = math.cos(grasp.angle), math.sin(grasp.angle)
    along, across = grasp.width_px / 2, grasp.width_px / 4
    exact = np.array(
        [
            (grasp.row - i * along * sin + j * across * cos, grasp.col + i * along * cos + j * across * sin)
            for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )
    received = published_rectangle(grasp)
    certain = np.abs(exact - np.rint(exact)) > 1e-9  # rounding decides elsewhere
    assert (received[certain] == np.trunc(exact[certain])).all()
    assert np.abs(received - exact).max() < 1 + 1e-9


def test_readings_of_the_angle_difference_part_across_the_vertical():
    steep, past = (grasp_to_rectangle(Grasp(150, 150, np.deg2rad(degrees), 80)) for degrees in (85, -85))
    assert grasp_iou(steep, past, wrapped_angle_difference=True) > 0.5
    assert grasp_iou(steep, past, wrapped_angle_difference=False) == 0


@pytest.mark.parametrize(("degrees", "counts"), [(29, True), (31, False)])
@pytest.mark.parametrize("wrapped", [True, False])
def test_directions_may_differ_by_thirty_degrees(degrees, counts, wrapped):
    level, turned = (grasp_to_rectangle(Grasp(150, 150, angle, 100)) for angle in (0, np.deg2rad(degrees)))
    assert (grasp_iou(level, turned, wrapped_angle_difference=wrapped) > 0.25) == counts


def test_only_the_upper_and_the_left_border_cut():
    square = np.array([[[0, 0], [0, 9], [9, 9], [9, 0]]], dtype=float)
    common, union = pixel_counts(square - 5, square)
    assert (common[0], union[0]) == (25, 100)  # 75 pixels of the first are cut
    common, union = pixel_counts(square + 295, square + 290)
    assert (common[0], union[0]) == (25, 175)
    common, union = pixel_counts(square - 20, square - 20)
    assert (common[0], union[0]) == (0, 0)


# 8 rows (6 to 13) of 15 columns (13 to 27) after fractions are cut off: 120 pixels.
PREDICTED = Grasp(10, 20, 0.0, 14)


@pytest.mark.parametrize(("last_row", "success"), [(7, False), (8, True)])
def test_a_quarter_is_not_enough(last_row, success):
    label = np.array([[6, 13], [6, 27], [last_row, 27], [last_row, 13]])
    expected = 15 * (last_row - 5) / 120
    assert grasp_iou(published_rectangle(PREDICTED), label, wrapped_angle_difference=True) == expected
    assert iou_success(PREDICTED, [label], wrapped_angle_difference=True) == success


def test_no_grasp_and_no_labels_are_failures():
    label = published_rectangle(PREDICTED)
    result = iou_rate([None, PREDICTED, PREDICTED], [[label], [], [label]], wrapped_angle_difference=True)
    assert result.success == (False, False, True)
    assert (result.successes, result.total, result.without_grasp) == (1, 3, 1)
    assert result.rate == pytest.approx(1 / 3)


def test_rate_of_nothing_is_nan():
    result = iou_rate([], [], wrapped_angle_difference=True)
    assert result == IouRate((), ())
    assert math.isnan(result.rate)


def test_labels_with_nan_are_left_out():
    label = published_rectangle(PREDICTED)
    broken = np.full((4, 2), np.nan)
    half = np.where(np.arange(4)[:, None] == 2, np.nan, label)
    assert not iou_success(PREDICTED, [broken, half], wrapped_angle_difference=False)
    assert iou_success(PREDICTED, [broken, label, half], wrapped_angle_difference=False)


@pytest.mark.parametrize("width", [0.0, 1e4 + 1, 1e9, 1e300])
def test_grasps_without_and_with_an_absurd_opening_are_failures(width):
    label = published_rectangle(PREDICTED)
    assert not iou_success(Grasp(10, 20, 0.0, width), [label], wrapped_angle_difference=True)


@pytest.mark.parametrize(
    ("grasps", "rectangles"),
    [
        ([PREDICTED], []),
        ([Grasp(10, 20, 0.0, math.nan)], [[published_rectangle(PREDICTED)]]),
        ([Grasp(math.inf, 20, 0.0, 14)], [[published_rectangle(PREDICTED)]]),
        ([PREDICTED], [published_rectangle(PREDICTED)]),
        ([PREDICTED], [np.zeros((2, 3, 2))]),
        ([PREDICTED], [1e9 * published_rectangle(PREDICTED)[None]]),
    ],
)
def test_impossible_input_is_refused(grasps, rectangles):
    with pytest.raises(GraspError, match="expected"):
        iou_rate(grasps, rectangles, wrapped_angle_difference=True)


@pytest.mark.parametrize("corners", [np.full((4, 2), np.nan), np.zeros((3, 2)), np.full((4, 2), np.inf)])
def test_impossible_pairs_are_refused(corners):
    with pytest.raises(GraspError, match="4 finite corners"):
        grasp_iou(corners, published_rectangle(PREDICTED), wrapped_angle_difference=True)
