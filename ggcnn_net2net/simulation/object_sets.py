"""Object sets: what the benchmark grasps. One loader and one protocol for all of them.

* `procedural40`: 40 objects made by `ggcnn_net2net.simulation.procedural`, one for each of the paper's.
* `pybullet`: 40 random objects that come with pybullet_data, scaled to 0.25 m.
* `ycb40`: 40 objects of the YCB set at true scale, from the reference data or downloaded.
* `shapenetsem:FOLDER`: the paper's objects, from the user's licensed copy of ShapeNetSem.
* `training:N:SEED`: the first N objects to train with, which no benchmark uses; 40 and seed 0 where left out.
* `FOLDER`: any meshes with an objects.csv.
"""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path

import pybullet_data

from ggcnn_net2net import reference_data
from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.protocol import PAPER, Protocol
from ggcnn_net2net.simulation.meshes import (
    centre_of_mass,
    convex_decomposition,
    extents,
    read_parts,
    vertex_mean,
)

PYBULLET_FOLDERS = tuple(f"{number:03d}" for number in range(0, 400, 10))
PYBULLET_SIDE = 0.25
CONVEX_SUFFIX = "_vhacd.obj"
MESH_SUFFIXES = (".obj", ".stl", ".ply", ".off", ".glb", ".dae")


@dataclass(frozen=True)
class ObjectModel:
    """An object of the benchmark; its base frame lies in its centre."""

    name: str
    category: str
    mesh: Path
    """OBJ with one convex part an `o` group."""
    scale: float
    """Metres per unit of the mesh."""
    centre: tuple[float, float, float]
    """Origin and centre of mass in the scaled mesh's frame, metres."""
    longest_side: float
    """Longest side of the scaled mesh's axis-aligned bounding box, metres."""

    @property
    def mass(self) -> float:
        """Mass in kg: the longest side in metres, as in the paper's public code."""
        return self.longest_side


