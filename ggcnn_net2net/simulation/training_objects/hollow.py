"""Hollow training objects: pipes, cups, bowls, bins, rings and frames. Any unit, z up."""

from __future__ import annotations

import numpy as np

from ggcnn_net2net.simulation.convex import (
    Part,
    arc,
    box,
    prism,
    rectangle,
    rod,
    rotate,
    scale,
    sweep,
    translate,
    tube,
)
from ggcnn_net2net.simulation.training_objects.draws import between, chance, outline, wall


def pipe(rng: np.random.Generator) -> list[Part]:
    """An open tube, round or angular, straight or of two diameters: sleeves, nuts, rolls of tape, funnels."""
    height = between(rng, 0.3, 4)
    thickness, segments = between(rng, 0.15, 0.45), int(rng.choice([4, 6, 8, 12]))
    profile = [(1.0, 0.0), (1.0, height)]
    if chance(rng, 0.3):
        profile = [(1.0, 0.0), (rng.uniform(0.7, 1), 0.5 * height), (rng.uniform(0.7, 1.3), height)]
    return tube(profile, thickness * 0.7, segments)


def cup(rng: np.random.Generator) -> list[Part]:
    """A round vessel: cups, mugs, bowls, pots, vases, with no, one or two handles."""
    height, foot = between(rng, 0.35, 2.5), rng.uniform(0.5, 1)
    thickness = between(rng, 0.08, 0.2)
    profile = [(foot, 0), (1, height)]
    if chance(rng, 0.4):
        belly = (rng.uniform(0.9, 1.15), rng.uniform(0.3, 0.6) * height)
        profile = [(foot, 0), belly, (rng.uniform(0.75, 1.1), height)]
    body = tube(profile, thickness, 12 if len(profile) == 2 else 9, floor=1.2 * thickness)
    handles = int(rng.choice([0, 1, 2], p=[0.45, 0.4, 0.15]))
    radius = np.interp(height / 2, [z for _, z in profile], [radius for radius, _ in profile])
    ear = _ear(height, 0.93 * radius - thickness / 2)  # the sides of a polygon lie within its radius
    parts = [*body, *(part for sign in (1, -1)[:handles] for part in scale(ear, (sign, 1, 1)))]
    return scale(parts, (1, rng.uniform(0.6, 0.9) if chance(rng, 0.3) else 1, 1))


def _ear(height: float, reach: float) -> list[Part]:
    """The handle of a vessel whose wall is at x = `reach`: upright, or level where the vessel is low."""
    bow = arc(1, 0.5, -90, 90, segments=4)
    upright = height > 0.8
    bow = scale(rotate(bow, "x", 90) if upright else bow, 0.3 * height if upright else 0.3)
    return translate(bow, (reach, 0, height / 2))


def bin_or_tray(rng: np.random.Generator) -> list[Part]:
    """An angular vessel: boxes, trays, baskets, some with a partition or a bow handle."""
    width, height = between(rng, 0.4, 1), between(rng, 0.12, 1.2)
    thickness = between(rng, 0.04, 0.1)
    loop = rectangle(1, width, rng.choice([0, 0.15]) * width)
    parts = [*wall(loop, thickness, height), prism(loop, thickness)]
    if chance(rng, 0.3):
        parts.append(box((thickness, 0.98 * width, 0.9 * height), (rng.uniform(-0.2, 0.2), 0, 0.45 * height)))
    elif chance(rng, 0.3):
        bow = [(0, -0.48 * width, height), (0, -0.4 * width, height + 0.35), (0, 0.4 * width, height + 0.35)]
        parts += sweep([*bow, (0, 0.48 * width, height)], 0.05, 6)
    return parts


def ring(rng: np.random.Generator) -> list[Part]:
    """A closed ring, round, oval or angular; some with a stem: bangles, gaskets, frames; or a padlock."""
    kind = rng.choice(["torus", "flat", "lock"], p=[0.4, 0.4, 0.2])
    if kind == "lock":
        return _padlock(rng)
    if kind == "torus":
        parts = scale(arc(0.5, between(rng, 0.1, 0.35), 0, 360, segments=12), (1, between(rng, 0.5, 1), 1))
    else:
        height = between(rng, 0.05, 0.3)
        parts = wall(outline(rng, 1, between(rng, 0.5, 1)), rng.uniform(0.08, 0.22), height, -height / 2)
    if chance(rng, 0.25):
        edge, length, thick = max(part[:, 0].max() for part in parts), between(rng, 0.2, 0.6), rng.uniform(0.1, 0.2)
        parts.append(box((length, thick, thick), (edge + length / 2 - 0.05, 0, 0)))
    return parts


def _padlock(rng: np.random.Generator) -> list[Part]:
    """A block with a shackle."""
    depth, thick, stem = rng.uniform(0.2, 0.5), rng.uniform(0.1, 0.2), rng.uniform(0.1, 0.5)
    radius = 0.5 - thick / 2
    legs = [rod((x, 0.01, 0), (x, -stem, 0), thick / 2, segments=6) for x in (-radius, radius)]
    size = rng.uniform(0.5, 1.1)
    face = rectangle(1.25, size, rng.uniform(0.02, 0.25) * size)
    block = prism(face, depth, (0, -size / 2 - stem + 0.1, -depth / 2))
    return [*arc(radius, thick, 0, 180), *legs, block]
