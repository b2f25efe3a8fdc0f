"""Living things: bird, fish and banana. Millimetres, z up."""

from __future__ import annotations

import numpy as np

from ggcnn_net2net.simulation.convex import (
    Part,
    cylinder,
    ellipsoid,
    hull,
    prism,
    rod,
    rotate,
    scale,
    sweep,
    translate,
)


def bird() -> list[Part]:
    """A bird with spread wings; it flies along x."""
    body = rotate(ellipsoid((50, 22, 22)), "y", -8)
    head = ellipsoid((18, 16, 16), (52, 0, 16))
    beak = rod((66, 0, 15), (86, 0, 11), 6.5, 2)
    tail = [prism([(-40, -7), (-40, 7), (-92, y + 8), (-92, y - 8)], 6, (0, 0, -9)) for y in (-22, 0, 22)]
    wing = [
        prism([(34, 10), (40, 60), (-4, 60), (-20, 10)], 7),
        prism([(40, 58), (20, 112), (2, 116), (-4, 58)], 6),
        prism([(-4, 58), (20, 58), (-8, 104), (-18, 100)], 6),
        prism([(-10, 34), (6, 58), (-26, 84), (-34, 78)], 6),
    ]
    lifted = rotate(wing, "x", 14)
    return [body, head, beak, *tail, *lifted, *scale(lifted, (1, -1, 1))]


def fish() -> list[Part]:
    """A fish on its side."""
    body = [
        hull(ellipsoid((52, 34, 17), (20, 0, 0)), ellipsoid((8, 11, 8), (80, -2, 0), segments=8, rings=1)),
        hull(ellipsoid((30, 30, 15), (0, 0, 0)), ellipsoid((5, 9, 6), (-66, 0, 0), segments=8, rings=1)),
    ]
    fins = [
        prism([(-64, -8), (-64, 6), (-104, 38), (-112, 34), (-100, 4)], 8),
        prism([(-64, 8), (-100, -2), (-112, -34), (-104, -38), (-64, -6)], 8),
        prism([(46, 26), (24, 50), (-34, 38), (-30, 18)], 8),
        prism([(-10, -26), (-42, -42), (-36, -16)], 8),
        prism([(30, -28), (10, -46), (4, -28)], 8),
    ]
    side = [
        prism([(32, 4), (-20, 16), (-14, -18)], 6, (0, 0, 13)),
        cylinder(5, 6, (65, 7, 6), 10),
    ]
    return [*body, *translate(fins, (0, 0, -4)), *side, *scale(side, (1, 1, -1))]


def banana() -> list[Part]:
    """A banana: a bent, six-sided body with a stem."""
    angles = np.radians([-150, -138, -122, -104, -86, -68, -54, -44, -38])
    radii = (5.5, 6, 13, 17.5, 19, 17.5, 13, 6.5, 4.5)
    line = 105 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    return sweep(list(line), radii, 6)
