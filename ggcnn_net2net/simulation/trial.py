"""One grasp trial: approach, close, carry to the bin, release, judge (the paper's section III and its public code)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.grasping import RSS_2018, Decoding, Grasp, grasp_to_rectangle
from ggcnn_net2net.protocol import PAPER, Protocol
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.gripper import Gripper
from ggcnn_net2net.simulation.gripper_spec import GripperSpec
from ggcnn_net2net.simulation.scenes import Scene
from ggcnn_net2net.simulation.world import STILL_TIME, Bin, Vector, World

SUCCESS_DISTANCE = 0.7
"""Metres, horizontally, between object and bin centre below which the public code of the paper counts a success. More
than half the bin's side: an object lying beside the bin can count. `in_bin` is the stricter reading."""

_APPROACH = 0.5  # metres above the grasp
_CARRY_HEIGHT = 0.75  # above the bin
_LIFTED = 0.05  # metres an object has to rise to count as lifted
_LIFT = (0.4, 0.4, 0.3)  # metres along x, y and z that `lifts` moves the gripper
_CLEAR = 0.01  # metres from an object's top to fingers that cannot touch it any more
_LOOK_EVERY = 100  # steps between two looks at how far that is


class Outcome(StrEnum):
    """How a trial ended: a success, or the reason of the failure."""

    SUCCESS = "success"
    NO_GRASP = "no grasp found"
    MISSED = "missed"
    """The object was never lifted."""
    SLIPPED = "slipped"
    """It was lifted, but no longer held above the bin."""
    DROPPED_OUTSIDE = "dropped outside"
    """It was held above the bin, but came to lie outside."""
    UNSTABLE = "unstable"
    """The scene never came to rest, or the simulation left all bounds."""
    CRASHED = "worker crashed"


@dataclass(frozen=True)
class WorldGrasp:
    """A grasp in the world: `point` (x, y, z) on the seen surface, yaw in radians, opening in metres."""

    point: tuple[float, float, float]
    yaw: float
    opening: float


@dataclass(frozen=True)
class TrialResult:
    """What came of one grasp."""

    outcome: Outcome
    success: bool
    """The paper's rule: within `SUCCESS_DISTANCE` of the bin's centre."""
    in_bin: bool
    """The stricter rule: between the bin's walls."""
    distance: float
    """Final horizontal distance between object and bin centre in metres."""
    steps: int
    """Physics steps."""
    grasp: WorldGrasp | None = None


def world_grasp(grasp: Grasp, depth: npt.NDArray[np.floating], camera: Camera) -> WorldGrasp:
    """Where a grasp of the image lies in the world, by the depth seen at its centre.

    Args:
        grasp: in pixels of `depth`.
        depth: (H, W) metres.
        camera: that took the image.

    Returns:
        Point, yaw and opening; the opening is the world length of the rectangle's edge in closing direction, as in
        the public code of the paper.
    """
    distance = float(depth[round(grasp.row), round(grasp.col)])
    point = camera.world_from_pixel(grasp.row, grasp.col, distance)
    start, end = grasp_to_rectangle(grasp)[:2].tolist()
    edge = camera.world_from_pixel(end[0], end[1], distance) - camera.world_from_pixel(start[0], start[1], distance)
    x, y, z = point.tolist()
    return WorldGrasp((x, y, z), grasp.angle, float(np.linalg.norm(edge)))


def decoding_of(protocol: Protocol) -> Decoding:
    """How the benchmark reads grasps from the maps: RSS 2018, with the protocol's choice of the angle."""
    return replace(RSS_2018, angle_window=protocol.sim_angle_window)


def run_trial(
    world: World,
    scene: Scene,
    grasp: Grasp | None,
    protocol: Protocol = PAPER,
    gripper_spec: GripperSpec | None = None,
    bin_spec: Bin | None = None,
    on_phase: Callable[[str], None] | None = None,
) -> TrialResult:
    """Execute a grasp on a scene.

    The public code always goes on to the end. Here a trial ends as soon as the object lies still below the fingers,
    where the gripper has lost it: it is judged there.

    Args:
        world: is reset first.
        scene: object and its resting pose.
        grasp: in pixels of the scene's image; None when the network found none, which is a failure.
        protocol: solver, jaws, and how far the gripper descends.
        gripper_spec: dimensions of the gripper; the paper's by default.
        bin_spec: the bin; the paper's by default.
        on_phase: called with "approach", "close", "carry", "release" and "end" when each begins; without "release"
            where the gripper has lost the object.

    Returns:
        The result. Equal arguments give bit-identical results.
    """
    bin_spec = bin_spec or Bin()
    if not scene.stable:
        return TrialResult(Outcome.UNSTABLE, False, False, bin_spec.horizontal_distance(scene.position), 0)
    if grasp is None:
        return TrialResult(Outcome.NO_GRASP, False, False, bin_spec.horizontal_distance(scene.position), 0)
    target = world_grasp(grasp, scene.depth, scene.camera)
    return run_world_grasp(world, scene, target, protocol, gripper_spec, bin_spec, on_phase)


