from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.simulation import GripperSpec
from ggcnn_net2net.simulation.antipodal import (
    AntipodalGrasps,
    AntipodalRule,
    agreeing,
    find_antipodal_grasps,
    rows_of,
)
from ggcnn_net2net.simulation.convex import box, cylinder, rotate, tube

BODY = 1  # after the plane
STEP = np.pi / AntipodalRule().directions
SLIP = np.arccos(AntipodalRule().alignment) + 1e-6


def grasps_at(world, points, **changes) -> AntipodalGrasps:
    return find_antipodal_grasps(world.client, BODY, points, replace(AntipodalRule(), **changes))


def turn_between(first, second):
    return np.abs((np.asarray(first) - second + np.pi / 2) % np.pi - np.pi / 2)


@pytest.fixture
def box_world(world, at_rest):
    """A box of 0.06 x 0.12 x 0.08 m, long side along y, around the origin."""
    at_rest("box", [box((0.06, 0.12, 0.08))])
    return world


def test_box_is_gripped_across_both_sides(box_world):
    grasps = grasps_at(box_world, [(0, 0, 0.08)])
    across, along = turn_between(grasps.angle, 0) <= SLIP, turn_between(grasps.angle, np.pi / 2) <= SLIP
    assert across.any()
    assert along.any()
    assert (across | along).all()  # never over a corner
    straight = rows_of(grasps, grasps.angle == 0)
    assert straight.span == pytest.approx(0.06, abs=0.002)
    assert straight.opening == pytest.approx(0.06 + 2 * 0.03, abs=0.002)
    assert straight.alignment == pytest.approx(1.0, abs=1e-6)
    assert rows_of(grasps, grasps.angle == np.pi / 2).span == pytest.approx(0.12, abs=0.002)


def test_points_away_from_the_middle_are_no_centres(box_world):
    """2.5 cm beside the middle; the short side's closing direction stays a grasp all along the long side."""
    assert not (grasps_at(box_world, [(0.025, 0, 0.08)]).angle == 0).any()
    for y in (-0.05, 0.03, 0.05):
        assert (grasps_at(box_world, [(0, y, 0.08)]).angle == 0).any()


def test_grasps_belong_to_their_points(box_world):
    points = np.array([(0.5, 0.5, 0.05), (0, 0, 0.08), (0.4, 0, 0.05), (0, 0.03, 0.08)])
    grasps = grasps_at(box_world, points)
    assert set(grasps.origin.tolist()) == {1, 3}  # beside the object there is nothing to grip
    np.testing.assert_array_equal(grasps.point, points[grasps.origin])


@pytest.mark.parametrize("steps", [1, 4, 7, 11])
def test_grasps_turn_with_the_object(world, at_rest, steps):
    """A box turned by a multiple of the direction's step has the same grasps, turned."""
    parts = [box((0.05, 0.16, 0.06))]
    at_rest("bar", parts)
    straight = grasps_at(world, [(0, 0, 0.06)])
    at_rest("turned", rotate(parts, "z", float(np.degrees(steps * STEP))))
    turned = grasps_at(world, [(0, 0, 0.06)])
    best = straight.angle[straight.span.argmin()]
    narrowest = turned.angle[turned.span.argmin()]
    assert turn_between(narrowest, best + steps * STEP) <= 1.01 * STEP
    assert turned.span.min() == pytest.approx(straight.span.min(), abs=0.004)


def test_what_is_wider_than_the_gripper_is_left(world, at_rest):
    at_rest("slab", [box((0.29, 0.06, 0.05))])
    grasps = grasps_at(world, [(0, 0, 0.05)])
    assert len(grasps)
    assert (turn_between(grasps.angle, np.pi / 2) <= SLIP).all()
    assert (grasps.opening <= GripperSpec().max_opening).all()


def test_a_small_gripper_grips_the_short_side_alone(box_world):
    small = GripperSpec(palm=(0.12, 0.02, 0.01), max_opening=0.1)
    grasps = find_antipodal_grasps(box_world.client, BODY, [(0, 0, 0.08)], gripper=small)
    assert len(grasps)
    assert (turn_between(grasps.angle, 0) <= SLIP).all()  # the box is 0.12 m long
    assert grasps.opening.max() <= 0.1


def test_a_gripper_that_opens_less_than_a_finger_needs_grips_nothing(box_world):
    tiny = GripperSpec(palm=(0.05, 0.02, 0.01), max_opening=0.015)
    assert len(find_antipodal_grasps(box_world.client, BODY, [(0, 0, 0.08)], gripper=tiny)) == 0


@pytest.mark.parametrize(
    ("place", "free", "blocked"),
    [
        ((0.13, 0), (0.2, 0.02, 0.01), (0.3, 0.02, 0.01)),  # beyond the open fingers
        ((0, 0.05), (0.2, 0.02, 0.01), (0.2, 0.09, 0.01)),  # beside them
    ],
)
def test_a_palm_needs_room_in_its_own_size(world, at_rest, place, free, blocked):
    """A bar of 4 cm between two towers that are far higher than it."""
    x, y = place
    towers = [box((0.02, 0.02, 0.2), (side * x, side * y, 0.1)) for side in (-1, 1)]
    at_rest("towers", [*towers, box((0.04, 0.04, 0.06), (0, 0, 0.03)), box((2 * x + 0.02, 2 * y + 0.02, 0.005))])

    def grips_along_x(palm):
        gripper = GripperSpec(palm=palm, max_opening=0.18)
        grasps = find_antipodal_grasps(world.client, BODY, [(0, 0, 0.0625)], gripper=gripper)
        return (grasps.angle == 0).any()

    assert grips_along_x(free)
    assert not grips_along_x(blocked)


