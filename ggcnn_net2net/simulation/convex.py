"""Solids out of convex parts, and the OBJ files in which the simulation reads them.

A part is an array (n, 3) of points; its convex hull is the solid. An object is a list of parts. pybullet
makes one convex hull of each `o` group of an OBJ file: what `write_obj` writes collides exactly as it looks.

Frames: x and y horizontal, z up, right-handed. Solids with an axis stand on the origin along z, a box and an
ellipsoid have the origin in their centre; `at` moves that origin. Lengths are in metres, or in any one unit
that `scale` turns into metres later. Angles are in degrees, counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ObjectSetError

Part = npt.NDArray[np.float64]
Shape = TypeVar("Shape", npt.NDArray[np.float64], list[npt.NDArray[np.float64]])
Axis = Literal["x", "y", "z"]

ORIGIN = (0.0, 0.0, 0.0)


# Outlines: polygons (n, 2), counter-clockwise in the x-y plane.


def circle(radius: float, segments: int = 16) -> Part:
    """Regular polygon with corners at `radius`, the first of them on +x."""
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def rectangle(width: float, depth: float, corner: float = 0.0) -> Part:
    """Rectangle around the origin, `width` along x and `depth` along y, its corners cut off by `corner`."""
    x, y = width / 2, depth / 2
    if not corner:
        return np.array([(x, -y), (x, y), (-x, y), (-x, -y)])
    a, b = x - corner, y - corner
    return np.array([(x, -b), (x, b), (a, y), (-a, y), (-x, b), (-x, -b), (-a, -y), (a, -y)])


def level(outline: npt.ArrayLike, z: float = 0.0) -> Part:
    """An outline as flat points at height z: a section for `hull`, `chain` and `shell`."""
    points = np.asarray(outline, dtype=np.float64)
    return np.column_stack([points, np.full(len(points), z)])


def disc(radius: float, at: npt.ArrayLike = ORIGIN, segments: int = 16) -> Part:
    """A horizontal circle as a flat section around `at`; only that point for radius 0."""
    return level(circle(radius, segments if radius else 1)) + np.asarray(at)


# Single parts.


def box(size: npt.ArrayLike, at: npt.ArrayLike = ORIGIN) -> Part:
    """Box of `size` (x, y, z) around `at`."""
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return signs * np.asarray(size, dtype=np.float64) / 2 + np.asarray(at)


def prism(outline: npt.ArrayLike, height: float, at: npt.ArrayLike = ORIGIN) -> Part:
    """A convex outline, extruded upwards."""
    return hull(level(outline), level(outline, height)) + np.asarray(at)


def cylinder(radius: float, height: float, at: npt.ArrayLike = ORIGIN, segments: int = 16) -> Part:
    """Upright cylinder; a prism with corners at `radius`, so that it can come to rest on its side."""
    return prism(circle(radius, segments), height, at)


def frustum(
    bottom_radius: float,
    top_radius: float,
    height: float,
    at: npt.ArrayLike = ORIGIN,
    segments: int = 16,
) -> Part:
    """Upright frustum; a cone where one of the radii is 0."""
    bottom = disc(bottom_radius, segments=segments)
    return hull(bottom, disc(top_radius, (0, 0, height), segments)) + np.asarray(at)


def ellipsoid(
    radii: npt.ArrayLike,
    at: npt.ArrayLike = ORIGIN,
    exponent: float = 2.0,
    segments: int = 12,
    rings: int = 5,
) -> Part:
    """Superellipsoid |x/a|^e + |y/b|^e + |z/c|^e = 1 around `at`: the hull of points on its surface.

    Args:
        radii: semi-axes a, b, c; exact where `segments` is a multiple of 4 and `rings` is odd.
        at: centre.
        exponent: 2 for an ellipsoid, more for a box with round edges.
        segments: points around z.
        rings: circles of points between the poles.
    """
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, rings + 2)[1:-1]
    around = [level(circle(np.cos(latitude), segments), np.sin(latitude)) for latitude in latitudes]
    directions = np.concatenate([*around, [(0, 0, -1), (0, 0, 1)]])
    norms = (np.abs(directions) ** exponent).sum(axis=1, keepdims=True) ** (1 / exponent)
    return directions / norms * np.asarray(radii, dtype=np.float64) + np.asarray(at)


def rod(
    start: npt.ArrayLike,
    end: npt.ArrayLike,
    radius: float,
    end_radius: float | None = None,
    segments: int = 8,
) -> Part:
    """Round bar between two points; with `end_radius` it tapers."""
    radii = (radius, radius if end_radius is None else end_radius)
    return sweep([start, end], radii, segments)[0]


# Parts out of other parts.


def hull(*parts: Part) -> Part:
    """One convex part around all the given points, parts or sections."""
    return np.concatenate(parts)


def chain(sections: Iterable[Part]) -> list[Part]:
    """Hulls of successive sections: a body along a curve."""
    return [hull(*pair) for pair in pairwise(sections)]


def lathe(profile: Iterable[tuple[float, float]], segments: int = 16) -> list[Part]:
    """Solid of revolution around z: a frustum between each two successive points (radius, z)."""
    return chain(disc(radius, (0, 0, z), segments) for radius, z in profile)


def sweep(points: Sequence[npt.ArrayLike], radius: float | Sequence[float], segments: int = 8) -> list[Part]:
    """Round bar along a line of points; its radius is constant or given for every point."""
    line = np.asarray(points, dtype=np.float64)
    steps = np.diff(line, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    tangents = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    radii = np.broadcast_to(radius, len(line))
    return chain(
        point + circle(size, segments) @ _perpendicular(tangent)
        for point, tangent, size in zip(line, tangents, radii, strict=True)
    )


def arc(radius: float, thickness: float, start: float, stop: float, *, segments: int = 6, sides: int = 6) -> list[Part]:
    """Round bar along an arc around the origin in the x-y plane, such as a handle or a ring.

    Args:
        radius: of the bar's centre line.
        thickness: diameter of the bar.
        start: angle from +x in degrees.
        stop: angle of the other end.
        segments: number of parts.
        sides: corners of the bar's cross section.
    """
    angles = np.radians(np.linspace(start, stop, segments + 1))
    line = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(segments + 1)])
    return sweep(list(line), thickness / 2, sides)


def shell(outer: Sequence[Part], inner: Sequence[Part]) -> list[Part]:
    """Wall between two stacks of closed loops: one part for each side of the loops and each storey.

    Args:
        outer: loops (n, 3) of points, from below to above.
        inner: as many loops with as many points, each beside its outer one.
    """
    loops = [np.stack(pair, axis=1) for pair in zip(outer, inner, strict=True)]  # (n, 2, 3)
    storeys = [np.concatenate(pair, axis=1) for pair in pairwise(loops)]  # (n, 4, 3)
    return [hull(storey[side - 1], storey[side]) for storey in storeys for side in range(len(storey))]


def tube(profile: Sequence[tuple[float, float]], wall: float, segments: int = 12, floor: float = 0.0) -> list[Part]:
    """Hollow solid of revolution around z, open at the top: cups, bowls, bins; without a floor a pipe.

    Args:
        profile: (radius, z) of the outer surface, z increasing; the radii are those of the corners.
        wall: thickness at the corners, perpendicular to the profile; the middle of a side is thinner by the
            factor cos(180° / segments).
        segments: sides of the wall.
        floor: thickness of the floor; none for 0.
    """
    outline = np.asarray(profile, dtype=np.float64)
    inside = _offset(outline, wall)
    loops = [[disc(max(radius, 0), (0, 0, z), segments) for radius, z in line] for line in (outline, inside)]
    if not floor:
        return shell(*loops)
    heights = outline[0, 1] + (0, floor)
    radii = np.interp(heights, outline[:, 1], outline[:, 0])
    return [*shell(*loops), *lathe(zip(radii, heights, strict=True), segments)]


def _offset(line: Part, distance: float) -> Part:
    """Points (n, 2) of a line in a plane, moved to its left by a distance, with mitred corners."""
    steps = np.diff(line, axis=0)
    normals = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1, keepdims=True)
    before, after = np.concatenate([normals[:1], normals]), np.concatenate([normals, normals[-1:]])
    mitres = (before + after) / (1 + (before * after).sum(axis=1, keepdims=True))
    return line + distance * mitres


def _perpendicular(direction: Part) -> Part:
    """Two unit vectors (2, 3) that complete a direction to a right-handed frame."""
    # Rounded, so that noise in the last digit never decides between two equally good axes.
    helper = np.eye(3)[np.argmin(np.round(np.abs(direction), 6))]
    first = np.cross(helper, direction)
    frame = np.stack([first, np.cross(direction, first)])
    return frame / np.linalg.norm(frame, axis=1, keepdims=True)


# Transforms, of one part or of a list of parts.


def translate(shape: Shape, offset: npt.ArrayLike) -> Shape:
    """Move by `offset` (x, y, z)."""
    if isinstance(shape, list):
        return [translate(part, offset) for part in shape]
    return shape + np.asarray(offset)


def rotate(shape: Shape, axis: Axis, degrees: float) -> Shape:
    """Turn around a coordinate axis through the origin, counter-clockwise seen from its positive end."""
    if isinstance(shape, list):
        return [rotate(part, axis, degrees) for part in shape]
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turned = shape.copy()
    turned[:, first] = cos * shape[:, first] - sin * shape[:, second]
    turned[:, second] = sin * shape[:, first] + cos * shape[:, second]
    return turned


def scale(shape: Shape, factor: npt.ArrayLike) -> Shape:
    """Multiply by one factor, or by one for each axis; a negative factor mirrors."""
    if isinstance(shape, list):
        return [scale(part, factor) for part in shape]
    return shape * np.asarray(factor)


# OBJ files.


def obj_text(parts: Sequence[Part]) -> str:
    """An object as the text of an OBJ file: one `o` group of outward triangles a part, the same in every run.

    Raises:
        ObjectSetError: a part without volume.
    """
    lines: list[str] = []
    count = 0
    for number, part in enumerate(parts):
        vertices, triangles = _hull_mesh(part, number)
        lines.append(f"o part_{number:02d}")
        lines += ["v {:.6f} {:.6f} {:.6f}".format(*vertex) for vertex in vertices]
        lines += ["f {} {} {}".format(*triangle) for triangle in triangles + count + 1]
        count += len(vertices)
    return "\n".join(lines) + "\n"


def write_obj(path: Path, parts: Sequence[Part]) -> None:
    """Write an object as an OBJ file.

    Raises:
        ObjectSetError: a part without volume.
    """
    write_text(path, obj_text(parts))


def _hull_mesh(part: Part, number: int) -> tuple[Part, npt.NDArray[np.intp]]:
    """Corners of a part's hull, rounded to the digits of the file, and sorted triangles of their indices."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and only needed here

    points = np.round(part, 6) + 0.0  # + 0.0 turns -0.0 into 0.0
    try:
        shape = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise ObjectSetError(f"expected part {number} to have a volume, received {points.tolist()}") from error
    corners = np.sort(shape.vertices)
    triangles = shape.simplices
    normals = np.cross(*np.moveaxis(np.diff(points[triangles], axis=1), 1, 0))
    inward = (normals * shape.equations[:, :3]).sum(axis=1) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    triangles = np.searchsorted(corners, triangles)
    triangles = np.array([np.roll(triangle, -triangle.argmin()) for triangle in triangles])
    return points[corners], triangles[np.lexsort(triangles.T[::-1])]