def run_world_grasp(
    world: World,
    scene: Scene,
    target: WorldGrasp,
    protocol: Protocol = PAPER,
    gripper_spec: GripperSpec | None = None,
    bin_spec: Bin | None = None,
    on_phase: Callable[[str], None] | None = None,
) -> TrialResult:
    """Execute a grasp that is given in world coordinates; everything else as in `run_trial`."""
    bin_spec = bin_spec or Bin()
    phase = on_phase or (lambda _: None)
    body, gripper = _grip(world, scene, target, protocol, gripper_spec, bin_spec, phase)
    phase("carry")
    follower = _Follower(world, body, gripper)
    # The object, not the palm, is to hang over the bin's centre.
    offset = gripper.pose[:2] - world.pose_of(body)[0][:2]
    carry = np.array([*(np.array(bin_spec.centre[:2]) + offset), bin_spec.centre[2] + _CARRY_HEIGHT, 0, 0, target.yaw])
    gripper.move_to(carry, until=follower.follow)
    held = False
    if not follower.left_behind:
        world.run(0.5)  # lets the swing die, so that the object is not thrown
        held = _is_held(world, body, gripper)
        phase("release")
        gripper.set_opening(gripper.spec.max_opening)
        world.run(1.0)
    phase("end")

    position = world.pose_of(body)[0]
    distance = bin_spec.horizontal_distance(position)
    success = distance < SUCCESS_DISTANCE
    outcome = Outcome.SUCCESS if success else _failure(position, held, follower.lift)
    return TrialResult(outcome, success, bin_spec.contains(position), distance, world.steps, target)


def lifts(
    world: World,
    scene: Scene,
    target: WorldGrasp,
    protocol: Protocol = PAPER,
    gripper_spec: GripperSpec | None = None,
) -> bool:
    """Whether a grasp lifts the object and holds it on a part of the way to the bin: half of a trial.

    It moves sideways as well as up: an object often slips when the gripper starts or stops.

    Args:
        world: is reset first.
        scene: object and its resting pose.
        target: the grasp.
        protocol: solver, jaws, and how far the gripper descends.
        gripper_spec: dimensions of the gripper; the paper's by default.

    Returns:
        Whether the gripper still holds it.
    """
    body, gripper = _grip(world, scene, target, protocol, gripper_spec, Bin(), lambda _: None)
    follower = _Follower(world, body, gripper)
    gripper.move_to(gripper.pose + np.array([*_LIFT, 0, 0, 0]), until=follower.follow)
    return _is_held(world, body, gripper) and world.pose_of(body)[0][2] - follower.height_before > _LIFTED


def _grip(
    world: World,
    scene: Scene,
    target: WorldGrasp,
    protocol: Protocol,
    gripper_spec: GripperSpec | None,
    bin_spec: Bin,
    phase: Callable[[str], None],
) -> tuple[int, Gripper]:
    """Set up the scene, approach and close; the object's id and the gripper."""
    world.reset(protocol.solver_iterations)
    body = world.add_object(scene.model, scene.position, scene.orientation)
    world.add_bin(bin_spec)
    gripper = Gripper(world, gripper_spec, protocol.coupled_jaws)

    x, y, z = target.point
    height = z + gripper.spec.palm[2] / 2 + protocol.palm_clearance
    if protocol.fingertip_clearance is not None:
        height = max(height, gripper.spec.reach + protocol.fingertip_clearance)
    down = np.array([x, y, height, 0, 0, target.yaw])

    phase("approach")
    gripper.set_opening(target.opening)
    gripper.move_to(down + np.array([0, 0, _APPROACH, 0, 0, 0]))
    gripper.move_to(down)
    phase("close")
    gripper.set_opening(0)
    return body, gripper


class _Follower:
    """Follows the object while the gripper moves up and away with it, or without it."""

    def __init__(self, world: World, body: int, gripper: Gripper) -> None:
        self._world, self._body, self._gripper = world, body, gripper
        self.height_before = self._highest = world.pose_of(body)[0][2]
        self._is_clear, self._calm_steps = False, 0

    @property
    def lift(self) -> float:
        """Metres that the object has been lifted at most."""
        return self._highest - self.height_before

    @property
    def left_behind(self) -> bool:
        """Whether the object lies still below the fingers, which only rise: the gripper cannot touch it any more."""
        return self._calm_steps >= self._world.steps_in(STILL_TIME)

    def follow(self) -> bool:
        """Look at the object after a step; returns `left_behind`."""
        self._highest = max(self._highest, self._world.pose_of(self._body)[0][2])
        if self._world.steps % _LOOK_EVERY == 0:
            top = self._world.box_of(self._body)[1][2]
            self._is_clear = self._gripper.lowest - top > _CLEAR
        self._calm_steps = self._calm_steps + 1 if self._is_clear and self._world.is_calm(self._body) else 0
        return self.left_behind


def _failure(position: Vector, held: bool, lift: float) -> Outcome:
    """Reason of a failure: from where the object is, whether it hung above the bin, and how far it was lifted."""
    if not np.isfinite(position).all() or np.abs(position).max() > 10:
        return Outcome.UNSTABLE
    if held:
        return Outcome.DROPPED_OUTSIDE
    return Outcome.SLIPPED if lift > _LIFTED else Outcome.MISSED


def _is_held(world: World, body: int, gripper: Gripper) -> bool:
    """Whether the gripper touches the object, which nothing else holds up at carrying height."""
    return bool(world.client.getContactPoints(body, gripper.body))
