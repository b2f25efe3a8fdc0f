"""Antipodal grasps of an object at rest, from its true geometry: the labels of simulated scenes.

A candidate is a point of the seen surface and a closing direction. The gripper comes straight down, open, until its
palm stands on that point or its fingertips on the plane. The candidate is a grasp when

1. nothing blocks the palm, and both open fingers find free space;
2. each finger, closing, touches surface that faces it;
3. the two contacts lie opposite each other;
4. the point lies about halfway between them.

The first is read from a height map of the object, the others from rays along the closing direction. All lengths are in
metres, in world coordinates: z up, the plane at z = 0. "Sides" are 0 and 1: along the closing direction and against it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter

from ggcnn_net2net.simulation.gripper_spec import GripperSpec

FloatArray = npt.NDArray[np.float64]

_CELL = 0.002  # between the rays of the height map, and the samples taken from it
_ACROSS = 0.005  # between the lines along the closing direction
_RAYS_AT_ONCE = 16_000  # pybullet takes at most 16384
_RAY_HEIGHTS = np.array([0.04, 0.12, 0.3, 0.6, 0.92])  # above the tip, in lengths of the finger; low things count
_RAYS_ACROSS = np.array([-0.6, 0.0, 0.6])  # from the finger's middle, in halves of its width


@dataclass(frozen=True)
class AntipodalRule:
    """What makes a candidate a grasp; lengths in metres."""

    directions: int = 16
    """Closing directions tried at every point, evenly over π."""
    margin: float = 0.03
    """Free space between object and open finger, where there is room for it."""
    least_margin: float = 0.012
    """The same, at least."""
    alignment: float = 0.92
    """Least cosine between the closing direction and the surface normal, averaged over where a finger touches. Friction
    (finger 1 x object 0.5) would hold up to 27°; at 23° there is something left for what rays cannot see."""
    contact: float = 0.25
    """Least share of the rays from a finger that end where it touches. They also have to lie beside each other, not
    only above: edges and corners slip, and their normals say nothing."""
    centring: float = 0.012
    """Most distance of the point from the middle between the contacts."""
    opposition: float = 0.008
    """Most distance between the contacts along the jaws."""
    contact_depth: float = 0.003
    """How much farther in than the first contact a surface may lie to count as touched."""
    palm_play: float = 0.01
    """How far the object may stand above the palm's height: the gripper's moves end within 0.01 m."""


LOOSE_RULE = AntipodalRule(alignment=0.7, contact=0.06, centring=0.03, opposition=0.03, palm_play=0.03)
"""Grasps that may hold or slip, for objects that offer none by the usual rule: walls that lean, rounded edges. Each has
to be tried."""


@dataclass(frozen=True)
class AntipodalGrasps:
    """n grasps in world coordinates."""

    origin: npt.NDArray[np.intp]
    """(n,) index of the point among those that were asked for."""
    point: FloatArray
    """(n, 3) point of the surface on which the palm is put."""
    angle: FloatArray
    """(n,) closing direction in radians from world x, [0, π)."""
    opening: FloatArray
    """(n,) distance of the open fingers, with its margin."""
    span: FloatArray
    """(n,) distance of the contacts."""
    alignment: FloatArray
    """(n,) mean cosine between closing direction and normal, of the finger where it is smaller."""

    def __len__(self) -> int:
        return len(self.angle)


def find_antipodal_grasps(
    client: Any,
    body: int,
    points: npt.ArrayLike,
    rule: AntipodalRule | None = None,
    gripper: GripperSpec | None = None,
) -> AntipodalGrasps:
    """All grasps at the given points of an object's surface.

    Args:
        client: pybullet client in which the object rests on the plane z = 0.
        body: its id.
        points: (m, 3) points of the surface that the camera sees.
        rule: thresholds.
        gripper: dimensions of the gripper; the paper's by default.

    Returns:
        Grasps in the order of points and directions; none, one or several at a point.
    """
    rule, gripper = rule or AntipodalRule(), gripper or GripperSpec()
    candidates = _candidates(np.asarray(points, dtype=np.float64).reshape(-1, 3), rule, gripper)
    room = _free_space(_HeightMap(client, body), candidates, rule, gripper)
    candidates, room = rows_of(candidates, room.exists), rows_of(room, room.exists)
    contacts = _touch(client, body, candidates, room, rule, gripper)
    farther = contacts.distance.max(axis=1)
    half = np.minimum(farther + rule.margin, room.last)
    good = (
        (contacts.alignment.min(axis=1) >= rule.alignment)
        & (contacts.size.min(axis=1) >= rule.contact)
        & (np.abs(np.diff(contacts.across, axis=1)[:, 0]) <= rule.opposition)
        & (np.abs(np.diff(contacts.distance, axis=1)[:, 0]) <= 2 * rule.centring)
        & (half >= np.maximum(farther + rule.least_margin, room.first))
    )
    grasps = AntipodalGrasps(
        candidates.origin,
        candidates.point,
        candidates.angle,
        2 * half,
        contacts.distance.sum(axis=1),
        contacts.alignment.min(axis=1),
    )
    return rows_of(grasps, good)


def agreeing(grasps: AntipodalGrasps, place: float, angle: float = 0.35, ratio: float = 1.4) -> npt.NDArray[np.intp]:
    """Choose grasps that do not contradict each other, at most one at a point.

    Those with the most agreeing grasps around them come first, so that the chosen ones cover as much of the object as
    can be; among equals the narrower one.

    Args:
        grasps: all grasps of an object.
        place: distance within which two chosen grasps have to agree.
        angle: most difference of their closing directions in radians.
        ratio: most ratio of their openings.

    Returns:
        Indices of the chosen grasps, in the order of their points.
    """

    def compare(index: int) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Which grasps are near one, and which contradict it."""
        near = np.linalg.norm(grasps.point - grasps.point[index], axis=1) <= place
        turn = np.abs((grasps.angle - grasps.angle[index] + np.pi / 2) % np.pi - np.pi / 2)
        openings = grasps.opening / grasps.opening[index]
        return near, (turn > angle) | (np.maximum(openings, 1 / openings) > ratio)

    support = np.zeros(len(grasps))
    for index in range(len(grasps)):
        near, contrary = compare(index)
        support[index] = np.count_nonzero(near & ~contrary)
    left = np.ones(len(grasps), dtype=bool)
    chosen = []
    for index in np.lexsort([grasps.span, -support]):
        if left[index]:
            chosen.append(index)
            near, contrary = compare(index)
            left &= ~(near & contrary) & (grasps.origin != grasps.origin[index])
    return np.sort(np.array(chosen, dtype=np.intp))


