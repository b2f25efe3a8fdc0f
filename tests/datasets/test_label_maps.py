import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.draw import polygon

from ggcnn_net2net.datasets.label_maps import draw_label_maps, targets_of
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import Grasp, decode_maps, grasp_to_rectangle

SHAPE = (60, 80)
# Offsets keep edges off the pixel centres, where rounding decides.
grasps = st.builds(
    lambda row, col, angle, width: Grasp(row + 0.1234, col + 0.2345, angle, width),
    row=st.floats(-10, 70),
    col=st.floats(-10, 90),
    angle=st.floats(-np.pi / 2, np.pi / 2, exclude_max=True),
    width=st.floats(1, 90),
)


@given(st.lists(st.tuples(grasps, st.floats(1, 40)), min_size=1, max_size=5))
def test_labels_are_the_polygons_of_the_centre_thirds(items):
    """An oracle in other words: skimage's polygons of the narrowed rectangles, drawn one over the other."""
    expected = np.zeros((4, *SHAPE))
    for grasp, jaw in items:
        third = grasp_to_rectangle(Grasp(grasp.row, grasp.col, grasp.angle, grasp.width_px / 3), jaw)
        rows, cols = polygon(third[:, 0], third[:, 1], SHAPE)
        double = 2 * grasp.angle  # -90° and 90° are the same
        expected[:, rows, cols] = np.array([1, np.cos(double), np.sin(double), grasp.width_px])[:, None]
    maps = draw_label_maps([grasp_to_rectangle(grasp, jaw) for grasp, jaw in items], SHAPE)
    cos, sin = (maps.quality * function(2 * maps.angle) for function in (np.cos, np.sin))
    np.testing.assert_allclose([maps.quality, cos, sin, maps.width], expected, atol=1e-4)
    assert all(values.dtype == np.float32 and values.shape == SHAPE for values in maps)


def test_one_rectangle_in_numbers():
    # 30 px open along the columns, jaws of 8 px: the centre third is 10 x 8.
    maps = draw_label_maps([grasp_to_rectangle(Grasp(20, 40, 0.0, 30), 8)], SHAPE)
    rows, cols = np.nonzero(maps.quality)
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == (16, 24, 35, 45)
    assert set(np.unique(maps.width)) == {0, 30}
    assert set(np.unique(maps.angle)) == {0}


def test_angle_follows_the_edge_0_1():
    rectangle = [[30, 20], [10, 40], [17, 47], [37, 27]]  # up and to the right
    assert draw_label_maps([rectangle], SHAPE).angle.max() == pytest.approx(np.pi / 4)


def test_later_rectangles_cover_earlier_ones():
    wide, narrow = (grasp_to_rectangle(Grasp(30, 40, 0, width), 20) for width in (60, 30))
    assert draw_label_maps([wide, narrow], SHAPE).width[30, 40] == 30
    assert draw_label_maps([narrow, wide], SHAPE).width[30, 40] == 60


def test_no_rectangle_and_outside():
    assert not np.any(draw_label_maps(np.zeros((0, 4, 2)), SHAPE))
    assert not np.any(draw_label_maps([grasp_to_rectangle(Grasp(-50, 300, 0, 30))], SHAPE))


def test_targets():
    quality, angle, width = np.ones((2, 1)), np.array([[0.0], [-np.pi / 4]]), np.array([[75.0], [400.0]])
    targets = targets_of(quality, angle, width)
    assert targets.dtype == np.float32
    np.testing.assert_allclose(targets, [[[1, 1, 0, 0.5]], [[1, 0, -1, 1]]], atol=1e-6)
    assert targets_of(*np.zeros((3, 5, 7, 9))).shape == (5, 7, 9, 4)


@given(st.floats(-1.5, 1.5), st.floats(40, 80))
def test_a_perfect_network_decodes_to_the_label(angle, width):
    """Labels, targets and the decoding of the network agree on signs and units."""
    rectangle = grasp_to_rectangle(Grasp(100, 110, angle, width), 12)
    targets = targets_of(*draw_label_maps([rectangle], (200, 200)))
    (grasp,) = decode_maps(*np.moveaxis(targets, -1, 0))
    assert np.hypot(grasp.row - 100, grasp.col - 110) <= 2
    assert grasp.angle == pytest.approx(angle, abs=1e-4)
    assert grasp.width_px == pytest.approx(width, rel=0.01)


@pytest.mark.parametrize(
    "rectangles", [np.zeros((4, 2)), np.full((1, 4, 2), np.nan), [[[1, 1], [1, 1], [2, 2], [2, 2]]], np.ones((2, 3, 2))]
)
def test_impossible_rectangles_are_refused(rectangles):
    with pytest.raises(DatasetError, match="expected"):
        draw_label_maps(rectangles)
