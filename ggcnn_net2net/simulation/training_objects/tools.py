"""Training objects with a handle: tools with a head across it, and paddles with a broad body. Any unit, along x."""

from __future__ import annotations

import numpy as np

from ggcnn_net2net.simulation.convex import (
    Part,
    box,
    chain,
    circle,
    ellipsoid,
    hull,
    level,
    prism,
    rod,
    rotate,
    scale,
    translate,
    tube,
)
from ggcnn_net2net.simulation.training_objects.draws import between, chance, one_of, outline, wall


def handle(rng: np.random.Generator, length: float, thick: float) -> list[Part]:
    """A handle from the origin to x = -`length`: straight, waisted or swelling, some with an eye at its end."""
    section = outline(rng, thick * between(rng, 0.5, 1), thick, segments=8)
    stations = [(1, 0), (rng.uniform(0.7, 1), 0.4 * length), (rng.uniform(0.9, 1.3), length)]
    parts = rotate(chain(level(section * factor, z) for factor, z in stations), "y", -90)
    if chance(rng, 0.25):
        eye = wall(circle(thick, 8), 0.5 * thick, 0.6 * thick, -0.3 * thick)
        parts += translate(eye, (-length - 0.75 * thick, 0, 0))
    return parts


def tool(rng: np.random.Generator) -> list[Part]:
    """A handle with a head: T, L, hammer, axe, wrench, rake, screwdriver."""
    thick = between(rng, 0.06, 0.16)
    head = one_of(rng, _bar, _hammer, _axe, _wrench, _rake, _driver)
    return [*handle(rng, rng.choice([0.7, 1.0]), thick), *head(rng, thick, between(rng, 0.2, 0.5))]


def _bar(rng: np.random.Generator, thick: float, size: float) -> list[Part]:
    """A bar across the handle's end: T, or L where it stands out to one side."""
    width, height = thick * rng.uniform((0.8, 0.6), (2, 1.2))
    return [box((width, size, height), (0, rng.choice([0, 0.4]) * size, 0))]


def _hammer(rng: np.random.Generator, thick: float, size: float) -> list[Part]:
    face, peen = rng.uniform(0.3, 0.6, 2) * size
    barrel = rod((0, -face, 0), (0, peen, 0), thick * rng.uniform(0.6, 1.2), segments=10)
    if chance(rng, 0.4):
        return [barrel]
    edge = box((thick, 0.03, 0.3 * thick), (0, peen + 0.3 * size, 0))
    return [barrel, hull(box((thick, 0.02, thick), (0, peen - 0.02, 0)), edge)]


def _axe(rng: np.random.Generator, thick: float, size: float) -> list[Part]:
    flare = rng.uniform(0.08, 0.18)
    blade = [(-0.06, -0.06), (0.08, -0.06), (flare, size), (-flare, size)]
    return [prism(blade, 0.5 * thick, (0, 0, -0.25 * thick)), box((0.14, 0.16, thick))]


def _wrench(rng: np.random.Generator, thick: float, size: float) -> list[Part]:
    """Two jaws of different length."""
    jaw = [(-0.02, 0), (0.1, 0), (0.1 + 0.35 * size, 0.12 * size), (0.1 + 0.35 * size, 0.3 * size), (0.1, 0.35 * size)]
    jaws = prism(jaw, 0.7 * thick, (0, 0, -0.35 * thick))
    other = scale(jaws, (rng.uniform(0.8, 1.4), -1, 1))
    return [jaws, other, box((0.12, 0.4 * size, 0.7 * thick), (0.05, 0, 0))]


def _rake(rng: np.random.Generator, thick: float, size: float) -> list[Part]:
    """A bar with two to six prongs along the handle: rakes, forks, combs."""
    bar = max(0.06, 0.7 * thick)
    reach = between(rng, 0.3, 1.2) * size
    places = np.linspace(-size / 2, size / 2, rng.integers(2, 7))
    prongs = [box((reach, 0.05, 0.05), (reach / 2, y, 0)) for y in places]
    return [box((bar, size + 0.05, bar)), *prongs]


def _driver(rng: np.random.Generator, thick: float, size: float) -> list[Part]:
    """A thinner shaft with a flat tip."""
    length = size + rng.uniform(0, 0.4)
    tip = hull(
        box((0.01, 0.6 * thick, 0.6 * thick), (length, 0, 0)), box((0.01, thick, 0.4 * thick), (length + 0.1, 0, 0))
    )
    return [rod((-0.02, 0, 0), (length + 0.02, 0, 0), 0.35 * thick), tip]


def paddle(rng: np.random.Generator) -> list[Part]:
    """A body that is broader than its handle: pans, rackets, spoons, spatulas, brushes, magnifiers."""
    thick, radius = between(rng, 0.07, 0.14), between(rng, 0.15, 0.4)
    body = one_of(rng, _pan, _racket, _spoon, _blade, _brush)(rng, thick, radius)
    grip = translate(handle(rng, rng.uniform(0.5, 1), thick), (-0.88 * radius, 0, 0))
    return [*scale(body, (1, rng.uniform(0.6, 1.1), 1)), *grip]


def _pan(rng: np.random.Generator, thick: float, radius: float) -> list[Part]:
    height = radius * rng.uniform(0.25, 0.8)
    profile = [(radius * rng.uniform(0.7, 1), 0), (radius, height)]
    return translate(tube(profile, 0.15 * radius + 0.015, 12, 0.05), (0, 0, thick / 2 - height))


def _racket(rng: np.random.Generator, thick: float, radius: float) -> list[Part]:
    height = thick * rng.uniform(0.5, 0.9)
    hoop = wall(circle(radius, 12), rng.uniform(0.15, 0.3) * radius, height, -height / 2)
    return [*hoop, box((1.9 * radius, 0.05, 0.05))] if chance(rng, 0.5) else hoop


def _spoon(rng: np.random.Generator, thick: float, radius: float) -> list[Part]:
    return [ellipsoid((radius, 0.8 * radius, max(thick / 2, radius * rng.uniform(0.15, 0.5))))]


def _blade(rng: np.random.Generator, thick: float, radius: float) -> list[Part]:
    return [prism(outline(rng, 2 * radius, 2 * radius), rng.uniform(0.3, 0.6) * thick, (0, 0, -0.2 * thick))]


def _brush(rng: np.random.Generator, thick: float, radius: float) -> list[Part]:
    back = outline(rng, 2 * radius, 2 * radius)
    bristles = prism(back * rng.uniform(0.75, 0.95), between(rng, 0.1, 0.3), (0, 0, -thick / 2))
    return [prism(back, thick, (0, 0, -thick / 2)), scale(bristles, (1, 1, -1))]
