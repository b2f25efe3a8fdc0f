"""Things from a desk: pencils, staplers, scissors, book, paper box and coin. Millimetres, z up."""

from __future__ import annotations

import numpy as np

from ggcnn_net2net.simulation.convex import (
    Part,
    box,
    chain,
    circle,
    cylinder,
    disc,
    ellipsoid,
    frustum,
    hull,
    lathe,
    level,
    prism,
    rectangle,
    rotate,
    scale,
    shell,
    translate,
)


def pencil_1() -> list[Part]:
    """Hexagonal, sharpened, with an eraser in a ferrule."""
    wood = lathe([(1.5, 0), (3, 7), (6.5, 24), (6.5, 150)], 6)
    ferrule = [cylinder(7, 4, (0, 0, z), 12) for z in (148, 158)]
    eraser = lathe([(6, 148), (6, 174), (3, 180)], 12)
    return rotate([*wood, *ferrule, *eraser], "y", 90)


def pencil_2() -> list[Part]:
    """A mechanical pencil: round, with a clip that keeps it from rolling."""
    cone = lathe([(2, 0), (2.5, 8), (7, 24)], 12)
    barrel = [cylinder(r, height, (0, 0, z), 12) for r, height, z in ((7, 36, 24), (6, 78, 58), (4, 20, 130))]
    clip = [box((5, 12, 5), (0, 8, 127)), box((5, 4.5, 48), (0, 12, 105.5))]
    return rotate([*cone, *barrel, *clip], "y", 90)


def pencil_3() -> list[Part]:
    """A carpenter's pencil: flat and broad, with a flat lead."""
    section = rectangle(11, 22, 3)
    lead = hull(level(rectangle(4, 6), 0), level(rectangle(5, 9), 14))
    wood = chain([level(rectangle(6, 12), 12), level(section, 38), level(section, 205)])
    return rotate([lead, *wood], "y", 90)


def pencil_4() -> list[Part]:
    """A short, thick, three-sided pencil for small hands, with a ball at its end."""
    edge = np.array([(14, -3.5), (14, 3.5)])
    section = np.concatenate([rotate(level(edge), "z", angle) for angle in (60, 180, 300)])
    body = chain([disc(4.5, (0, 0, 8), 9), translate(section, (0, 0, 32)), translate(section, (0, 0, 106))])
    lead = frustum(2, 4, 10, segments=9)
    return rotate([lead, *body, ellipsoid((14, 14, 14), (0, 0, 117))], "y", 90)


def stapler_1() -> list[Part]:
    """A desk stapler, half open."""
    base = [prism(rectangle(150, 36, 10), 7), box((16, 14, 5), (56, 0, 8))]
    hinge = box((34, 26, 30), (-52, 0, 19))
    magazine = box((126, 20, 12), (63, 0, 6))
    cover = hull(prism(rectangle(140, 30, 9), 8, (63, 0, 10)), box((96, 22, 4), (54, 0, 28)))
    nose = box((8, 22, 20), (129, 0, 8))
    arm = translate(rotate([magazine, cover, nose], "y", -13), (-66, 0, 22))
    return [*base, hinge, *arm]


def stapler_2() -> list[Part]:
    """A heavy-duty stapler with a long lever."""
    base = [prism(rectangle(200, 52, 12), 9), prism(rectangle(70, 30, 6), 14, (50, 0, 0))]
    post = hull(box((70, 32, 4), (-58, 0, 9)), box((44, 32, 4), (-50, 0, 58)))
    magazine = box((158, 22, 20), (10, 0, 40))
    head = prism(rectangle(30, 32, 6), 48, (82, 0, 26))
    lever = hull(box((16, 18, 12), (78, 0, 76)), box((16, 18, 12), (-40, 0, 108)))
    grip = hull(box((12, 24, 16), (-32, 0, 106)), box((8, 30, 16), (-108, 0, 126)))
    link = hull(box((20, 16, 4), (-46, 0, 56)), box((20, 14, 4), (-34, 0, 106)))
    return [*base, post, magazine, head, lever, grip, link]


def scissors() -> list[Part]:
    """Open scissors, flat on the table; both halves lie in one plane, which lets them rest without wobbling."""
    half = _scissors_half()
    return [*half, *scale(half, (1, -1, 1)), cylinder(12, 8, segments=12)]


def _scissors_half() -> list[Part]:
    """Blade, shank and ring for the thumb, turned around the pivot in the origin."""
    blade = prism([(-14, -9), (8, -10), (104, 0), (104, 2), (8, 6), (-14, 5)], 8)
    shank = prism([(0, -9), (0, 7), (-50, -7), (-50, -17)], 8)
    outer = [level(circle(1, 12) * (29, 20), z) for z in (0, 8)]
    inner = [level(circle(1, 12) * (20, 11.5), z) for z in (0, 8)]
    ring = translate(shell(outer, inner), (-68, -22, 0))
    return rotate([blade, shank, *ring], "z", 12)


def book() -> list[Part]:
    """A closed hardcover: covers that stand out over the pages, and a round spine with bands."""
    covers = [box((150, 210, 5), (0, 0, z)) for z in (2.5, 35.5)]
    pages = box((140, 196, 30), (-1, 0, 19))
    spine = _spine(81, 210)
    bands = [translate(_spine(85, 9), (0, y, 0)) for y in (-70, -30, 30, 70)]
    title = box((80, 50, 6), (0, 40, 37))
    return [*covers, pages, spine, *bands, title]


def _spine(reach: float, length: float) -> Part:
    """An arch over the backs of the pages that reaches to x = `reach`, `length` long."""
    arch = [(68, 0), (reach - 7, 1), (reach, 12), (reach, 26), (reach - 7, 37), (68, 38)]
    return rotate(translate(prism(arch, length), (0, 0, -length / 2)), "x", 90)


def paper_box() -> list[Part]:
    """An open cardboard box with four flaps."""
    outer, inner = rectangle(150, 110), rectangle(140, 100)
    walls = shell([level(outer), level(outer, 95)], [level(inner), level(inner, 95)])
    flaps = [*_flaps(150, 55, 42), *rotate(_flaps(110, 75, 42), "z", 90)]
    return [*walls, box((150, 110, 5), (0, 0, 2.5)), *flaps]


def _flaps(length: float, distance: float, reach: float) -> list[Part]:
    """Two slanting flaps at y = ±`distance`."""
    flap = rotate(box((length - 4, reach, 5), (0, reach / 2 - 2, 0)), "x", 24)
    flap = translate(flap, (0, distance - 2, 93))
    return [flap, scale(flap, (1, -1, 1))]


def coin() -> list[Part]:
    """A big coin: a raised rim and the number 1."""
    rim = [level(circle(60, 20), z) for z in (0, 12)], [level(circle(52, 20), z) for z in (0, 12)]
    number = [box((13, 58, 12), (3, 0, 6)), box((38, 10, 12), (3, -25, 6))]
    flag = prism([(-16, 14), (-10, 10), (8, 22), (8, 29), (0, 29)], 12)
    return [cylinder(58, 8, segments=20), *shell(*rim), *number, flag]
