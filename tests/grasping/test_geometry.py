import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ggcnn_net2net.errors import GraspError
from ggcnn_net2net.grasping import Grasp, closing_angles, grasp_to_rectangle, rectangle_to_grasp, wrap_angle

grasps = st.builds(
    Grasp,
    row=st.floats(-500, 500),
    col=st.floats(-500, 500),
    angle=st.floats(-np.pi / 2, np.pi / 2, exclude_max=True),
    width_px=st.floats(1, 300),
)


@given(grasps, st.floats(0.5, 200))
def test_rectangle_round_trip(grasp, jaw_px):
    back, back_jaw = rectangle_to_grasp(grasp_to_rectangle(grasp, jaw_px))
    assert back.row == pytest.approx(grasp.row, abs=1e-9)
    assert back.col == pytest.approx(grasp.col, abs=1e-9)
    assert back.width_px == pytest.approx(grasp.width_px)
    assert back_jaw == pytest.approx(jaw_px)
    # Angles meet again at ±π/2.
    assert abs(wrap_angle(back.angle - grasp.angle)) < 1e-6


def test_corners_of_a_horizontal_grasp():
    corners = grasp_to_rectangle(Grasp(10, 20, 0.0, 8))
    np.testing.assert_allclose(corners, [[8, 16], [8, 24], [12, 24], [12, 16]])


def test_positive_angle_turns_counter_clockwise_in_the_picture():
    corners = grasp_to_rectangle(Grasp(0, 0, np.pi / 4, 2))
    start, end = corners[0], corners[1]
    assert end[1] > start[1]  # to the right
    assert end[0] < start[0]  # and up: rows grow downwards


def test_default_jaw_side_is_half_the_opening():
    corners = grasp_to_rectangle(Grasp(0, 0, 0.3, 40))
    assert np.hypot(*(corners[2] - corners[1])) == pytest.approx(20)


def test_an_angle_that_is_none_stays_none():
    assert np.isnan(wrap_angle(np.nan))


@given(st.floats(-100, 100))
@example(np.nextafter(-np.pi / 2, -9))  # % rounds it up to π
@example(np.nextafter(np.pi / 2, 0))
@example(np.pi / 2)
def test_wrap_angle_keeps_the_direction(angle):
    wrapped = wrap_angle(angle)
    assert -np.pi / 2 <= wrapped < np.pi / 2
    assert np.cos(2 * wrapped) == pytest.approx(np.cos(2 * angle), abs=1e-9)
    assert np.sin(2 * wrapped) == pytest.approx(np.sin(2 * angle), abs=1e-9)


@pytest.mark.parametrize(
    "corners",
    [np.zeros((3, 2)), np.full((4, 2), np.nan), np.zeros((4, 2)), [[0, 0], [np.inf, 1], [1, 1], [1, 0]]],
)
def test_impossible_rectangles_are_refused(corners):
    with pytest.raises(GraspError, match="expected"):
        rectangle_to_grasp(corners)


@given(grasps)
def test_closing_angles_of_many_rectangles(grasp):
    rectangle = grasp_to_rectangle(grasp)
    (angle,) = closing_angles(rectangle[None])
    assert wrap_angle(angle - grasp.angle) == pytest.approx(0, abs=1e-6)
    assert closing_angles(np.zeros((2, 4, 2))).tolist() == [0, 0]
