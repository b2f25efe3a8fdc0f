from dataclasses import replace

import numpy as np
import pytest

from ggcnn_net2net.simulation import GripperSpec
from ggcnn_net2net.simulation.gripper import Gripper


@pytest.fixture
def gripper(world):
    world.reset()
    return Gripper(world)


def finger_boxes(world, gripper):
    return [np.array(world.client.getAABB(gripper.body, joint)) for joint in (6, 7)]


def test_dimensions_are_the_papers(world, gripper):
    world.step()
    palm = np.ptp(np.array(world.client.getAABB(gripper.body, 5)), axis=0)
    np.testing.assert_allclose(palm, (0.32, 0.02, 0.01), atol=3e-3)
    left, right = finger_boxes(world, gripper)
    np.testing.assert_allclose(np.ptp(left, axis=0), (0.01, 0.02, 0.05), atol=3e-3)
    assert right.mean(axis=0)[0] - left.mean(axis=0)[0] == pytest.approx(0.31, abs=1e-3)
    fingertip = left[0, 2]
    assert gripper.pose[2] - fingertip == pytest.approx(gripper.spec.reach, abs=3e-3)
    assert gripper.lowest == pytest.approx(fingertip, abs=1e-6)


@pytest.mark.parametrize("opening", [0.0, 0.1, 0.3, 0.5])
def test_opening_is_the_free_space_between_the_fingers(world, gripper, opening):
    gripper.set_opening(opening)
    reachable = min(opening, 0.3)
    assert gripper.opening == pytest.approx(reachable, abs=2e-3)
    left, right = finger_boxes(world, gripper)
    assert right[0, 0] - left[1, 0] == pytest.approx(reachable, abs=5e-3)


def test_coupled_jaws_share_what_a_single_one_meets(world, box_scene):
    """A heavy wall on one side only stops one jaw, and through the gear the other."""

    def travel(coupled):
        world.reset()
        world.add_object(replace(box_scene.model, longest_side=1e6), (0.09, 0, 0.0401), (0, 0, 0, 1))
        gripper = Gripper(world, coupled_jaws=coupled)
        gripper.move_to([0, 0, 0.07, 0, 0, 0])
        gripper.set_opening(0.0)
        return [state[0] for state in world.client.getJointStates(gripper.body, [6, 7])]

    left, right = travel(coupled=False)
    assert left > right + 0.05
    left, right = travel(coupled=True)
    assert left == pytest.approx(right, abs=5e-3)


def test_moves_with_the_given_speed_and_arrives(world, gripper):
    target = np.array([0.5, -0.3, 0.6, 0, 0, 0.7])
    before = world.steps
    assert gripper.move_to(target)
    np.testing.assert_allclose(gripper.pose[:3], target[:3], atol=0.01)
    assert gripper.pose[5] == pytest.approx(0.7, abs=np.radians(2))
    assert (world.steps - before) * 1e-3 == pytest.approx(0.5 / 0.5, rel=0.15)  # 0.5 m along x at 0.5 m/s


def test_a_move_that_cannot_end_gives_up_after_the_timeout(world, gripper):
    before = world.steps
    assert not gripper.move_to([0, 0, -0.5, 0, 0, 0], timeout=3.0)  # into the plane
    assert world.steps - before == 3000


def test_yaw_turns_the_closing_direction(world, gripper):
    gripper.move_to([0, 0, 0.5, 0, 0, np.pi / 2])
    left, right = (box.mean(axis=0) for box in finger_boxes(world, gripper))
    np.testing.assert_allclose(right - left, (0, 0.31, 0), atol=0.02)


def test_another_gripper_by_configuration(world):
    world.reset()
    small = Gripper(world, GripperSpec(palm=(0.12, 0.02, 0.02), finger_length=0.04, max_opening=0.1))
    world.step()
    left, right = finger_boxes(world, small)
    assert right[0, 0] - left[1, 0] == pytest.approx(0.1, abs=5e-3)
    assert small.spec.reach == pytest.approx(0.05)