def test_wall_of_a_cup_is_gripped_by_itself(world, at_rest):
    """One finger inside: the span is the wall's thickness, not the cup's diameter."""
    at_rest("cup", tube([(0.09, 0), (0.09, 0.1)], wall=0.012, floor=0.01, segments=16))
    wall = grasps_at(world, [(0.083, 0, 0.1)])
    assert (wall.angle == 0).any()
    assert (wall.span[wall.angle == 0] < 0.02).all()
    # On the floor the rim is in the palm's way.
    assert len(grasps_at(world, [(0, 0, 0.01)])) == 0


def test_opening_shrinks_where_there_is_less_room(world, at_rest):
    """Two towers with a gap of 4 cm on a plate far below: a finger of 1 cm fits between them, with 1.5 cm each side."""
    towers = [box((0.02, 0.06, 0.1), (x, 0, 0.05)) for x in (-0.03, 0.03)]
    at_rest("towers", [*towers, box((0.08, 0.06, 0.01), (0, 0, -0.005))])
    for gap, expected in ((0.04, 0.02 + 2 * 0.028),):
        grasps = grasps_at(world, [(0.03, 0, 0.11)])
        single = rows_of(grasps, (grasps.angle == 0) & (grasps.span < gap))
        assert len(single) == 1
        assert 0.02 + 2 * AntipodalRule().least_margin <= single.opening[0] <= expected


def test_edges_and_corners_slip(world, at_rest):
    """A square prism is not gripped over its edges, a round one from everywhere."""
    at_rest("diamond", rotate([box((0.08, 0.08, 0.1))], "z", 45))
    assert turn_between(grasps_at(world, [(0, 0, 0.1)]).angle, np.pi / 4).min() < STEP
    assert not (turn_between(grasps_at(world, [(0, 0, 0.1)]).angle, 0) < STEP).any()
    at_rest("column", [cylinder(0.04, 0.1, segments=32)])
    assert len(grasps_at(world, [(0, 0, 0.1)])) == AntipodalRule().directions


def test_flat_objects_have_grasps(world, at_rest):
    at_rest("ruler", [box((0.03, 0.2, 0.005))])
    assert (grasps_at(world, [(0, 0.05, 0.005)]).angle == 0).any()


def test_no_points_no_grasps(box_world):
    assert len(grasps_at(box_world, np.zeros((0, 3)))) == 0


def some_grasps(points, angles, spans) -> AntipodalGrasps:
    count = len(angles)
    spans = np.asarray(spans, dtype=float)
    return AntipodalGrasps(
        np.arange(count),
        np.asarray(points, dtype=float),
        np.asarray(angles, dtype=float),
        spans + 0.06,
        spans,
        np.ones(count),
    )


def test_the_majority_of_a_place_is_kept():
    points = [(0.01 * index, 0, 0.05) for index in range(5)]
    grasps = some_grasps(points, [0, 0, np.pi / 2, 0, 0], [0.05, 0.05, 0.02, 0.05, 0.05])
    assert agreeing(grasps, place=0.06).tolist() == [0, 1, 3, 4]
    # Far from each other they do not have to agree.
    assert agreeing(grasps, place=0.005).tolist() == [0, 1, 2, 3, 4]


COARSE = st.integers(0, 40).map(lambda value: value / 200)  # far from rounding's reach


@given(st.lists(st.tuples(COARSE, st.integers(0, 15), st.integers(2, 20)), max_size=30), COARSE)
def test_chosen_grasps_agree_and_none_could_be_added(rows, place):
    points = np.array([(x, 0, 0.05) for x, _, _ in rows]).reshape(-1, 3)
    grasps = some_grasps(points, [step * STEP for _, step, _ in rows], [size / 100 for _, _, size in rows])
    chosen = agreeing(grasps, place)

    def contradict(i, j, ratio=1.4):
        near = np.linalg.norm(points[i] - points[j]) <= place
        openings = grasps.opening[i] / grasps.opening[j]
        turn = turn_between(grasps.angle[i], grasps.angle[j])
        return near and (turn > 0.35 or max(openings, 1 / openings) > ratio)

    assert not any(contradict(i, j, 1.4001) for i in chosen for j in chosen)
    assert all(any(contradict(i, j, 1.3999) for j in chosen) for i in set(range(len(rows))) - set(chosen.tolist()))


def test_one_grasp_a_point():
    grasps = replace(
        some_grasps([(0, 0, 0.05)] * 3, [0.0, 0.1, 0.2], [0.05, 0.04, 0.06]), origin=np.zeros(3, dtype=int)
    )
    assert agreeing(grasps, place=0.06).tolist() == [1]  # the narrowest
