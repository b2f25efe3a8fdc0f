"""Toys and instruments: guitars, toy guns and a toy figure. Millimetres, z up."""

from __future__ import annotations

import numpy.typing as npt

from ggcnn_net2net.simulation.convex import (
    Part,
    arc,
    box,
    cylinder,
    hull,
    prism,
    rod,
    rotate,
    scale,
    translate,
    tube,
)


def guitar_1() -> list[Part]:
    """A classical guitar on its back, with an open sound hole."""
    lower = cylinder(55, 26)
    waist = prism([(36, -38), (60, -37), (56, -26), (44, -26)], 26)
    upper = tube([(42, 0), (42, 26)], wall=25, floor=8)

    bridge = box((10, 46, 10), (-22, 0, 27))
    fingerboard = box((116, 17, 13), (154, 0, 25))
    heel = prism([(106, -14), (124, -9), (124, 9), (106, 14)], 24)
    head = hull(box((4, 17, 10), (208, 0, 24)), box((34, 28, 8), (228, 0, 20)))
    pegs = [rod((x, -21, 20), (x, 21, 20), 3.5, segments=6) for x in (217, 228, 239)]
    body = [lower, waist, scale(waist, (1, -1, 1)), *translate(upper, (72, 0, 0))]
    return [*body, bridge, fingerboard, heel, head, *pegs]


def guitar_2() -> list[Part]:
    """An electric guitar: two horns, three pickups, all tuning pegs on one side."""
    half = [(38, 22), (26, 31), (0, 42), (-26, 45), (-44, 36), (-52, 18)]
    body = [
        prism([*half, *((x, -y) for x, y in reversed(half))], 17),
        prism([(18, 30), (28, 16), (74, 33), (70, 42), (46, 46)], 17),
        prism([(18, -30), (28, -16), (60, -33), (56, -42), (42, -46)], 17),
    ]
    pickups = [box((8, 34, 10), (x, 0, 17)) for x in (-6, 12, 30)]
    bridge = box((14, 34, 12), (-28, 0, 17))
    knobs = [cylinder(5, 10, (x, y, 14), 8) for x, y in ((0, -32), (-18, -34))]
    neck = box((160, 15, 12), (110, 0, 18))
    head = prism([(186, -7), (226, -10), (234, 2), (228, 16), (198, 16), (186, 7)], 9, (0, 0, 12))
    pegs = [rod((x, 10, 16), (x, 26, 16), 3.5, segments=6) for x in (198, 207, 216, 225)]
    return [*body, *pickups, bridge, *knobs, neck, head, *pegs]


def gun_1() -> list[Part]:
    """A toy pistol, on its side."""
    return _flat(
        ([(-12, 0), (150, 0), (150, 24), (-6, 26), (-12, 20)], 26),
        ([(-4, -12), (118, -12), (126, 2), (-4, 2)], 20),
        ([(-4, -10), (34, -10), (16, -82), (-26, -82)], 24),
        ([(-25, -78), (18, -78), (16, -88), (-28, -88)], 28),
        ([(-22, 12), (-6, 8), (-6, 24), (-18, 26)], 12),
        ([(140, 22), (148, 22), (146, 31), (142, 31)], 8),
        ([(-4, 24), (8, 24), (8, 31), (-2, 31)], 14),
        ([(46, -10), (54, -10), (50, -32), (44, -32)], 8),
        ([(68, -10), (76, -10), (72, -36), (66, -36)], 10),
        ([(24, -36), (72, -36), (66, -44), (22, -44)], 10),
        ([(148, 6), (158, 6), (158, 20), (148, 20)], 16),
    )


def gun_2() -> list[Part]:
    """A toy rifle with a scope and a curved magazine, on its side."""
    sides = _flat(
        ([(-60, -4), (-60, 14), (-130, 8), (-140, 6), (-140, -34), (-132, -36)], 18),
        ([(-64, -10), (28, -10), (28, 16), (-64, 16)], 22),
        ([(24, -8), (86, -4), (86, 12), (24, 14)], 18),
        ([(-48, -8), (-26, -8), (-40, -46), (-60, -46)], 16),
        ([(4, -8), (24, -8), (30, -30), (10, -34)], 14),
        ([(10, -34), (30, -30), (42, -50), (24, -58)], 14),
        ([(-10, -8), (-4, -8), (-4, -28), (-8, -28)], 8),
        ([(-32, -24), (-4, -24), (-4, -30), (-36, -30)], 8),
        ([(134, 8), (142, 8), (140, 22), (136, 22)], 6),
        *(([(x - 5, 14), (x + 5, 14), (x + 5, 28), (x - 5, 28)], 8) for x in (-36, 0)),
    )
    barrel = [rod((80, 5, 0), (150, 5, 0), 5.5), rod((142, 5, 0), (158, 5, 0), 7.5)]
    scope = [
        rod((-56, 31, 0), (-44, 31, 0), 9),
        rod((-50, 31, 0), (14, 31, 0), 7),
        rod((8, 31, 0), (34, 31, 0), 7, 9.5),
    ]
    return [*sides, *barrel, *scope]


def toy_figure() -> list[Part]:
    """A little man of building blocks, waving; he looks along -y."""
    leg = [box((24, 26, 52), (14, 0, 34)), box((24, 36, 14), (14, -6, 7))]
    hips = box((52, 26, 12), (0, 0, 62))
    torso = hull(box((56, 28, 4), (0, 0, 68)), box((40, 26, 4), (0, 0, 116)))
    neck, head, stud = (
        cylinder(r, height, (0, 0, z), 12) for r, height, z in ((11, 10, 114), (19, 30, 122), (10, 9, 150))
    )
    eyes = [rod((x, -14, 141), (x, -20.5, 141), 3, segments=6) for x in (-7, 7)]
    mouth = box((16, 8, 4), (0, -16, 129))
    legs, arms = [*leg, *scale(leg, (-1, 1, 1))], [*_arm(25), *scale(_arm(150), (-1, 1, 1))]
    return [*legs, hips, torso, neck, head, stud, *eyes, mouth, *arms]


def _arm(degrees: float) -> list[Part]:
    """Shoulder and arm with a gripping hand, lifted by an angle from hanging down."""
    upper = hull(box((14, 16, 14)), box((12, 13, 6), (0, 0, -40)))
    hand = translate(rotate(arc(9, 7, -240, 60, segments=5), "x", -90), (0, 0, -52))
    return translate(rotate([upper, *hand], "y", -degrees), (26, 0, 106))


def _flat(*plates: tuple[npt.ArrayLike, float]) -> list[Part]:
    """Plates of an outline and a thickness, all with z = 0 in their middle."""
    return [prism(outline, thickness, (0, 0, -thickness / 2)) for outline, thickness in plates]
