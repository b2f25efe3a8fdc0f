"""Several dataset files in one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ggcnn_net2net.atomic import is_one_of
from ggcnn_net2net.datasets.hdf5 import SPLITS, DatasetWriter, GraspDataset
from ggcnn_net2net.errors import DatasetError

_NAMED = "names_tell_sources"


def splits_of(path: Path) -> list[GraspDataset]:
    """The splits that a file has, "train" first.

    Args:
        path: a file of the layout.

    Returns:
        One dataset a split.

    Raises:
        DatasetError: no such file, or neither split in it.
    """
    import h5py

    found: list[str] = []
    with suppress(OSError), h5py.File(path, "r") as file:
        found = [split for split in SPLITS if split in file]
    return [GraspDataset(path, split) for split in found or SPLITS]  # the latter says what is wrong with the file


def concatenate(paths: Iterable[Path], output: Path, *, compressed: bool = True) -> dict[str, int]:
    """Join files of the layout into a new one, row by row: first all rows of the first file.

    Scenes of different sources may have the same name (each folder of simulated scenes begins with pcd0000): where
    there are several sources, theirs stands before the name.

    Args:
        paths: files of the layout, with images of one size.
        output: file to write.
        compressed: see `DatasetWriter`.

    Returns:
        Rows of each split.

    Raises:
        DatasetError: a file that cannot be read or is `output`, images of different sizes, or a scene of one source
            that is in both splits.
    """
    paths = list(paths)
    if is_one_of(output, paths):
        raise DatasetError(f"expected another output file than the inputs, received {output} for both")
    parts = [dataset for path in paths for dataset in splits_of(path)]
    shapes = {part.shape: part.path for part in parts}
    if len(shapes) > 1:
        raise DatasetError(
            "expected images of one size, received "
            + ", ".join(f"{height}x{width} px in {path}" for (height, width), path in shapes.items())
        )
    attributes: dict[str, Any] = {
        "source": "concatenation",
        "parts": [
            {"file": part.path.name, "split": part.split, "fingerprint": part.fingerprint, **part.attributes}
            for part in parts
        ],
    }
    sources = [_sources(part.attributes, part.path.name) for part in parts]
    several = len(set().union(*sources)) > 1
    bare = [
        part.path for part, own in zip(parts, sources, strict=True) if len(own) > 1 and _NAMED not in part.attributes
    ]
    if bare and len({part.path for part in parts}) > 1:
        raise DatasetError(
            f"expected names of scenes that tell their source, {bare[0]} was joined of several by a version that wrote "
            "none: join the files that it was made of"
        )
    if several and not bare:
        attributes[_NAMED] = True
    rows = dict.fromkeys(SPLITS, 0)
    with DatasetWriter(output, attributes, compressed=compressed) as writer:
        for part, own in zip(parts, sources, strict=True):
            prefix = f"{next(iter(own))}/" if several and len(own) == 1 else ""  # those of several are named already
            for row in range(len(part)):
                sample = part.sample(row)
                writer.add(part.split, sample, prefix + sample.name)
            rows[part.split] += len(part)
    return rows


def _sources(attributes: Mapping[str, Any], file: str) -> set[str]:
    """Where the scenes of a file come from, by its provenance; the file's name where it has none."""
    if "parts" in attributes:
        return set().union(*(_sources(part, part["file"]) for part in attributes["parts"]))
    return {attributes.get("source", file)}
