"""The comparison of a written file with Keras, on maps made by hand."""

import numpy as np
import pytest

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import ExportError
from ggcnn_net2net.model_files.export.parity import check, compare
from ggcnn_net2net.model_files.export.runtime import Runtime

SIDE = 120
IMAGES = [np.full((1, SIDE, SIDE, 1), number, np.float32) for number in range(4)]


def maps(row=60, col=60, angle=0.3, quality=1.0):
    """The four maps of a network that sees one grasp, or none where its quality is too low."""
    rows, cols = np.indices((SIDE, SIDE))
    blob = quality * np.exp(-((rows - row) ** 2 + (cols - col) ** 2) / 200)
    plain = np.ones((SIDE, SIDE))
    return np.array([blob, np.cos(2 * angle) * plain, np.sin(2 * angle) * plain, 0.2 * plain], np.float32)


def runtime(found, outputs=HEADS):
    """A file that gives these maps for the images, in their order."""
    return Runtime(outputs, lambda image: [part[None, ..., None] for part in found[int(image[0, 0, 0, 0])]])


EXPECTED = [maps(), maps(col=50), maps(angle=-1.0), maps(quality=0.0)]


def test_equal_maps_are_equal_grasps_and_none_is_like_none():
    found = compare(runtime(EXPECTED), IMAGES, EXPECTED)
    assert (found.images, found.same_grasp, found.no_grasp) == (4, 4, 1)
    assert set(found.max_abs_difference.values()) == {0.0}


@pytest.mark.parametrize(
    "other",
    [maps(row=30), maps(angle=0.3 + np.pi / 2), maps(quality=0.0)],
    ids=["elsewhere", "turned", "none"],
)
def test_another_grasp_is_another_grasp(other):
    found = compare(runtime([other, *EXPECTED[1:]]), IMAGES, EXPECTED)
    assert (found.same_grasp, found.agreement) == (3, 0.75)


def test_a_grasp_where_keras_sees_none_is_another():
    assert compare(runtime([*EXPECTED[:3], maps()]), IMAGES, EXPECTED).same_grasp == 3


def test_differences_are_those_of_each_map():
    moved = [part.copy() for part in EXPECTED]
    moved[1][3, 7, 9] += 0.25
    moved[2][0, 1, 1] -= 0.5
    found = compare(runtime(moved), IMAGES, EXPECTED)
    assert found.max_abs_difference == pytest.approx({"pos_out": 0.5, "cos_out": 0, "sin_out": 0, "width_out": 0.25})


@pytest.mark.parametrize(("quantization", "limit"), [(None, 1e-4), ("float16", 2e-2)])
def test_a_difference_is_refused_from_its_limit_on(quantization, limit):
    expected = [np.array([1, 1, 1, 5], np.float32)[:, None, None] * part for part in EXPECTED]
    for times, head, allowed in ((0.98, 0, limit), (1.02, 0, limit), (0.98, 3, limit), (1.02, 3, limit)):
        moved = [part.copy() for part in expected]
        moved[0][head, 5, 5] += times * allowed
        parity = compare(runtime(moved), IMAGES, expected)
        if times < 1:
            check(parity, expected, quantization)
        else:
            with pytest.raises(ExportError, match=f"expected {HEADS[head]} to differ"):
                check(parity, expected, quantization)


def test_the_limit_grows_with_the_largest_value_of_a_map():
    expected = [part * np.float32(100) for part in EXPECTED]
    moved = [part.copy() for part in expected]
    moved[0][3, 5, 5] += 15e-4  # the width is 20 everywhere
    check(compare(runtime(moved), IMAGES, expected), expected, None)
    moved[0][3, 5, 5] += 10e-4
    with pytest.raises(ExportError, match="width_out"):
        check(compare(runtime(moved), IMAGES, expected), expected, None)


def test_int8_is_judged_by_its_grasps():
    half = [maps(row=30), maps(row=30), *EXPECTED[2:]]
    check(compare(runtime(half), IMAGES, EXPECTED), EXPECTED, "int8")
    with pytest.raises(ExportError, match="on 1 of 4"):
        check(compare(runtime([*half[:2], maps(row=30), EXPECTED[3]]), IMAGES, EXPECTED), EXPECTED, "int8")


@pytest.mark.parametrize(
    ("found", "outputs", "told"),
    [
        (EXPECTED, HEADS[::-1], "in this order"),
        ([part[:, 1:] for part in EXPECTED], HEADS, r"pos_out of shape \(1, 120, 120, 1\)"),
        ([part * np.float32(np.nan) for part in EXPECTED], HEADS, "NaN or infinity in pos_out"),
    ],
    ids=["order", "shape", "nan"],
)
def test_what_is_no_answer(found, outputs, told):
    with pytest.raises(ExportError, match=told):
        compare(runtime(found, outputs), IMAGES, EXPECTED)
