"""The free-floating parallel gripper of the paper's simulator (section III, Fig. 1; dimensions from its public code).

Six joints carry the palm (x, y, z, roll, pitch, yaw), two prismatic joints move the jaws. At zero angles the jaws close
along world x and the fingers point down.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.simulation.gripper_spec import JAW_TIME, MOVE_TIME, POSE_CHAIN, GripperSpec

if TYPE_CHECKING:
    from ggcnn_net2net.simulation.world import World

POSE_JOINTS = range(len(POSE_CHAIN))
JAW_JOINTS = (6, 7)


class Gripper:
    """The gripper in a `World`; it starts open, 1 m above the origin, and moves by stepping that world."""

    def __init__(self, world: World, spec: GripperSpec | None = None, coupled_jaws: bool = False) -> None:
        """Put the gripper into `world`; with `coupled_jaws`, both jaws always move by the same distance.

        Args:
            world: where to.
            spec: sizes, forces and speeds; None: the paper's.
            coupled_jaws: field of `Protocol`.
        """
        self.spec = spec or GripperSpec()
        self._world = world
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(self.spec.urdf())
            file.flush()
            self.body = world.client.loadURDF(file.name, useFixedBase=True)
        # Asked after every step; the client would look them up anew.
        self._joint_state, self._joint_states = world.client.getJointState, world.client.getJointStates
        world.client.resetJointState(self.body, 2, 1.0)
        if coupled_jaws:
            self._couple_jaws()

    def _couple_jaws(self) -> None:
        left, right = JAW_JOINTS
        gear = self._world.client.createConstraint(
            self.body,
            left,
            self.body,
            right,
            jointType=self._world.client.JOINT_GEAR,
            jointAxis=(1, 0, 0),
            parentFramePosition=(0, 0, 0),
            childFramePosition=(0, 0, 0),
        )
        # The jaws' axes point at each other, so equal travel of both is a ratio of -1.
        self._world.client.changeConstraint(gear, gearRatio=-1, maxForce=10 * self.spec.force, erp=0.5)

    @property
    def pose(self) -> npt.NDArray[np.float64]:
        """x, y, z of the palm's centre in metres, roll, pitch, yaw in radians."""
        return np.array(self._positions(POSE_JOINTS))

    @property
    def opening(self) -> float:
        """Free space between the fingers in metres."""
        return self.spec.max_opening - sum(self._positions(JAW_JOINTS))

    @property
    def lowest(self) -> float:
        """Height of the lower fingertip in metres."""
        return min(self._world.box_of(self.body, joint)[0][2] for joint in JAW_JOINTS)

    def _positions(self, joints: Sequence[int]) -> list[float]:
        return [state[0] for state in self._joint_states(self.body, joints)]

    def move_to(
        self,
        pose: npt.ArrayLike,
        tolerance: float = 0.01,
        angle_tolerance: float = np.radians(2.0),
        timeout: float = MOVE_TIME,
        until: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Move the palm, all joints at once, until it is there, the time is over, or `until` says so.

        Args:
            pose: x, y, z, roll, pitch, yaw.
            tolerance: distance in metres that counts as there.
            angle_tolerance: the same for each angle, in radians.
            timeout: simulated seconds.
            until: asked after every physics step.

        Returns:
            Whether it arrived.
        """
        target = np.asarray(pose, dtype=np.float64).tolist()
        for joint in POSE_JOINTS:
            self._world.client.setJointMotorControl2(
                self.body,
                joint,
                self._world.client.POSITION_CONTROL,
                targetPosition=target[joint],
                targetVelocity=0,
                force=self.spec.force,
                maxVelocity=self.spec.linear_speed if joint < 3 else self.spec.angular_speed,
                positionGain=self.spec.position_gain,
                velocityGain=self.spec.velocity_gain,
            )
        tolerances = [tolerance] * 3 + [angle_tolerance] * 3
        gaps = [abs(wanted - is_at) for wanted, is_at in zip(target, self._positions(POSE_JOINTS), strict=True)]
        farthest = max(POSE_JOINTS, key=lambda joint: gaps[joint] / tolerances[joint])
        for _ in range(self._world.steps_in(timeout)):
            # One joint is asked for in a fraction of the time that all take: 3% of a trial.
            position, *_ = self._joint_state(self.body, farthest)
            if abs(target[farthest] - position) < tolerances[farthest] and self._is_at(
                target, tolerance, angle_tolerance
            ):
                return True
            self._world.step()
            if until():
                break
        return False

    def _is_at(self, target: Sequence[float], tolerance: float, angle_tolerance: float) -> bool:
        """See `move_to`."""
        pose = self._positions(POSE_JOINTS)
        return math.dist(pose[:3], target[:3]) < tolerance and all(
            abs(angle - wanted) < angle_tolerance for angle, wanted in zip(pose[3:], target[3:], strict=True)
        )

    def set_opening(self, opening: float, duration: float = JAW_TIME) -> None:
        """Drive both jaws towards an opening in metres (0 to `max_opening`) for `duration` simulated seconds."""
        travel = (self.spec.max_opening - np.clip(opening, 0, self.spec.max_opening)) / 2
        for joint in JAW_JOINTS:
            self._world.client.setJointMotorControl2(
                self.body,
                joint,
                self._world.client.POSITION_CONTROL,
                targetPosition=travel,
                targetVelocity=0,
                force=self.spec.jaw_force,
                maxVelocity=self.spec.jaw_speed,
            )
        self._world.run(duration)