@dataclass(frozen=True)
class ObjectSet:
    """A named tuple of objects."""

    name: str
    objects: tuple[ObjectModel, ...]

    def __post_init__(self) -> None:
        """Refuse two objects of one name, by which scenes and results are kept, and names that no table can show."""
        names = [model.name for model in self.objects]
        for text in (*names, *(model.category for model in self.objects)):
            if not text.isprintable():
                raise ObjectSetError(
                    f"expected names and categories of printable characters in the set {self.name}, received {text!r}"
                )
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ObjectSetError(
                f"expected objects with different names in the set {self.name}, received more than one "
                f"{', '.join(repeated)}: copy the mesh under another name"
            )

    def named(self, name: str) -> ObjectModel:
        """The object of this name.

        Args:
            name: of the object.

        Returns:
            The object.

        Raises:
            ObjectSetError: there is none.
        """
        for model in self.objects:
            if model.name == name:
                return model
        known = ", ".join(model.name for model in self.objects)
        raise ObjectSetError(f"expected one of the objects {known}; received {name!r}")

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 over all names, meshes, scales and centres: equal sets give equal scenes."""
        rows = [
            [
                model.name,
                reference_data.sha256_of(model.mesh),
                repr(model.scale),
                [repr(value) for value in model.centre],
            ]
            for model in self.objects
        ]
        return hashlib.sha256(json.dumps(rows).encode()).hexdigest()


def load_object_set(spec: str, protocol: Protocol = PAPER) -> ObjectSet:
    """Load an object set by name or folder.

    Args:
        spec: "procedural40", "pybullet", "ycb40", "shapenetsem:FOLDER", "training:N:SEED", or a folder with meshes
            and an objects.csv: a column `name` for NAME.obj, .stl, .ply, .off, .glb or .dae, and optionally
            `category`, `scale` (metres per unit, default 1) or `longest_side` (metres, instead of scale). A mesh
            NAME_vhacd.obj, one convex part an `o` group, is used where it is there; other meshes are decomposed once
            and cached.
        protocol: decides where an object's centre lies.

    Returns:
        The objects in the set's order, with their meshes on the disk.

    Raises:
        ObjectSetError: no such set, or meshes or rows that cannot be used.
        DataNotFoundError: the set's files are nowhere and cannot be fetched.
    """
    name, _, argument = spec.partition(":")
    if name in _SETS and (not argument or name in _SETS_WITH_ARGUMENT):
        objects = _SETS[name](argument, protocol)
        name = spec if name == "training" else name  # the argument of the other is a folder of the user's machine
    elif Path(spec).is_dir():
        name, objects = Path(spec).resolve().name, _folder_objects(Path(spec), protocol)
    else:
        raise ObjectSetError(
            f"expected an object set ({', '.join(_SETS)}) or a folder with meshes and an objects.csv, received {spec!r}"
        )
    return ObjectSet(name, tuple(objects))


def absolute_spec(spec: str) -> str:
    """The same object set, for any working directory.

    Args:
        spec: of `load_object_set`.

    Returns:
        It with the absolute path of its folder, if it has one.
    """
    name, colon, argument = spec.partition(":")
    if name == "shapenetsem" and argument:
        return f"{name}{colon}{Path(argument).absolute()}"
    return str(Path(spec).absolute()) if name not in _SETS and Path(spec).is_dir() else spec


def make_model(
    name: str,
    category: str,
    mesh: Path,
    protocol: Protocol,
    scale: float = 1.0,
    longest_side: float | None = None,
) -> ObjectModel:
    """Measure a mesh of convex parts.

    Args:
        name: of the object.
        category: kind of object, for tables.
        mesh: OBJ with one convex part an `o` group.
        protocol: decides where the centre lies.
        scale: metres per unit of the mesh.
        longest_side: longest side in metres that the object is to have; replaces `scale`.

    Returns:
        The object with scale, centre and longest side in metres.

    Raises:
        ObjectSetError: the mesh cannot be read, or a size that is not positive.
    """
    parts = read_parts(mesh)
    side = float(extents(parts).max())
    if longest_side is not None and side > 0:
        scale = longest_side / side
    if not (scale > 0 and side > 0):
        raise ObjectSetError(f"expected object {name!r} with a positive size, received scale {scale}, side {side}")
    centre = vertex_mean(parts) if protocol.object_centre == "vertex_mean" else centre_of_mass(parts)
    x, y, z = (float(value) * scale for value in centre)
    return ObjectModel(name, category, mesh.resolve(), scale, (x, y, z), side * scale)


def _procedural40(_: str, protocol: Protocol) -> Iterable[ObjectModel]:
    from ggcnn_net2net.simulation.convex import obj_text  # needs scipy, which workers do without
    from ggcnn_net2net.simulation.procedural import PROCEDURAL40

    texts = {item.name: obj_text(item.build()) for item in PROCEDURAL40}
    version = hashlib.sha256("".join(texts.values()).encode()).hexdigest()[:16]
    folder = reference_data.cache_root() / "objects" / f"procedural40-{version}"
    for item in PROCEDURAL40:
        mesh = folder / f"{item.name}.obj"
        if not mesh.is_file():
            write_text(mesh, texts[item.name])
        yield make_model(item.name, item.category, mesh, protocol)


def _pybullet(_: str, protocol: Protocol) -> Iterable[ObjectModel]:
    root = Path(pybullet_data.getDataPath()) / "random_urdfs"
    for number in PYBULLET_FOLDERS:
        mesh = root / number / f"{number}.obj"
        yield make_model(f"random_{number}", "random", mesh, protocol, longest_side=PYBULLET_SIDE)


def _ycb40(_: str, protocol: Protocol) -> Iterable[ObjectModel]:
    from ggcnn_net2net.simulation.ycb import ycb40_folder

    return _folder_objects(ycb40_folder(), protocol)


def _shapenetsem(folder: str, protocol: Protocol) -> Iterable[ObjectModel]:
    if not folder or not Path(folder).is_dir():
        raise ObjectSetError(
            f"expected shapenetsem:FOLDER with the OBJ files of your copy of ShapeNetSem, received {folder!r}: "
            "request access to it from the ShapeNet project"
        )
    return [
        make_model(row["id"], row["category"], _convex_mesh(Path(folder), row["id"]), protocol, float(row["scale"]))
        for row in _shapenetsem_rows()
    ]


def _shapenetsem_rows() -> list[dict[str, str]]:
    with resources.files(__package__).joinpath("data/shapenetsem.csv").open(encoding="utf-8") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def _training(argument: str, protocol: Protocol) -> Iterable[ObjectModel]:
    from ggcnn_net2net.simulation.training_objects import training_object  # imports this module, and scipy

    match = re.fullmatch(r"([1-9]\d*)(?::(\d+))?", argument or "40")
    if match is None:
        raise ObjectSetError(f"expected training:N:SEED with whole numbers, N above 0, received training:{argument}")
    count, seed = int(match[1]), int(match[2] or 0)
    return [training_object(index, seed, protocol) for index in range(count)]


def _folder_objects(folder: Path, protocol: Protocol) -> Iterable[ObjectModel]:
    table = folder / "objects.csv"
    try:
        with table.open(encoding="utf-8-sig", newline="") as lines:  # spreadsheets begin it with a mark
            rows = list(csv.DictReader(lines))
    except (OSError, UnicodeDecodeError) as error:
        raise ObjectSetError(
            f"expected {table} in UTF-8 with a column name (and optionally category, scale or longest_side): {error}"
        ) from error
    if not rows or not all(row.get("name") for row in rows):
        raise ObjectSetError(f"expected a column name with a value in every row of {table}, received {rows[:1]}")
    try:
        return [
            make_model(
                row["name"],
                row.get("category") or row["name"],
                _convex_mesh(folder, row["name"]),
                protocol,
                float(row.get("scale") or 1.0),
                float(row["longest_side"]) if row.get("longest_side") else None,
            )
            for row in rows
        ]
    except ValueError as error:
        raise ObjectSetError(f"expected numbers in columns scale and longest_side of {table}: {error}") from error


def _convex_mesh(folder: Path, name: str) -> Path:
    convex = folder / f"{name}{CONVEX_SUFFIX}"
    if convex.is_file():
        return convex
    for suffix in MESH_SUFFIXES:
        if (folder / f"{name}{suffix}").is_file():
            cache = reference_data.cache_root() / "objects" / "decomposed"
            return convex_decomposition(folder / f"{name}{suffix}", cache)
    raise ObjectSetError(
        f"expected a mesh {name}{CONVEX_SUFFIX} or {name}.obj (.stl, .ply, ...) in {folder}, found none"
    )


_SETS: dict[str, Callable[[str, Protocol], Iterable[ObjectModel]]] = {
    "procedural40": _procedural40,
    "pybullet": _pybullet,
    "ycb40": _ycb40,
    "shapenetsem": _shapenetsem,
    "training": _training,
}
_SETS_WITH_ARGUMENT = ("shapenetsem", "training")
