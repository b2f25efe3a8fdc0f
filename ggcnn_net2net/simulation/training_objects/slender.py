"""Long, thin and branched training objects: rods, crosses, scissors, hooks. Any unit, most of them flat in x-y."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.simulation.convex import (
    Part,
    box,
    circle,
    cylinder,
    ellipsoid,
    hull,
    level,
    prism,
    rectangle,
    rod,
    rotate,
    scale,
    sweep,
    translate,
)
from ggcnn_net2net.simulation.training_objects.draws import between, chance, one_of, wall


def bar(rng: np.random.Generator) -> list[Part]:
    """A long bar along x with one to three sections of different thickness: pencils, markers, chisels, sticks."""
    radius = between(rng, 0.03, 0.09)
    section = circle(radius, int(rng.choice([4, 6, 8, 12])))
    if chance(rng, 0.3):  # flat
        section = rectangle(2 * radius * between(rng, 0.5, 0.8), 2 * radius)
    factors = rng.uniform(0.6, 1.4, rng.integers(1, 4))
    cuts = [0.0, *np.sort(rng.uniform(0.15, 0.85, len(factors) - 1)), 1.0]
    parts = [
        hull(level(section * factor, start), level(section * factor * rng.uniform(0.85, 1), stop))
        for factor, start, stop in zip(factors, cuts[:-1], cuts[1:], strict=True)
    ]
    if chance(rng, 0.5):  # a point or an edge
        tip = section * factors[-1] * rng.uniform(0.3, 0.9, 2)
        parts.append(hull(level(section * factors[-1] * 0.8, 0.99), level(tip, rng.uniform(1.05, 1.3))))
    if chance(rng, 0.3):  # a clip or a switch
        side = factors[0] * section[:, 0].max()
        parts.append(box((radius, 0.6 * radius, 0.25), (side + 0.3 * radius, 0, 0.13)))
    return rotate(parts, "y", 90)


def branching(rng: np.random.Generator) -> list[Part]:
    """Arms from one point or crossed bars: Y, crosses, stars, jacks, scissors, pliers, tongs."""
    return one_of(rng, _star, _jack, _crossed, _crossed, _tongs)(rng, between(rng, 0.07, 0.2))


def _star(rng: np.random.Generator, thick: float) -> list[Part]:
    """Three to six flat arms in a plane around a hub, all alike or of different length and shape."""
    count = int(rng.integers(3, 7))
    lengths = np.full(count, 0.5) if chance(rng, 0.5) else rng.uniform(0.3, 0.7, count)
    ends = thick / 2 * (np.full(count, rng.uniform(0.5, 1.5)) if chance(rng, 0.5) else rng.uniform(0.5, 1.5, count))
    arms = [
        prism([(0, -thick / 2), (length, -end), (length, end), (0, thick / 2)], 0.8 * thick)
        for length, end in zip(lengths, ends, strict=True)
    ]
    return [cylinder(thick, thick), *(rotate(arm, "z", 360 * index / count) for index, arm in enumerate(arms))]


def _jack(rng: np.random.Generator, thick: float) -> list[Part]:
    """Round bars along two or all three axes through one point."""
    axes = np.eye(3)[: rng.integers(2, 4)]
    radii = 0.6 * thick * rng.uniform(0.6, 1, len(axes))
    reach = rng.uniform(0.3, 0.65, len(axes))
    return [
        rod(-0.5 * axis, end * axis, 0.6 * thick, radius) for axis, end, radius in zip(axes, reach, radii, strict=True)
    ]


def _crossed(rng: np.random.Generator, thick: float) -> list[Part]:
    """Two flat bars across each other at a pivot; most end in rings or pads."""
    back, angle, height = rng.uniform(0.3, 0.6), rng.uniform(8, 40), 0.5 * thick
    tip, tail = [(0.6, -0.01), (0.6, 0.04)], [(-back, thick / 3), (-back, -thick / 3)]
    half = [prism([*tip, (0, thick / 2), *tail, (0, -thick / 2)], height)]
    end = rng.choice(["ring", "pad", "none"], p=[0.6, 0.2, 0.2])
    radius = rng.uniform(0.09, 0.16)
    if end == "ring":
        ring = wall(circle(radius, 8) * (1.3, 1), 0.35 * radius, height)
        half += translate(ring, (-back - radius, -0.3 * radius, 0))
    elif end == "pad":
        half.append(prism(rectangle(2 * radius, 1.2 * thick, 0.02), height, (-back - 0.5 * radius, 0, 0)))
    half = rotate(half, "z", angle / 2)
    return [*half, *scale(half, (1, -1, 1)), cylinder(0.6 * thick, 1.2 * height, segments=10)]


def _tongs(rng: np.random.Generator, thick: float) -> list[Part]:
    """Two legs from one joint: tweezers, tongs, clothes pegs, compasses."""
    leg = hull(box((0.02, thick, thick)), box((0.02, 0.6 * thick, 0.7 * thick), (1, 0, 0)))
    leg = rotate(leg, "z", rng.uniform(6, 28))
    return [leg, scale(leg, (1, -1, 1)), cylinder(thick, thick, (0, 0, -thick / 2), 10)]


def bent(rng: np.random.Generator) -> list[Part]:
    """A bar along a curve: arcs, hooks, horseshoes, waves, angles; some flattened, some pointed, some with a knob."""
    thick = between(rng, 0.06, 0.25)
    line = one_of(rng, _angle, _wave, _arc, _hook)(rng)
    ends = rng.uniform(0.4, 1, 2) if chance(rng, 0.6) else np.ones(2)
    station = np.linspace(-1, 1, len(line))
    radii = thick / 2 * (1 - (1 - np.where(station < 0, ends[0], ends[1])) * station**2)
    parts = sweep(list(np.pad(line, ((0, 0), (0, 1)))), list(radii), int(rng.choice([4, 6, 8])))
    parts = scale(parts, (1, 1, between(rng, 0.5, 1.5)))
    return [*parts, ellipsoid([0.8 * thick] * 3, (*line[0], 0), segments=8, rings=3)] if chance(rng, 0.2) else parts


def _angle(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    turn = np.radians(rng.uniform(40, 130))
    return np.array([(0, 0), (0.6, 0), (0.6 + 0.5 * np.cos(turn), 0.5 * np.sin(turn))])


def _wave(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    x = np.linspace(0, 1, 10)
    return np.column_stack([x, rng.uniform(0.1, 0.25) * np.sin(np.pi * rng.uniform(1, 2.2) * x)])


def _arc(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    angles = np.radians(np.linspace(0, rng.uniform(60, 250), 9))
    return 0.4 * np.column_stack([np.cos(angles), np.sin(angles)])


def _hook(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """An arc with a straight stem."""
    curve = _arc(rng)
    return np.concatenate([curve[:1] - (0, rng.uniform(0.3, 1)), curve])
