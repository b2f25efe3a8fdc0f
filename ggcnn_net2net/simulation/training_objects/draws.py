"""Random choices that the families of training objects share."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.simulation.convex import Part, circle, level, rectangle, shell

Outline = npt.NDArray[np.float64]
Choice = TypeVar("Choice")


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform: as many from 1 to 2 as from 2 to 4."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def chance(rng: np.random.Generator, probability: float) -> bool:
    """True with a probability."""
    return bool(rng.random() < probability)


def one_of(rng: np.random.Generator, *choices: Choice) -> Choice:
    """One of several things, all equally likely."""
    return choices[int(rng.integers(len(choices)))]


def outline(rng: np.random.Generator, length: float, width: float, segments: int = 12) -> Outline:
    """A convex polygon around the origin within `length` along x and `width` along y.

    Rectangle, rectangle with cut corners, ellipse of `segments` corners, trapezium, or a polygon of 3 to 6 corners.
    """
    kind = rng.choice(["rectangle", "octagon", "ellipse", "trapezium", "polygon"], p=[0.3, 0.25, 0.2, 0.15, 0.1])
    if kind == "rectangle":
        return rectangle(length, width)
    if kind == "octagon":
        return rectangle(length, width, rng.uniform(0.1, 0.4) * min(length, width))
    if kind == "trapezium":
        corners = rectangle(length, width)
        corners[corners[:, 0] > 0] *= (1, rng.uniform(0.35, 0.8))
        return corners
    corners = circle(1, segments if kind == "ellipse" else int(rng.integers(3, 7)))
    return (corners - (corners.max(axis=0) + corners.min(axis=0)) / 2) / np.ptp(corners, axis=0) * (length, width)


def wall(loop: npt.ArrayLike, thickness: float, height: float, bottom: float = 0.0) -> list[Part]:
    """An upright wall of about `thickness` inside a closed convex loop around the origin: a frame or a flat ring."""
    outer = np.asarray(loop, dtype=np.float64)
    inner = outer * (1 - 2 * thickness / np.ptp(outer, axis=0))
    return shell(*([level(edge, bottom), level(edge, bottom + height)] for edge in (outer, inner)))
