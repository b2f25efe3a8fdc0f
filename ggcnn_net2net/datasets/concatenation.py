"""Several dataset files in one."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ggcnn_net2net.datasets.hdf5 import SPLITS, DatasetWriter, GraspDataset


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
    if Path(path).is_file() and h5py.is_hdf5(path):
        with h5py.File(path, "r") as file:
            found = [split for split in SPLITS if split in file]
    return [GraspDataset(path, split) for split in found or SPLITS]  # the latter says what is wrong with the file


def concatenate(paths: Iterable[Path], output: Path, *, compressed: bool = True) -> dict[str, int]:
    """Join files of the layout into a new one, row by row: first all rows of the first file.

    Args:
        paths: files of the layout, with images of one size.
        output: file to write.
        compressed: see `DatasetWriter`.

    Returns:
        Rows of each split.

    Raises:
        DatasetError: a file that cannot be read, images of different sizes, a scene that is in both splits.
    """
    parts = [dataset for path in paths for dataset in splits_of(path)]
    attributes = {
        "source": "concatenation",
        "parts": [
            {"file": part.path.name, "split": part.split, "fingerprint": part.fingerprint, **part.attributes}
            for part in parts
        ],
    }
    rows = dict.fromkeys(SPLITS, 0)
    with DatasetWriter(output, attributes, compressed=compressed) as writer:
        for part in parts:
            for row in range(len(part)):
                writer.add(part.split, part.sample(row))
            rows[part.split] += len(part)
    return rows
