"""Compact training objects: blobs, bricks, stacks, plates and turned solids. Any unit, z up."""

from __future__ import annotations

import numpy as np

from ggcnn_net2net.simulation.convex import (
    Part,
    box,
    cylinder,
    disc,
    ellipsoid,
    hull,
    lathe,
    level,
    prism,
    rectangle,
    rotate,
    scale,
    translate,
)
from ggcnn_net2net.simulation.training_objects.draws import between, chance, one_of, outline, wall


def blob(rng: np.random.Generator) -> list[Part]:
    """One superellipsoid, or two to four ellipsoids each centred inside the one before: fruit, stones, soft toys."""
    if chance(rng, 0.4):
        return [ellipsoid([between(rng, 0.35, 1) for _ in range(3)], exponent=between(rng, 1.7, 6))]
    parts, centre = [], np.zeros(3)
    for _ in range(rng.integers(2, 5)):
        radii = rng.uniform(0.4, 1, 3)
        parts.append(ellipsoid(radii, centre))
        direction = rng.normal(size=3) * (1, 1, 0.5)
        centre = centre + rng.uniform(0.6, 0.9) * radii * direction / np.linalg.norm(direction)
    return parts


def brick(rng: np.random.Generator) -> list[Part]:
    """A box, a wedge or a frustum; some with a lid, a grip or a foot: packets, soaps, doorstops, cases."""
    x, y, z = 1.0, between(rng, 0.25, 1), between(rng, 0.15, 0.8)
    corner = rng.choice([0.0, rng.uniform(0.05, 0.3)]) * y
    top = np.ones(2) if chance(rng, 0.5) else rng.uniform((0.2, 0.6), (1, 1))
    parts = [hull(level(rectangle(x, y, corner)), level(rectangle(x, y, corner) * top, z))]
    if chance(rng, 0.3):  # lid, a little wider than the body's upper end
        lid = rectangle(x, y, corner) * top * rng.uniform(1.04, 1.2)
        parts.append(prism(lid, rng.uniform(0.08, 0.15), (0, 0, 0.97 * z)))
    elif chance(rng, 0.4):
        size = rng.uniform(0.2, 0.6, 2) * top * (x, y)
        parts.append(box((*size, rng.uniform(0.1, 0.4)), (*rng.uniform(-0.1, 0.1, 2), z)))
    return parts


def stack(rng: np.random.Generator) -> list[Part]:
    """Two to four prisms on top of each other, off centre: blocks, machines, adapters, plugs."""
    parts, z, length, width = [], 0.0, 1.0, between(rng, 0.4, 1)
    for _ in range(rng.integers(2, 5)):
        height = between(rng, 0.12, 0.6)
        shift = rng.uniform(-0.2, 0.2, 2) * (length, width) * (z > 0)
        parts.append(prism(outline(rng, length, width), height, (*shift, z)))
        z += 0.97 * height
        length, width = rng.uniform(0.4, 1.0, 2) * (length, width)
    return parts


def plate(rng: np.random.Generator) -> list[Part]:
    """Something flat: plain, with keys, with a rim, of two layers, or bent: phones, tiles, coins, trays, brackets."""
    width, thickness = between(rng, 0.35, 0.85), between(rng, 0.03, 0.11)
    base = prism(outline(rng, 1.0, width), thickness)
    if chance(rng, 0.2):
        return [base]
    return [base, *one_of(rng, _keys, _rim, _layer, _wing)(rng, base, thickness)]


def _keys(rng: np.random.Generator, base: Part, thickness: float) -> list[Part]:
    """Keys in a grid around the middle."""
    pitch = rng.uniform(0.15, 0.25, 2) * np.ptp(base[:, :2], axis=0)
    columns, rows = rng.integers((2, 1), (5, 4))
    places = [(i - (columns - 1) / 2, j - (rows - 1) / 2) for i in range(columns) for j in range(rows)]
    height = thickness * rng.uniform(0.8, 1.6)
    return [box((*(0.6 * pitch), height), (*(pitch * place), thickness)) for place in places]


