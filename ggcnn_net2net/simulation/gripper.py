"""The free-floating parallel gripper of the paper's simulator (section III, Fig. 1; dimensions from its public code).

Six joints carry the palm (x, y, z, roll, pitch, yaw), two prismatic joints move the jaws. At zero angles the jaws close
along world x and the fingers point down.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ggcnn_net2net.simulation.world import World

_POSE_CHAIN = (
    ("x", "prismatic", "1 0 0"),
    ("y", "prismatic", "0 1 0"),
    ("z", "prismatic", "0 0 1"),
    ("roll", "revolute", "1 0 0"),
    ("pitch", "revolute", "0 1 0"),
    ("palm", "revolute", "0 0 1"),
)
"""Links that carry the palm, with the joint that moves each; the palm's own is yaw."""

POSE_JOINTS = range(len(_POSE_CHAIN))
JAW_JOINTS = (6, 7)


@dataclass(frozen=True)
class GripperSpec:
    """Dimensions in metres, masses in kg, forces in N and speeds in m/s or rad/s. The defaults are the paper's."""

    palm: tuple[float, float, float] = (0.32, 0.02, 0.01)
    """Size along the closing direction, along the jaw and along the approach."""
    finger_length: float = 0.05
    finger_thickness: float = 0.01
    finger_width: float = 0.02
    max_opening: float = 0.30
    """Free space between the open fingers."""
    link_mass: float = 1.0
    friction: float = 1.0
    """Lateral friction of the fingers."""
    force: float = 1000.0
    """Largest force (torque) of each of the six joints that carry the palm."""
    jaw_force: float = 1000.0
    """Largest force of each jaw."""
    linear_speed: float = 0.5
    angular_speed: float = 2.0
    jaw_speed: float = 0.3
    position_gain: float = 0.3
    velocity_gain: float = 1.0

    @property
    def reach(self) -> float:
        """Distance from the palm's centre, which the six joints move, down to the fingertips."""
        return self.palm[2] / 2 + self.finger_length

    def urdf(self) -> str:
        """The gripper as URDF text."""
        travel = self.max_opening / 2
        finger_x = travel + self.finger_thickness / 2
        finger_z = -self.palm[2] / 2 - self.finger_length / 2
        finger = (self.finger_thickness, self.finger_width, self.finger_length)
        parts = [_link("world")]
        parent = "world"
        for name, kind, axis in _POSE_CHAIN:
            size = self.palm if name == "palm" else None
            parts.append(_link(name, size, mass=self.link_mass, friction=self.friction))
            parts.append(_joint(f"{name}_joint", kind, (parent, name), axis, (-10, 10), self.force))
            parent = name
        for name, side in (("left_jaw", -1), ("right_jaw", 1)):
            parts.append(_link(name, finger, (side * finger_x, 0, finger_z), self.link_mass, self.friction))
            axis = f"{-side} 0 0"  # inwards
            parts.append(_joint(f"{name}_joint", "prismatic", ("palm", name), axis, (0, travel), self.jaw_force))
        return '<?xml version="1.0"?>\n<robot name="gripper">\n' + "\n".join(parts) + "\n</robot>\n"


def _link(
    name: str,
    size: tuple[float, float, float] | None = None,
    origin: tuple[float, float, float] = (0, 0, 0),
    mass: float = 0.0,
    friction: float = 1.0,
) -> str:
    """A box with mass; without a size, a massless link between two joints."""
    shape = ""
    if size is None:
        mass = 0.0
    else:
        geometry = f'<origin xyz="{_numbers(origin)}"/><geometry><box size="{_numbers(size)}"/></geometry>'
        colour = '<material name="steel"><color rgba="0.45 0.5 0.55 1"/></material>'
        shape = (
            f"<visual>{geometry}{colour}</visual><collision>{geometry}</collision>"
            f'<contact><lateral_friction value="{friction}"/></contact>'
        )
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    return f'  <link name="{name}">{shape}<inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def _joint(name: str, kind: str, links: tuple[str, str], axis: str, limits: tuple[float, float], force: float) -> str:
    parent, child = links
    return (
        f'  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" effort="{force}" velocity="10"/></joint>'
    )


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in values)


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
        states = self._world.client.getJointStates(self.body, list(POSE_JOINTS))
        return np.array([state[0] for state in states])

    @property
    def opening(self) -> float:
        """Free space between the fingers in metres."""
        states = self._world.client.getJointStates(self.body, list(JAW_JOINTS))
        return self.spec.max_opening - sum(state[0] for state in states)

    def move_to(
        self,
        pose: npt.ArrayLike,
        tolerance: float = 0.01,
        angle_tolerance: float = np.radians(2.0),
        timeout: float = 4.0,
        on_step: Callable[[], None] | None = None,
    ) -> bool:
        """Move the palm, all joints at once, until it is there or the time is over.

        Args:
            pose: x, y, z, roll, pitch, yaw.
            tolerance: distance in metres that counts as there.
            angle_tolerance: the same for each angle, in radians.
            timeout: simulated seconds.
            on_step: called after every physics step.

        Returns:
            Whether it arrived.
        """
        target = np.asarray(pose, dtype=np.float64)
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
        for _ in range(self._world.steps_in(timeout)):
            gap = self.pose - target
            if np.sqrt(gap[:3] @ gap[:3]) < tolerance and np.abs(gap[3:]).max() < angle_tolerance:
                return True
            self._world.step()
            if on_step is not None:
                on_step()
        return False

    def set_opening(self, opening: float, duration: float = 0.6) -> None:
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
