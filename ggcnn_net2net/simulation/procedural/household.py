"""Tools and things of the house: knives, sword, hammer, flashlight, trash bins and cap. Millimetres, z up."""

from __future__ import annotations

import numpy as np

from ggcnn_net2net.simulation.convex import (
    Part,
    box,
    chain,
    cylinder,
    ellipsoid,
    frustum,
    hull,
    lathe,
    level,
    prism,
    rectangle,
    rod,
    rotate,
    scale,
    shell,
    sweep,
    translate,
    tube,
)


def knife_1() -> list[Part]:
    """A chef's knife, flat on the table."""
    blade = prism([(0, -24), (70, -22), (120, -10), (152, 13), (150, 16), (0, 20)], 5, (0, 0, 6))
    bolster = prism(rectangle(14, 28, 4), 15, (-3, 4, 1))
    grip = [
        hull(box((4, 24, 16), (-8, 4, 8.5)), box((4, 19, 14), (-60, 6, 8.5))),
        hull(box((4, 19, 14), (-60, 6, 8.5)), box((6, 26, 17), (-102, 2, 8.5))),
    ]
    rivets = [cylinder(4, 19, (x, 5, -1), 8) for x in (-25, -52, -80)]
    return [blade, bolster, *grip, *rivets]


def knife_2() -> list[Part]:
    """A cleaver: a broad blade with a hole in its corner."""
    outer = [(112, -46), (112, 26), (0, 26), (0, -46)]
    hole = [(98, 4), (98, 16), (82, 16), (82, 4)]
    blade = shell([level(outer, 5), level(outer, 11)], [level(hole, 5), level(hole, 11)])
    collar = box((12, 24, 14), (-4, 10, 8))
    sections = [(10, 4), (12, 40), (10, 70), (14, 84)]
    grip = chain(level(rectangle(2 * half, 1.7 * half, half / 2), z) for half, z in sections)
    return [*blade, collar, *translate(rotate(grip, "y", -90), (0, 10, 8))]


def sword() -> list[Part]:
    """A knight's sword: a double-edged blade, a cross-guard and a round pommel."""
    sections = [((22, 7), 0), ((18, 6.5), 178), ((2, 2), 210)]
    blade = chain(level([(-t / 2, 0), (0, -w / 2), (t / 2, 0), (0, w / 2)], z) for (w, t), z in sections)
    guard = sweep([(0, -40, 8), (0, -18, 0), (0, 18, 0), (0, 40, 8)], (7, 5.5, 5.5, 7), 8)
    grip = lathe([(6.5, -62), (8, -32), (6.5, 0)], 8)
    pommel = ellipsoid((8, 12, 12), (0, 0, -70), segments=8)
    return rotate([*blade, *guard, *grip, pommel], "y", 90)


def hammer() -> list[Part]:
    """A claw hammer, flat on the table: the handle along x, the head across."""
    sections = [(10, 12, 0), (12, 15, 70), (9, 11, 110), (8, 10, 238)]
    handle = chain(level(rectangle(2 * across, 2 * along, across), x) for across, along, x in sections)
    face = [cylinder(12, 30, (0, 0, 10), 12), cylinder(17, 20, (0, 0, 36), 12)]
    claw = chain(
        box((width, 9, 4), (x, y, z))
        for width, x, y, z in [(26, 0, 7, -16), (20, 3, 10, -36), (12, 12, 13, -56), (5, 24, 15, -68)]
    )
    head = [*face, box((30, 36, 36), (0, 0, -2)), *claw, *scale(claw, (1, -1, 1))]
    return rotate([*rotate(handle, "y", 90), *head], "x", 90)


def flashlight() -> list[Part]:
    """A torch with a wide head, a sunken lens and a switch."""
    end = [frustum(9, 17, 5, segments=12), cylinder(17, 22, (0, 0, 5), 12)]
    barrel = cylinder(14.5, 84, (0, 0, 25), 12)
    head = frustum(15, 29, 26, (0, 0, 107), 8)
    rim = translate(tube([(29, 0), (29, 35)], wall=6, segments=8, floor=12), (0, 0, 133))
    switch = box((26, 12, 8), (84, 0, 15))
    return [*rotate([*end, barrel, head, *rim], "y", 90), switch]


def trash_bin_1() -> list[Part]:
    """A pedal bin with its lid open."""
    body = rotate(tube([(53, 0), (59, 150)], wall=6, floor=8), "z", 15)
    lid = rotate(hull(cylinder(60, 6, segments=12), cylinder(44, 16, segments=12)), "z", 15)
    hinge = box((14, 44, 14), (-60, 0, 146))
    pedal = hull(box((10, 30, 8), (50, 0, 6)), box((8, 34, 5), (76, 0, 4)))
    return [*body, *translate(rotate([translate(lid, (60, 0, 0))], "y", -105), (-58, 0, 152)), hinge, pedal]


def trash_bin_2() -> list[Part]:
    """A wheeled bin with its lid thrown back."""
    levels = [(0, 100, 90), (195, 140, 122)]
    outer = [level(rectangle(x, y), z) for z, x, y in levels]
    inner = [level(rectangle(x - 14, y - 14), z) for z, x, y in levels]
    rim = [[level(rectangle(x, y), z) for z in (187, 203)] for x, y in ((158, 140), (124, 106))]
    axle = rod((-48, -64, 16), (-48, 64, 16), 6)
    wheels = [rod((-48, y, 18), (-48, y + 16, 18), 24, segments=12) for y in (-64, 48)]
    handle = rod((-92, -56, 203), (-92, 56, 203), 7)
    arms = [box((26, 12, 12), (-84, y, 198)) for y in (-50, 50)]
    lid = hull(box((10, 134, 5), (-94, 0, 205)), box((12, 122, 5), (-134, 0, 64)))
    body = [*shell(outer, inner), box((100, 90, 9), (0, 0, 4.5)), *shell(*rim)]
    return [*body, axle, *wheels, handle, *arms, lid]


def cap() -> list[Part]:
    """A baseball cap: a hollow crown, a bent visor and a button on top."""
    crown = tube([(80, 0), (76, 44), (50, 82), (12, 96)], wall=6, segments=10)
    return [*crown, frustum(18, 8, 8, (0, 0, 90), 10), *_visor()]


def _visor() -> list[Part]:
    """The crescent before the crown, bent downwards at both sides."""
    angles = np.radians(np.linspace(-66, 66, 7))
    x, y = np.cos(angles), np.sin(angles)
    inner = np.column_stack([72 * x, 75 * y, np.full(7, 3.0)])
    outer = np.column_stack([20 + 122 * x**0.6, 82 * y, 2 - 16 * y**2])
    lower = np.stack([inner, outer], axis=1)
    return chain(hull(edge, translate(edge, (0, 0, 6))) for edge in lower)