def _rim(rng: np.random.Generator, base: Part, thickness: float) -> list[Part]:
    return wall(base[: len(base) // 2, :2], rng.uniform(0.04, 0.1), rng.uniform(1.5, 3) * thickness)


def _layer(rng: np.random.Generator, base: Part, thickness: float) -> list[Part]:
    """A smaller plate of the same outline on top."""
    factor = (*rng.uniform(0.5, 0.95, 2), rng.uniform(0.5, 2))
    return [translate(scale(base, factor), (0, 0, 0.97 * thickness))]


def _wing(rng: np.random.Generator, base: Part, thickness: float) -> list[Part]:
    """A second plate at an angle, from near the end of the first."""
    length, width = rng.uniform(0.3, 0.8), rng.uniform(0.4, 0.8) * np.ptp(base[:, 1])
    wing = rotate(box((length, width, thickness), (length / 2 - thickness / 2, 0, 0)), "y", -rng.uniform(30, 100))
    return [translate(wing, (base[:, 0].max() - 1.5 * thickness, 0, thickness / 2))]


def turned(rng: np.random.Generator) -> list[Part]:
    """A solid of revolution: bottle, spindle, knob, bobbin, cone or can; some are squashed to an oval."""
    segments, height = int(rng.integers(6, 17)), between(rng, 1.0, 4.5)
    neck, middle = rng.uniform(0.3, 0.7), rng.uniform(0.35, 0.7)
    profiles = {
        "bottle": [(0.9, 0), (1, 0.04), (1, middle), (neck, middle + 0.15), (neck, 0.95), (neck * 0.9, 1)],
        "spindle": [(neck, 0), (1, middle / 2), (neck, middle), (rng.uniform(0.5, 1), (middle + 1) / 2), (0.3, 1)],
        "knob": [(0.6, 0), (neck, 0.15), (neck, middle), (1, middle + 0.1), (0.9, 0.95), (0.5, 1)],
        "bobbin": [(1, 0), (1, 0.2), (neck, 0.25), (neck, 0.75), (1, 0.8), (1, 1)],
        "cone": [(1, 0), (1, 0.1), (rng.uniform(0.1, 0.7), 1)],
        "can": [(0.92, 0), (1, 0.05), (1, 0.95), (0.92, 1)],
    }
    profile = profiles[str(rng.choice(list(profiles)))]
    parts = lathe([(radius, z * height) for radius, z in profile], segments)
    return scale(parts, (1, rng.uniform(0.5, 0.9) if chance(rng, 0.25) else 1, 1))


def assembly(rng: np.random.Generator) -> list[Part]:
    """A box or drum as body with two to five things attached to its sides: toys, gadgets, taps, machines."""
    size = np.array([1.0, between(rng, 0.4, 1), between(rng, 0.3, 0.8)])
    body = box(size) if chance(rng, 0.6) else scale(ellipsoid((0.5, 0.5, 0.5), exponent=between(rng, 2, 5)), size)
    return [body, *(_attachment(rng, size) for _ in range(rng.integers(2, 6)))]


def _attachment(rng: np.random.Generator, size: Part) -> Part:
    """A peg, a block or a wheel that begins inside a body of a size and looks out of a random side of it."""
    reach, thick = rng.uniform(0.3, 0.7), rng.uniform(0.08, 0.2)
    shapes = [
        hull(disc(thick), disc(thick * rng.uniform(0.5, 1.2), (0, 0, reach))),
        box((2 * thick, thick * rng.uniform(1, 3), reach), (0, 0, reach / 2)),
        cylinder(2 * thick, 0.7 * reach),
    ]
    part = rotate(rotate(one_of(rng, *shapes), "y", one_of(rng, 0, 90, 180, 270)), "z", one_of(rng, 0, 90))
    outwards = part.mean(axis=0) / np.abs(part.mean(axis=0)).max()
    sideways = rng.uniform(-0.25, 0.25, 3) * size * (np.abs(outwards) < 0.5)
    return part + sideways + 0.25 * size * np.round(outwards)
