"""Electronics: cell phones, camera and keyboard. Millimetres, z up."""

from __future__ import annotations

from ggcnn_net2net.simulation.convex import (
    Part,
    box,
    cylinder,
    frustum,
    hull,
    level,
    prism,
    rectangle,
    rod,
    rotate,
    shell,
    translate,
    tube,
)


def cell_phone_1() -> list[Part]:
    """A smartphone: a sunken screen in a frame, a home button and a camera bump on the back."""
    back = prism(rectangle(150, 74, 8), 7)
    frame = _frame((150, 74), (114, 62), 10, corner=8)
    button = cylinder(7, 11, (65, 0, 1), 12)
    speaker = box((5, 24, 8), (-66, 0, 8))
    keys = [box((18, 5, 5), (-30, 37, 5)), box((12, 5, 5), (0, 37, 5))]
    return [back, *frame, button, speaker, *keys]


def cell_phone_2() -> list[Part]:
    """A bar phone of old: a keypad, a small screen and a stub of an antenna."""
    body = hull(prism(rectangle(118, 46, 9), 15, (0, 0, 3)), prism(rectangle(108, 38, 6), 21))
    screen = [translate(part, (-30, 0, 14)) for part in _frame((38, 40), (26, 28), 9)]
    aerial = rod((-50, 14, 10), (-86, 14, 10), 6, 4.5)
    return [body, *screen, aerial, *_keypad((0, 12, 24, 36, 48), (-12.5, 0, 12.5), (8, 9.5), 20.5)]


def cell_phone_3() -> list[Part]:
    """A flip phone, open."""
    lower = [prism(rectangle(92, 50, 7), 13), *_keypad((8, 20, 32), (-15, 0, 15), (8, 11), 13)]
    ring = [[level(rectangle(side, side, side / 4), z) for z in (6, 16.5)] for side in (24, 13)]
    upper = [prism(rectangle(92, 50, 7), 8), *_frame((92, 50), (62, 36), 12, corner=7)]
    lifted = rotate(translate(upper, (-46, 0, 0)), "y", 32)
    hinge = rod((-46, -22, 8), (-46, 22, 8), 8.5, segments=10)
    return [*lower, *translate(shell(*ring), (-20, 0, 0)), hinge, *translate(lifted, (-46, 0, 3))]


def camera() -> list[Part]:
    """A single-lens reflex camera: the lens looks along -y."""
    body = [prism(rectangle(132, 44, 8), 82), prism(rectangle(30, 62, 8), 74, (-52, -6, 0))]
    finder = hull(box((52, 40, 4), (6, 0, 80)), box((30, 34, 4), (6, 0, 102)))
    shoe = box((20, 16, 6), (6, 4, 106))
    dials = [cylinder(13, 12, (46, 2, 80), 12), cylinder(8, 10, (-52, -18, 72), 10)]
    barrel = [cylinder(34, 44, segments=12), cylinder(37, 10, (0, 0, 32), 12)]
    ring = translate(tube([(34, 0), (34, 22)], wall=9), (0, 0, 40))
    lens = translate(rotate([*barrel, *ring], "x", 90), (8, -18, 42))
    return [*body, finder, shoe, *dials, *lens, frustum(4, 3, 5, (-52, -18, 80), 8)]


def keyboard() -> list[Part]:
    """A compact keyboard, higher at the back, with a block of arrow keys."""
    base = hull(box((285, 112, 8), (0, 0, 4)), box((285, 4, 6), (0, 54, 15)))
    rows = [
        ([24] * 9 + [34], 38),
        ([30] + [24] * 8 + [28], 15),
        ([38] + [24] * 7 + [44], -8),
        ([26, 26, 118, 26], -31),
    ]
    keys = [box((width - 4, 18, 12), (x, y, 14 + 0.09 * y)) for widths, y in rows for x, width in _spread(widths)]
    arrows = [box((18, 18, 12), (x, -31, 11)) for x in (86, 108, 130)]
    return [base, *keys, *arrows]


def _spread(widths: list[int]) -> list[tuple[float, int]]:
    """Centres and widths of keys that stand side by side from the left edge of the keyboard."""
    return [(sum(widths[:index]) + width / 2 - 137, width) for index, width in enumerate(widths)]


def _frame(outer: tuple[float, float], inner: tuple[float, float], height: float, corner: float = 4) -> list[Part]:
    """A frame around a sunken screen."""
    loops = [rectangle(*outer, corner), rectangle(*inner, 2)]
    return shell(*([level(loop), level(loop, height)] for loop in loops))


def _keypad(columns: tuple[float, ...], rows: tuple[float, ...], size: tuple[float, float], z: float) -> list[Part]:
    """Keys of a size (x, y), their middles at height z."""
    return [box((*size, 7), (x, y, z)) for x in columns for y in rows]
