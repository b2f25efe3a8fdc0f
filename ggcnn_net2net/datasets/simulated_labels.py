"""Labels of simulated scenes: antipodal grasps by the true geometry, tried in simulation where it is not sure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle, wrap_angle
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec
from ggcnn_net2net.simulation.antipodal import (
    LOOSE_RULE,
    AntipodalGrasps,
    AntipodalRule,
    agreeing,
    find_antipodal_grasps,
    rows_of,
)
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.scenes import Scene
from ggcnn_net2net.simulation.trial import WorldGrasp, lifts
from ggcnn_net2net.simulation.world import World

TRIES = 12
"""Grasps of a scene that are tried."""
ALIKE = (0.009, 0.105)
"""Metres and radians: a grasp like one that held counts as holding, too, if its differences, divided by these,
add up to 1 at most."""
_POINTS = 300  # at which grasps are looked for in a scene
_LOWEST = 0.003  # metres above the plane from which a pixel belongs to the object
_JAW = 1 / 3  # side of a rectangle along the jaws, in openings


@dataclass(frozen=True)
class Labels:
    """n grasps and where they are seen."""

    grasps: AntipodalGrasps
    pixels: npt.NDArray[np.intp]
    """(n, 2) row and col of their points."""

    def only(self, rows: npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> Labels:
        """Some of them, by a mask or by indices."""
        return Labels(rows_of(self.grasps, rows), self.pixels[rows])


def label_grasps(world: World, body: int, scene: Scene, place: float, gripper: GripperSpec = PAPER_GRIPPER) -> Labels:
    """Grasps of what the camera sees by the usual rule, one closing direction a place.

    Args:
        world: with the object at rest.
        body: the object's id.
        scene: how it is seen; depth without noise.
        place: metres within which grasps have to agree.
        gripper: what is to grasp.

    Returns:
        Grasps that agree with each other; none, if the object offers none.
    """
    found = candidate_grasps(world, body, scene, AntipodalRule(), gripper)
    return found.only(agreeing(found.grasps, place))


def tried_grasps(
    world: World,
    body: int,
    scene: Scene,
    place: float,
    gripper: GripperSpec,
    protocol: Protocol,
    rng: np.random.Generator,
) -> Labels:
    """Grasps by the loose rule that hold in simulation: for objects that offer too few by the usual one.

    A dozen, drawn at random, are tried. Another grasp counts as holding if, of the tried ones, the most similar to it
    held and they differ by `ALIKE` at most.

    Args:
        world: with the object at rest; afterwards in any state.
        body: the object's id.
        scene: how it is seen; depth without noise.
        place: metres within which grasps have to agree.
        gripper: what is to grasp.
        protocol: of the trials.
        rng: draws the grasps that are tried.

    Returns:
        Grasps that agree with each other; none, if none of those that were tried holds.
    """
    found = candidate_grasps(world, body, scene, LOOSE_RULE, gripper)
    if len(found.grasps) == 0:
        return found
    tried = rng.permutation(len(found.grasps))[:TRIES]
    targets = [target_of(found.grasps, index) for index in tried]
    held = np.array([lifts(world, scene, target, protocol, gripper) for target in targets])
    holding = found.only(_like_holding(found.grasps, tried, held))
    return holding.only(agreeing(holding.grasps, place))


def label_rectangles(labels: Labels, depth: npt.NDArray[np.floating], camera: Camera) -> npt.NDArray[np.float64]:
    """(n, 4, 2) rectangles (row, col), a third as wide as they are long.

    A jaw is narrower, but the IoU rate compares with predictions half as wide as long, and would reject all of them.

    Args:
        labels: n grasps.
        depth: (H, W) metres, without noise.
        camera: that took it.

    Returns:
        (n, 4, 2) corners (row, col) in pixels.
    """
    scale = camera.focal_px / depth[labels.pixels[:, 0], labels.pixels[:, 1]]
    openings = labels.grasps.opening * scale
    corners = [
        grasp_to_rectangle(Grasp(row, col, wrap_angle(angle), opening), opening * _JAW)
        for (row, col), angle, opening in zip(labels.pixels.tolist(), labels.grasps.angle, openings, strict=True)
    ]
    return np.array(corners).reshape(-1, 4, 2)


def candidate_grasps(world: World, body: int, scene: Scene, rule: AntipodalRule, gripper: GripperSpec) -> Labels:
    """All grasps by a rule, at points spread evenly over what the camera sees of the object.

    Args:
        world: with the object at rest.
        body: the object's id.
        scene: how it is seen; depth without noise.
        rule: what makes a grasp.
        gripper: what is to grasp.

    Returns:
        The grasps, whether they agree with each other or not.
    """
    points = scene.camera.world_from_image(scene.depth)
    seen = points[..., 2] > _LOWEST
    stride = max(int(np.ceil(np.sqrt(seen.sum() / _POINTS))), 1)
    chosen = np.zeros_like(seen)
    chosen[::stride, ::stride] = seen[::stride, ::stride]
    rows, cols = np.nonzero(chosen)
    grasps = find_antipodal_grasps(world.client, body, points[rows, cols], rule, gripper)
    return Labels(grasps, np.stack([rows, cols], axis=1)[grasps.origin])


def target_of(grasps: AntipodalGrasps, index: int) -> WorldGrasp:
    """One of the grasps, as the simulator executes it.

    Args:
        grasps: n grasps.
        index: which.

    Returns:
        Point, yaw and opening.
    """
    x, y, z = grasps.point[index].tolist()
    return WorldGrasp((x, y, z), float(grasps.angle[index]), float(grasps.opening[index]))


def _like_holding(
    grasps: AntipodalGrasps, tried: npt.NDArray[np.intp], held: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """(n,) whether the tried grasp most similar to each grasp, in place and direction, held and is close enough."""
    distance = np.linalg.norm(grasps.point[:, None] - grasps.point[tried], axis=-1)
    turn = np.abs((grasps.angle[:, None] - grasps.angle[tried] + np.pi / 2) % np.pi - np.pi / 2)
    unlike = distance / ALIKE[0] + turn / ALIKE[1]
    near: npt.NDArray[np.bool_] = held[unlike.argmin(axis=1)] & (unlike.min(axis=1) <= 1)
    return near
