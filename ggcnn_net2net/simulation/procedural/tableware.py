"""Tableware: mug, cup, plate, bowl, pan, beer bottle, vases and candle. Millimetres, z up."""

from __future__ import annotations

from ggcnn_net2net.simulation.convex import (
    Part,
    arc,
    box,
    cylinder,
    frustum,
    hull,
    lathe,
    level,
    rectangle,
    rotate,
    scale,
    shell,
    sweep,
    translate,
    tube,
)


def mug() -> list[Part]:
    """A straight wall with a big round handle."""
    handle = translate(rotate(arc(33, 11, -90, 90), "x", 90), (41, 0, 52))
    return [*tube([(44, 0), (44, 104)], wall=6, segments=16, floor=7), *handle]


def cup() -> list[Part]:
    """A teacup: a flared bowl on a foot, with a small handle."""
    wall = tube([(25, 8), (44, 30), (53, 72)], wall=5.5, floor=6)
    handle = sweep([(49, 0, 64), (66, 0, 66), (74, 0, 54), (66, 0, 38), (38, 0, 27)], 4.5, 6)
    return [*wall, frustum(29, 23, 10, segments=12), *handle]


def plate() -> list[Part]:
    """A flat middle, a step and a wide rim."""
    return tube([(72, 0), (88, 15), (122, 22)], wall=5.5, segments=16, floor=6)


def bowl() -> list[Part]:
    """A deep round bowl on a foot."""
    wall = tube([(32, 6), (64, 22), (84, 50), (91, 82)], wall=6, floor=6)
    return [*wall, cylinder(34, 8, segments=12)]


def pan() -> list[Part]:
    """A frying pan with a long rising handle that ends in an eye."""
    tang = hull(box((10, 22, 8), (-84, 0, 27)), box((10, 16, 8), (-100, 0, 33)))
    grip = hull(box((2, 16, 9), (-98, 0, 33)), box((2, 26, 13), (-172, 0, 45)))
    outer, inner = rectangle(34, 27, 8), rectangle(15, 11, 3)
    eye = shell([level(outer, -6), level(outer, 6)], [level(inner, -6), level(inner, 6)])
    body = tube([(72, 0), (88, 36)], wall=6, segments=16, floor=7)
    return [*body, tang, grip, *translate(rotate(eye, "y", 9), (-186, 0, 47))]


def beer_bottle() -> list[Part]:
    """A longneck with a crown cap."""
    profile = [(29, 0), (33, 5), (33, 122), (28, 146), (16, 170), (13, 222)]
    return [*lathe(profile, 14), cylinder(15.5, 7, (0, 0, 205), 14), frustum(17.5, 14, 10, (0, 0, 222), 14)]


def vase_1() -> list[Part]:
    """Tall and slender: a belly, a long neck and a flared mouth."""
    return tube([(30, 0), (51, 52), (46, 100), (20, 165), (38, 224)], wall=6.5, segments=9, floor=8)


def vase_2() -> list[Part]:
    """An eight-sided amphora with two handles."""
    wall = tube([(28, 0), (58, 62), (27, 112), (38, 145)], wall=6.5, segments=8, floor=8)
    handle = sweep([(48, 0, 76), (66, 0, 92), (62, 0, 122), (29, 0, 128)], 5, 6)
    return [*wall, *handle, *scale(handle, (-1, 1, 1))]


def candle() -> list[Part]:
    """A burning candle in a chamberstick: a saucer with a ring for the finger."""
    saucer = tube([(40, 0), (54, 14)], wall=6, floor=6)
    socket = frustum(20, 16, 20, (0, 0, 4), 12)
    wax, wick = cylinder(13, 92, (0, 0, 16), 12), cylinder(3, 8, (0, 0, 106), 6)
    flame = lathe([(3, 112), (8, 121), (6, 132), (1, 148)], 8)
    ring = translate(rotate(arc(15, 7, 0, 360, segments=9), "x", 90), (60, 0, 16))
    return [*saucer, socket, wax, wick, *flame, *ring]