Rows = TypeVar("Rows", bound=Any)


def rows_of(table: Rows, rows: npt.NDArray[Any]) -> Rows:
    """The given rows (a mask or indices) of a dataclass of arrays."""
    return type(table)(*(getattr(table, field.name)[rows] for field in fields(table)))


@dataclass(frozen=True)
class _Candidates:
    """n points and directions."""

    origin: npt.NDArray[np.intp]  # (n,)
    point: FloatArray  # (n, 3)
    angle: FloatArray  # (n,)
    closing: FloatArray  # (n, 2) unit vectors
    jaw: FloatArray  # (n, 2) unit vectors, a quarter turn further
    tip: FloatArray  # (n,) height of the fingertips


def _candidates(points: FloatArray, rule: AntipodalRule, gripper: GripperSpec) -> _Candidates:
    directions = np.arange(rule.directions) * np.pi / rule.directions
    point, angle = np.repeat(points, len(directions), axis=0), np.tile(directions, len(points))
    cos, sin = np.cos(angle), np.sin(angle)
    tip = np.maximum(point[:, 2] - gripper.finger_length, 0)
    origin = np.repeat(np.arange(len(points)), len(directions))
    return _Candidates(origin, point, angle, np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1), tip)


class _HeightMap:
    """Height of a body on a grid of cells, 0 where it is not, each height spread over the neighbouring cells."""

    def __init__(self, client: Any, body: int) -> None:
        low, high = (np.array(corner) for corner in client.getAABB(body))
        self._origin = low[:2] - 3 * _CELL
        counts = np.ceil((high[:2] - self._origin) / _CELL).astype(int) + 3
        x, y = np.meshgrid(*(np.arange(count) * _CELL for count in counts), indexing="ij")
        top, bottom = high[2] + 0.01, -0.01
        start = np.stack([x + self._origin[0], y + self._origin[1], np.full_like(x, top)], axis=-1).reshape(-1, 3)
        fraction, _ = _cast_rays(client, body, start, start * (1, 1, 0) + (0, 0, bottom))
        heights = np.nan_to_num(top + fraction * (bottom - top)).reshape(x.shape)
        # Parts thinner than the distance of the samples must not fall between them.
        self._heights = maximum_filter(heights, size=3)

    def at(self, xy: FloatArray) -> FloatArray:
        """Heights (...) of the cells nearest to points (..., 2)."""
        cell = np.rint((xy - self._origin) / _CELL).astype(np.intp)
        cell = np.clip(cell, 0, np.array(self._heights.shape) - 1)
        return self._heights[cell[..., 0], cell[..., 1]]


