"""The physical world of the benchmark: plane, gravity, one object, a bin. Repeats bit for bit after `reset()`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pybullet
import pybullet_data
from pybullet_utils.bullet_client import BulletClient

from ggcnn_net2net.errors import SimulationError
from ggcnn_net2net.quiet import silence_output

if TYPE_CHECKING:
    from ggcnn_net2net.simulation.object_sets import ObjectModel

TIME_STEP = 1e-3
GRAVITY = -10.0
STILL_TIME = 0.1
"""Seconds that a body has to be calm for to lie still."""

_CALM_SPEED, _CALM_TURN = 2e-3, 2e-2  # m/s, rad/s

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Bin:
    """The bin that objects are dropped into: a square floor with four walls. Metres."""

    centre: Vector = (1.5, 1.5, 0.01)
    side: float = 1.0
    wall_height: float = 0.2
    thickness: float = 0.02

    def contains(self, point: npt.ArrayLike) -> bool:
        """Whether a point lies between the walls and below their upper edge."""
        x, y, z = np.asarray(point) - self.centre
        inside = self.side / 2 - self.thickness
        return bool(abs(x) < inside and abs(y) < inside and z < self.wall_height)

    def horizontal_distance(self, point: npt.ArrayLike) -> float:
        """Distance of a point from the bin's centre, seen from above."""
        return float(np.hypot(*(np.asarray(point)[:2] - self.centre[:2])))


class World:
    """One pybullet client. `reset()` empties it down to the plane; `close()` or a `with` block ends it.

    `on_step` is called after every physics step, for recording.
    """

    def __init__(self, gui: bool = False) -> None:
        """Start a physics server; with `gui` it has a window and runs no faster than real time.

        Args:
            gui: whether to show a window.

        Raises:
            SimulationError: a window is wanted where there is no display.
        """
        if gui and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
            # pybullet would wait for ever.
            raise SimulationError("expected a display for the window, received none (DISPLAY is not set): leave --gui")
        self._gui = gui
        with silence_output():
            self.client: Any = BulletClient(pybullet.GUI if gui else pybullet.DIRECT)
        # Asked at every step; the client would look them up anew.
        self._step_simulation = self.client.stepSimulation
        self._base_pose = self.client.getBasePositionAndOrientation
        self._base_velocity = self.client.getBaseVelocity
        self.on_step: Callable[[], None] | None = None
        self.reset()

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect from the physics server."""
        self.client.disconnect()

    def reset(self, solver_iterations: int = 50) -> None:
        """Remove everything and start again from the bare plane at step 0; 50 iterations are pybullet's default."""
        self.steps = 0
        self.client.resetSimulation()
        self.client.setPhysicsEngineParameter(deterministicOverlappingPairs=1, numSolverIterations=solver_iterations)
        self.client.setTimeStep(TIME_STEP)
        self.client.setGravity(0, 0, GRAVITY)
        self.client.loadURDF(str(Path(pybullet_data.getDataPath()) / "plane.urdf"))

    @staticmethod
    def steps_in(seconds: float) -> int:
        """Physics steps in a simulated time."""
        return round(seconds / TIME_STEP)

    def step(self) -> None:
        """Advance the simulation by one time step."""
        self._step_simulation()
        self.steps += 1
        if self._gui:
            time.sleep(TIME_STEP)
        if self.on_step is not None:
            self.on_step()

    def run(self, seconds: float) -> None:
        """Advance the simulation by a simulated time."""
        for _ in range(self.steps_in(seconds)):
            self.step()

    def add_object(self, model: ObjectModel, position: Vector, orientation: Quaternion) -> int:
        """Put an object into the world, its centre at `position`; returns its body id.

        Args:
            model: the object; its mass in kg is its longest side in metres.
            position: (x, y, z) in metres.
            orientation: quaternion (x, y, z, w).

        Returns:
            pybullet's id of the body.

        Raises:
            SimulationError: pybullet cannot load the mesh.
        """
        shape = {
            "shapeType": pybullet.GEOM_MESH,
            "fileName": str(model.mesh),
            "meshScale": [model.scale] * 3,
        }
        offset = [-value for value in model.centre]
        try:
            collision = self.client.createCollisionShape(**shape, collisionFramePosition=offset)
            visual = self.client.createVisualShape(
                **shape,
                visualFramePosition=offset,
                rgbaColor=[0.85, 0.45, 0.2, 1],
                specularColor=[0.1, 0.1, 0.1],
            )
            body = self.client.createMultiBody(
                baseMass=model.mass,
                baseCollisionShapeIndex=collision,
                baseVisualShapeIndex=visual,
                basePosition=position,
                baseOrientation=orientation,
            )
        except pybullet.error as error:
            raise SimulationError(f"pybullet cannot load {model.mesh} of object {model.name!r}: {error}") from error
        return int(body)

    def add_bin(self, spec: Bin) -> None:
        """Put the bin into the world."""
        half, thin = spec.side / 2, spec.thickness / 2
        wall = spec.wall_height / 2
        boxes: list[tuple[list[float], list[float]]] = [
            ([half, half, thin], [0, 0, 0]),
            ([half, thin, wall], [0, half - thin, wall]),
            ([half, thin, wall], [0, thin - half, wall]),
            ([thin, half, wall], [half - thin, 0, wall]),
            ([thin, half, wall], [thin - half, 0, wall]),
        ]
        for half_extents, offset in boxes:
            collision = self.client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half_extents)
            visual = self.client.createVisualShape(
                pybullet.GEOM_BOX, halfExtents=half_extents, rgbaColor=[0.3, 0.45, 0.7, 1]
            )
            self.client.createMultiBody(
                baseCollisionShapeIndex=collision,
                baseVisualShapeIndex=visual,
                basePosition=np.add(spec.centre, offset).tolist(),
            )

    def pose_of(self, body: int) -> tuple[Vector, Quaternion]:
        """Position and orientation of a body's centre of mass."""
        position, orientation = self._base_pose(body)
        return position, orientation

    def box_of(self, body: int, link: int = -1) -> tuple[Vector, Vector]:
        """Lowest and highest corner of the box along the axes that holds a link of a body, by default its base."""
        low, high = self.client.getAABB(body, link)
        return low, high

    def is_calm(self, body: int) -> bool:
        """Whether a body moves by less than 2 mm/s and turns by less than 0.02 rad/s."""
        linear, angular = self._base_velocity(body)
        return bool(np.dot(linear, linear) < _CALM_SPEED**2 and np.dot(angular, angular) < _CALM_TURN**2)

    def settle(self, body: int, timeout: float = 10.0) -> bool:
        """Step until a body has been calm for 0.1 s.

        Args:
            body: its id.
            timeout: simulated seconds to wait.

        Returns:
            Whether it came to rest.
        """
        calm = 0
        for _ in range(self.steps_in(timeout)):
            self.step()
            calm = calm + 1 if self.is_calm(body) else 0
            if calm >= self.steps_in(STILL_TIME):
                return True
        return False


@cache
def process_world() -> World:
    """The one world of a worker process; connecting costs more than resetting."""
    return World()
