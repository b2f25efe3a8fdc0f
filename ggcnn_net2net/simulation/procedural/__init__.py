"""The object set `procedural40`: 40 everyday objects out of convex parts, one for each object of the paper.

The paper's objects come from ShapeNetSem, which needs a licence. These have the same categories in the same
numbers, three of our own where the paper's list leaves them open, and longest sides from 0.12 to 0.30 m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ggcnn_net2net.simulation.convex import Part, scale
from ggcnn_net2net.simulation.procedural import electronics, household, nature, stationery, tableware, toys

MILLIMETRE = 1e-3


@dataclass(frozen=True)
class ProceduralObject:
    """An object that is made by a function."""

    name: str
    category: str
    """As ShapeNetSem spells it."""
    design: Callable[[], list[Part]]
    """Makes the convex parts in millimetres."""

    def build(self) -> list[Part]:
        """Convex parts in metres, as they are on every machine and in every run."""
        return scale(self.design(), MILLIMETRE)


def _object(category: str, design: Callable[[], list[Part]]) -> ProceduralObject:
    return ProceduralObject(design.__name__, category, design)


PROCEDURAL40: tuple[ProceduralObject, ...] = (
    _object("Pencil", stationery.pencil_1),
    _object("Pencil", stationery.pencil_2),
    _object("Pencil", stationery.pencil_3),
    _object("Pencil", stationery.pencil_4),
    _object("CellPhone", electronics.cell_phone_1),
    _object("CellPhone", electronics.cell_phone_2),
    _object("CellPhone", electronics.cell_phone_3),
    _object("Guitar", toys.guitar_1),
    _object("Guitar", toys.guitar_2),
    _object("Vase", tableware.vase_1),
    _object("Vase", tableware.vase_2),
    _object("TrashBin", household.trash_bin_1),
    _object("TrashBin", household.trash_bin_2),
    _object("Stapler", stationery.stapler_1),
    _object("Stapler", stationery.stapler_2),
    _object("Knife", household.knife_1),
    _object("Knife", household.knife_2),
    _object("Gun", toys.gun_1),
    _object("Gun", toys.gun_2),
    _object("ToyFigure", toys.toy_figure),
    _object("Mug", tableware.mug),
    _object("Plate", tableware.plate),
    _object("Cup", tableware.cup),
    _object("PaperBox", stationery.paper_box),
    _object("Bowl", tableware.bowl),
    _object("Book", stationery.book),
    _object("Coin", stationery.coin),
    _object("Camera", electronics.camera),
    _object("BeerBottle", tableware.beer_bottle),
    _object("Candle", tableware.candle),
    _object("Bird", nature.bird),
    _object("Sword", household.sword),
    _object("Pan", tableware.pan),
    _object("Fish", nature.fish),
    _object("Hammer", household.hammer),
    _object("Keyboard", electronics.keyboard),
    _object("Cap", household.cap),
    _object("Banana", nature.banana),
    _object("Flashlight", household.flashlight),
    _object("Scissors", stationery.scissors),
)
