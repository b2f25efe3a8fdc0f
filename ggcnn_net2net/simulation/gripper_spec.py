"""What a gripper is like: dimensions, forces, speeds, as a value, as a TOML file and as URDF text."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ggcnn_net2net.errors import GripperError

POSE_CHAIN = (
    ("x", "prismatic", "1 0 0"),
    ("y", "prismatic", "0 1 0"),
    ("z", "prismatic", "0 0 1"),
    ("roll", "revolute", "1 0 0"),
    ("pitch", "revolute", "0 1 0"),
    ("palm", "revolute", "0 0 1"),
)
"""Links that carry the palm, with the joint that moves each; the palm's own is yaw."""

MOVE_TIME = 4.0
"""Simulated seconds that a move of the palm may take."""
JAW_TIME = 0.6
"""Simulated seconds of a move of the jaws."""

_LONGEST_MOVE = 1.5  # metres, from an object to the bin, along x and along y
_LONGEST_REACH = 0.5  # metres; the gripper comes from 0.5 m above the grasp, and carries at 0.75 m
_LENGTHS = ("palm", "finger_length", "finger_thickness", "finger_width", "max_opening")


def _is_positive(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and value > 0


@dataclass(frozen=True)
class GripperSpec:
    """Dimensions in metres, masses in kg, forces in N and speeds in m/s or rad/s. The defaults are the paper's.

    Raises:
        GripperError: a value that is not positive, or one with which no trial can succeed.
    """

    palm: tuple[float, float, float] = (0.32, 0.02, 0.01)
    """Size along the closing direction, along the jaw and along the approach."""
    finger_length: float = 0.05
    finger_thickness: float = 0.01
    finger_width: float = 0.02
    max_opening: float = 0.30
    """Free space between the open fingers."""
    link_mass: float = 1.0
    friction: float = 1.0
    """Lateral friction of fingers and palm."""
    force: float = 1000.0
    """Largest force (torque) of each of the six joints that carry the palm."""
    jaw_force: float = 1000.0
    """Largest force of each jaw."""
    linear_speed: float = 0.5
    angular_speed: float = 2.0
    jaw_speed: float = 0.3
    position_gain: float = 0.3
    velocity_gain: float = 1.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            is_palm = name == "palm"
            numbers = value if is_palm and isinstance(value, tuple) else (value,)
            if len(numbers) != (3 if is_palm else 1) or not all(map(_is_positive, numbers)):
                expected = "three positive numbers" if is_palm else "a positive number"
                raise GripperError(f"expected {expected} for a gripper's {name}, received {value!r}")
            if name in _LENGTHS and max(numbers) > 1:
                raise GripperError(f"expected a gripper's {name} in metres, at most 1, received {value!r}")
        if self.reach > _LONGEST_REACH:
            raise GripperError(
                f"expected a gripper that reaches at most {_LONGEST_REACH} m down from its palm's centre, received "
                f"{self.reach:.3g} m: half of the palm's {self.palm[2]} and finger_length {self.finger_length}"
            )
        slowest = {
            "linear_speed": _LONGEST_MOVE / MOVE_TIME,
            "angular_speed": math.pi / 2 / MOVE_TIME,
            "jaw_speed": self.max_opening / 2 / JAW_TIME,
        }
        for name, speed in slowest.items():
            if (received := getattr(self, name)) < speed - 1e-9:
                raise GripperError(
                    f"expected a gripper's {name} of {speed:.3g} or more, so that its moves end in the protocol's time "
                    f"({MOVE_TIME} s, jaws {JAW_TIME} s), received {received}"
                )

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> GripperSpec:
        """The gripper with these fields, as TOML and JSON hold them; fields that are not given are the paper's.

        Args:
            values: by name of the field; the palm as a list.

        Returns:
            The gripper.

        Raises:
            GripperError: no such field, or values that cannot be used.
        """
        known = [field.name for field in fields(cls)]
        unknown = [name for name in values if name not in known]
        if unknown:
            raise GripperError(f"expected a gripper's {', '.join(known)}, received {', '.join(map(str, unknown))}")
        own: dict[str, Any] = {name: tuple(it) if isinstance(it, list) else it for name, it in values.items()}
        return cls(**own)

    def as_setting(self) -> dict[str, Any]:
        """Its entry among the settings of results, as JSON holds it: {"gripper": fields}, or {} for the paper's.

        So results of the paper's gripper are the same whether or not grippers can be chosen.
        """
        return {} if self == PAPER_GRIPPER else {"gripper": {**asdict(self), "palm": list(self.palm)}}

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
        for name, kind, axis in POSE_CHAIN:
            size = self.palm if name == "palm" else None
            parts.append(_link(name, size, mass=self.link_mass, friction=self.friction))
            parts.append(_joint(f"{name}_joint", kind, (parent, name), axis, (-10, 10), self.force))
            parent = name
        for name, side in (("left_jaw", -1), ("right_jaw", 1)):
            parts.append(_link(name, finger, (side * finger_x, 0, finger_z), self.link_mass, self.friction))
            axis = f"{-side} 0 0"  # inwards
            parts.append(_joint(f"{name}_joint", "prismatic", ("palm", name), axis, (0, travel), self.jaw_force))
        return '<?xml version="1.0"?>\n<robot name="gripper">\n' + "\n".join(parts) + "\n</robot>\n"


PAPER_GRIPPER = GripperSpec()
"""The gripper of the paper's simulator."""


def load_gripper(path: Path) -> GripperSpec:
    """Read a gripper from a TOML file: `max_opening = 0.08` and so on.

    Args:
        path: file whose keys are fields of `GripperSpec`; those that are not there have the paper's values.

    Returns:
        The gripper.

    Raises:
        GripperError: a file that cannot be read, an unknown key, or values that cannot be used.
    """
    try:
        return GripperSpec.from_dict(tomllib.loads(Path(path).read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise GripperError(f"expected a TOML file that describes a gripper, cannot read {path}: {error}") from error
    except GripperError as error:
        raise GripperError(f"{error}; correct it in {path}") from error


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
