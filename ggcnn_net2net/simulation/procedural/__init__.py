"""The object set `procedural40`: 40 everyday objects out of convex parts, one for each object of the paper.

The paper's objects come from ShapeNetSem, which needs a licence. These have the same categories in the same
numbers, and three of our own where the paper's list leaves them open. Like the paper's they are scaled to its gripper,
which opens 0.30 m, three times as wide as a hand: longest sides from 0.14 to 0.30 m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ggcnn_net2net.simulation.convex import Part, scale
from ggcnn_net2net.simulation.procedural import electronics, household, nature, stationery, tableware, toys


@dataclass(frozen=True)
class ProceduralObject:
    """An object that is made by a function."""

    name: str
    category: str
    """As ShapeNetSem spells it."""
    design: Callable[[], list[Part]]
    """Makes the convex parts, in any unit."""
    longest_side: float
    """Longest side of the axis-aligned bounding box in metres."""

    def build(self) -> list[Part]:
        """Convex parts in metres, the same on every machine and in every run."""
        parts = self.design()
        return scale(parts, self.longest_side / np.ptp(np.concatenate(parts), axis=0).max())


def _object(category: str, design: Callable[[], list[Part]], longest_side: float) -> ProceduralObject:
    return ProceduralObject(design.__name__, category, design, longest_side)


PROCEDURAL40: tuple[ProceduralObject, ...] = (
    _object("Pencil", stationery.pencil_1, 0.20),
    _object("Pencil", stationery.pencil_2, 0.17),
    _object("Pencil", stationery.pencil_3, 0.24),
    _object("Pencil", stationery.pencil_4, 0.15),
    _object("CellPhone", electronics.cell_phone_1, 0.20),
    _object("CellPhone", electronics.cell_phone_2, 0.18),
    _object("CellPhone", electronics.cell_phone_3, 0.22),
    _object("Guitar", toys.guitar_1, 0.30),
    _object("Guitar", toys.guitar_2, 0.29),
    _object("Vase", tableware.vase_1, 0.29),
    _object("Vase", tableware.vase_2, 0.26),
    _object("TrashBin", household.trash_bin_1, 0.28),
    _object("TrashBin", household.trash_bin_2, 0.26),
    _object("Stapler", stationery.stapler_1, 0.19),
    _object("Stapler", stationery.stapler_2, 0.25),
    _object("Knife", household.knife_1, 0.28),
    _object("Knife", household.knife_2, 0.24),
    _object("Gun", toys.gun_1, 0.24),
    _object("Gun", toys.gun_2, 0.30),
    _object("ToyFigure", toys.toy_figure, 0.22),
    _object("Mug", tableware.mug, 0.22),
    _object("Plate", tableware.plate, 0.26),
    _object("Cup", tableware.cup, 0.22),
    _object("PaperBox", stationery.paper_box, 0.27),
    _object("Bowl", tableware.bowl, 0.26),
    _object("Book", stationery.book, 0.25),
    _object("Coin", stationery.coin, 0.14),
    _object("Camera", electronics.camera, 0.24),
    _object("BeerBottle", tableware.beer_bottle, 0.28),
    _object("Candle", tableware.candle, 0.22),
    _object("Bird", nature.bird, 0.27),
    _object("Sword", household.sword, 0.30),
    _object("Pan", tableware.pan, 0.30),
    _object("Fish", nature.fish, 0.25),
    _object("Hammer", household.hammer, 0.28),
    _object("Keyboard", electronics.keyboard, 0.29),
    _object("Cap", household.cap, 0.27),
    _object("Banana", nature.banana, 0.23),
    _object("Flashlight", household.flashlight, 0.22),
    _object("Scissors", stationery.scissors, 0.24),
)