def _cast_rays(client: Any, body: int, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where rays (m, 3) to (m, 3) hit `body`: the fraction (m,) of their way, NaN for none, and the normals (m, 3)."""
    fraction, normal = np.full(len(start), np.nan), np.zeros((len(start), 3))
    for begin in range(0, len(start), _RAYS_AT_ONCE):
        some = slice(begin, begin + _RAYS_AT_ONCE)
        hits = client.rayTestBatch(start[some].tolist(), end[some].tolist(), numThreads=1)
        fraction[some] = [hit[2] if hit[0] == body else np.nan for hit in hits]
        normal[some] = [hit[4] for hit in hits]
    return fraction, normal


@dataclass(frozen=True)
class _Room:
    """Where the open fingers fit; distances of their inner faces from the point."""

    exists: npt.NDArray[np.bool_]  # (n,) both fingers find free space, and the palm as well
    first: FloatArray  # (n,) smallest distance at which both fit
    last: FloatArray  # (n,) largest distance up to which both fit all the way


def _free_space(heights: _HeightMap, candidates: _Candidates, rule: AntipodalRule, gripper: GripperSpec) -> _Room:
    """The first free space outwards from the point, on both sides: a handle is gripped by itself, not with its mug."""
    highest = _profile(heights, candidates, gripper.max_opening / 2 + gripper.finger_thickness, gripper.finger_width)
    occupied = highest > candidates.tip[:, None] + 0.001
    middle = highest.shape[1] // 2
    sides = np.stack([occupied[:, middle:], occupied[:, middle::-1]], axis=1)  # (n, 2, outwards)
    first, last = _first_run(~sides, round((gripper.finger_thickness + rule.least_margin) / _CELL))
    nearest, farthest = first.max(axis=1) * _CELL, last.min(axis=1) * _CELL - gripper.finger_thickness
    exists = (first > 0).all(axis=1) & (nearest <= farthest)
    below_palm = _profile(heights, rows_of(candidates, exists), gripper.palm[0] / 2, gripper.palm[1]).max(axis=1)
    palm = np.maximum(candidates.point[exists, 2], gripper.finger_length) + rule.palm_play
    exists[exists] = below_palm <= palm
    return _Room(exists, nearest, np.minimum(farthest, gripper.max_opening / 2))


def _profile(heights: _HeightMap, candidates: _Candidates, reach: float, width: float) -> FloatArray:
    """Heights (n, steps) along the closing direction, from -reach to reach, each the highest within `width` across."""
    steps = np.arange(-round(reach / _CELL), round(reach / _CELL) + 1) * _CELL
    highest = np.zeros((len(candidates.angle), len(steps)))
    line = candidates.point[:, None, :2] + candidates.closing[:, None] * steps[:, None]
    for across in np.linspace(-0.5, 0.5, max(5, round(width / _ACROSS) + 1)) * width:
        np.maximum(highest, heights.at(line + candidates.jaw[:, None] * across), out=highest)
    return highest


def _first_run(free: npt.NDArray[np.bool_], length: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """First and last index of the first run of at least `length` true values along the last axis; 0 for none."""
    if length > free.shape[-1]:
        none = np.zeros(free.shape[:-1], np.intp)
        return none, none
    padded = np.concatenate([np.zeros((*free.shape[:-1], 1), np.intp), np.cumsum(free, axis=-1)], axis=-1)
    runs = padded[..., length:] - padded[..., :-length] == length
    begin = runs.argmax(axis=-1)
    after = np.arange(free.shape[-1]) >= begin[..., None]
    blocked = after & ~free
    end = np.where(blocked.any(axis=-1), blocked.argmax(axis=-1), free.shape[-1]) - 1
    exists = runs.any(axis=-1)
    return np.where(exists, begin, 0), np.where(exists, end, 0)


@dataclass(frozen=True)
class _Contacts:
    """Where closing fingers touch; (n, 2) each, one column a side."""

    distance: FloatArray  # from the point, along the closing direction; negative beyond it
    alignment: FloatArray  # mean cosine with the normals; 0 without contact
    size: FloatArray  # share of the finger's rays; 0 where they lie above each other
    across: FloatArray  # mean place on the finger along the jaw


def _touch(
    client: Any, body: int, candidates: _Candidates, room: _Room, rule: AntipodalRule, gripper: GripperSpec
) -> _Contacts:
    sides = [_touch_one_side(client, body, candidates, side, room.first, rule, gripper) for side in (1, -1)]
    return _Contacts(*(np.stack(values, axis=1) for values in zip(*sides, strict=True)))


def _touch_one_side(
    client: Any,
    body: int,
    candidates: _Candidates,
    side: int,
    first: FloatArray,
    rule: AntipodalRule,
    gripper: GripperSpec,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """One column of each field of `_Contacts`; rays run inwards from `first` to a little beyond the point."""
    across, up = np.meshgrid(_RAYS_ACROSS * gripper.finger_width / 2, _RAY_HEIGHTS * gripper.finger_length)
    shape = (len(first), *across.shape)
    outwards = side * candidates.closing
    start = np.empty((*shape, 3))
    start[..., :2] = candidates.point[:, None, None, :2] + candidates.jaw[:, None, None] * across[..., None]
    start[..., 2] = candidates.tip[:, None, None] + up
    end = start.copy()
    start[..., :2] += (outwards * first[:, None])[:, None, None]
    end[..., :2] -= (outwards * rule.centring)[:, None, None]
    fraction, normal = _cast_rays(client, body, start.reshape(-1, 3), end.reshape(-1, 3))
    travel = fraction.reshape(shape) * (first + rule.centring)[:, None, None]
    distance = np.where(np.isnan(travel), -np.inf, first[:, None, None] - travel)
    contact = distance.max(axis=(1, 2))
    touched = (distance >= contact[:, None, None] - rule.contact_depth) & np.isfinite(distance)
    count = np.maximum(touched.sum(axis=(1, 2)), 1)
    cosine = (normal.reshape(*shape, 3)[..., :2] * outwards[:, None, None]).sum(axis=-1)
    beside = touched.any(axis=1).sum(axis=1) >= 2
    return (
        np.maximum(contact, -rule.centring),  # nothing touched
        (cosine * touched).sum(axis=(1, 2)) / count,
        touched.mean(axis=(1, 2)) * beside,
        (across * touched).sum(axis=(1, 2)) / count,
    )
