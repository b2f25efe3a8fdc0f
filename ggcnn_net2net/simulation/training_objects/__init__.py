"""Objects to train with: an endless, seeded family, apart from everything that the benchmark grasps.

About a third are pybullet_data's random objects without the 40 of the benchmark, the others are assemblies of convex
parts with random dimensions, from families of everyday shapes. No design of the benchmark's `procedural40` is used.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet_data
from scipy.spatial import ConvexHull

from ggcnn_net2net import reference_data
from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.protocol import PAPER, Protocol
from ggcnn_net2net.simulation.convex import Part, obj_text, scale
from ggcnn_net2net.simulation.meshes import extents, read_parts
from ggcnn_net2net.simulation.object_sets import PYBULLET_FOLDERS, ObjectModel, make_model
from ggcnn_net2net.simulation.training_objects import hollow, slender, solids, tools
from ggcnn_net2net.simulation.training_objects.draws import between

SIDES = (0.04, 0.32)
"""Longest side of an assembly in metres: small YCB objects to somewhat more than the gripper's opening."""
PYBULLET_SIDES = (0.08, 0.30)
WIDEST = 0.25
"""Second longest side in metres at most: what lies flat fits between fingers that open 0.30 m."""
THINNEST = 0.004
"""Thickness of an assembly's parts in metres; thinner ones sink into each other in the simulation."""
MAX_PARTS = 40
"""Convex parts of an object: more are slow to simulate."""

PYBULLET_NUMBERS = tuple(
    number
    for number in (f"{value:03d}" for value in range(1000))
    if number not in PYBULLET_FOLDERS and number != "168"  # 168 has no vertices but NaN
)
"""Folders of pybullet_data's random_urdfs that the benchmark does not use."""
_PYBULLET = "pybullet"
_DRAWS = 200


@dataclass(frozen=True)
class Family:
    """Objects of one kind with random dimensions."""

    name: str
    weight: float
    """Share among all training objects, in percent."""
    design: Callable[[np.random.Generator], list[Part]] | None
    """Makes the convex parts in any unit; None for the meshes of pybullet_data."""


FAMILIES: tuple[Family, ...] = (
    Family(_PYBULLET, 35, None),
    Family("blob", 4, solids.blob),
    Family("brick", 5, solids.brick),
    Family("stack", 4, solids.stack),
    Family("plate", 7, solids.plate),
    Family("turned", 5, solids.turned),
    Family("assembly", 3, solids.assembly),
    Family("pipe", 3, hollow.pipe),
    Family("cup", 5, hollow.cup),
    Family("bin", 3, hollow.bin_or_tray),
    Family("ring", 4, hollow.ring),
    Family("rod", 6, slender.bar),
    Family("tool", 5, tools.tool),
    Family("paddle", 4, tools.paddle),
    Family("branching", 4, slender.branching),
    Family("bent", 3, slender.bent),
)


def training_object(
    index: int, seed: int, protocol: Protocol = PAPER, sides: tuple[float, float] | None = None
) -> ObjectModel:
    """Make one training object; its mesh is kept by content in the user's cache, where several processes may write it.

    Args:
        index: which one of the endless family, 0 or more.
        seed: of the family, 0 or more; `index` and `seed` alone decide everything.
        protocol: decides where the object's centre lies.
        sides: range of the longest side in metres, the lower one at most `WIDEST`; None: `SIDES`, and `PYBULLET_SIDES`
            for pybullet_data's. What would be too wide or too thin for the range is drawn again.

    Returns:
        The object, named FAMILY_INDEX, its category the family.

    Raises:
        ObjectSetError: a negative index or seed, or no object of the family has such a side.
    """
    if index < 0 or seed < 0:
        raise ObjectSetError(f"expected an index and a seed of 0 or more, received {index} and {seed}")
    rng = np.random.default_rng([seed, index])
    weights = np.array([family.weight for family in FAMILIES])
    family = FAMILIES[rng.choice(len(FAMILIES), p=weights / weights.sum())]
    name = f"{family.name}_{index:06d}"
    if family.design is None:
        mesh, side = _draw_pybullet(rng, sides or PYBULLET_SIDES)
        return make_model(name, family.name, mesh, protocol, longest_side=side)
    return make_model(name, family.name, _cached(name, build(family.design, rng, sides or SIDES)), protocol)


def shape_of(model: ObjectModel) -> str:
    """What a split by objects keeps together: a mesh of pybullet_data may be several objects, of different sizes."""
    return f"pybullet_{model.mesh.stem}" if model.category == _PYBULLET else model.name


def build(
    design: Callable[[np.random.Generator], list[Part]],
    rng: np.random.Generator,
    sides: tuple[float, float] = SIDES,
) -> list[Part]:
    """Draw an assembly and its size. A design of which no size fits is drawn again.

    Args:
        design: makes convex parts in any unit.
        rng: for design and size.
        sides: range of the longest side in metres.

    Returns:
        The convex parts in metres.

    Raises:
        ObjectSetError: none of many fits.
    """
    for _ in range(_DRAWS):
        parts = design(rng)
        longest = extents(parts).max()
        low = max(sides[0], THINNEST * longest / min(_thickness(part) for part in parts))
        high = _largest_side(parts, sides[1])
        if low <= high:
            return scale(parts, between(rng, low, high) / longest)
    raise ObjectSetError(_no_size(sides))


def _draw_pybullet(rng: np.random.Generator, sides: tuple[float, float]) -> tuple[Path, float]:
    """One of pybullet_data's meshes that has few parts and is not too wide, and a longest side for it in metres."""
    root = Path(pybullet_data.getDataPath()) / "random_urdfs"
    for _ in range(_DRAWS):
        number = str(rng.choice(PYBULLET_NUMBERS))
        mesh = root / number / f"{number}.obj"
        parts = read_parts(mesh)
        if len(parts) <= MAX_PARTS and sides[0] <= (largest := _largest_side(parts, sides[1])):
            return mesh, between(rng, sides[0], largest)
    raise ObjectSetError(_no_size(sides))


def _no_size(sides: tuple[float, float]) -> str:
    return (
        f"expected a range of longest sides that objects of all families can have, received {sides[0]} to {sides[1]} "
        "m: choose a wider one"
    )


def _largest_side(parts: list[Part], limit: float) -> float:
    """The largest longest side up to a limit with which the second longest stays below `WIDEST`; metres."""
    _, middle, longest = np.sort(extents(parts))
    return min(limit, WIDEST * float(longest / middle))


def _thickness(part: Part) -> float:
    """Smallest distance between two parallel planes around a part of which one carries a face."""
    return float(min(np.ptp(part @ normal) for normal in ConvexHull(part).equations[:, :3]))


def _cached(name: str, parts: list[Part]) -> Path:
    """File of an assembly in the user's cache; its name holds its content's hash, so that versions never mix."""
    text = obj_text(parts)
    version = hashlib.sha256(text.encode()).hexdigest()[:16]
    mesh = reference_data.cache_root() / "objects" / "training" / f"{name}-{version}.obj"
    if not mesh.is_file():
        write_text(mesh, text)
    return mesh
