"""Which scenes are trained on and which are tested on: drawn once, kept in a file, checked when used."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import DatasetError

BY = ("image", "object")


@dataclass(frozen=True)
class Split:
    """Names of the scenes on each side, sorted."""

    train: tuple[str, ...]
    test: tuple[str, ...]
    by: str = "unknown"
    """"image": scenes were drawn. "object": objects were drawn, with all their scenes."""
    seed: int | None = None

    def __post_init__(self) -> None:
        counts = Counter([*self.train, *self.test])
        repeated = sorted(name for name, count in counts.items() if count > 1)
        if repeated or not self.train or not self.test:
            raise DatasetError(
                f"expected every scene on one side of the split and some on each, received {len(self.train)} for "
                f"training, {len(self.test)} for testing, more than once: {', '.join(repeated[:3]) or 'none'}"
            )

    @property
    def sha256(self) -> str:
        """Hash of the names on each side: equal for splits with equal sides."""
        content = {"train": sorted(self.train), "test": sorted(self.test)}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def side_of(self, names: Iterable[str]) -> dict[str, str]:
        """Name of each scene -> "train" or "test".

        Args:
            names: of all scenes.

        Returns:
            The side of each.

        Raises:
            DatasetError: the names are not exactly those of the split.
        """
        sides = dict.fromkeys(self.train, "train") | dict.fromkeys(self.test, "test")
        names = list(names)
        unknown, absent = sorted(set(names) - set(sides)), sorted(set(sides) - set(names))
        if unknown or absent:
            raise DatasetError(
                f"expected the scenes of the split; {len(unknown)} are not in it ({', '.join(unknown[:3]) or 'none'}), "
                f"{len(absent)} of it are not in the dataset ({', '.join(absent[:3]) or 'none'}): use this dataset's "
                "split, or make one"
            )
        return {name: sides[name] for name in names}

    def describe(self) -> dict[str, Any]:
        """How it was made and its hash, for provenance."""
        return {"by": self.by, "seed": self.seed, "sha256": self.sha256}


def make_split(objects: Mapping[str, str], by: str, test_fraction: float, seed: int) -> Split:
    """Draw a split.

    Args:
        objects: name of each scene -> what it shows.
        by: "image" draws `test_fraction` of the scenes, "object" that part of the objects.
        test_fraction: between 0 and 1; each side gets at least one.
        seed: of the draw; the order of `objects` makes no difference.

    Returns:
        The split, with how it was drawn.

    Raises:
        DatasetError: values outside of these, or nothing to draw from.
    """
    if by not in BY or not 0 < test_fraction < 1:
        raise DatasetError(f"expected by image or object, a test fraction in (0, 1); received {by!r}, {test_fraction}")
    units = sorted(set(objects.values()) if by == "object" else objects)
    if len(units) < 2:
        raise DatasetError(f"expected two or more {by}s to split, received {len(units)}")
    count = min(max(round(test_fraction * len(units)), 1), len(units) - 1)
    drawn = {units[index] for index in np.random.default_rng(seed).permutation(len(units))[:count]}
    sides: dict[bool, list[str]] = {True: [], False: []}
    for name in sorted(objects):
        sides[(objects[name] if by == "object" else name) in drawn].append(name)
    return Split(tuple(sides[False]), tuple(sides[True]), by, seed)


def write_split(path: Path, split: Split) -> None:
    """Write a split as JSON, its hash included."""
    write_text(path, json.dumps({**asdict(split), "sha256": split.sha256}, indent=1) + "\n")


def read_split(path: Path) -> Split:
    """Read a split.

    Args:
        path: JSON with lists `train` and `test`; its hash, if it has one, is checked.

    Returns:
        The split.

    Raises:
        DatasetError: no such file, one that is none, or one whose hash does not fit its names.
    """  # noqa: DOC501 -- the ValueError is caught
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        sha256 = content.pop("sha256", None)
        if not all(isinstance(name, str) for name in (*content["train"], *content["test"])):
            raise ValueError("names that are not texts")
        split = Split(**{**content, "train": tuple(content["train"]), "test": tuple(content["test"])})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(
            f"expected {' or '.join(BY)}, or a split file with lists 'train' and 'test', received {path}: {error!r}"
        ) from error
    if sha256 not in (None, split.sha256):
        raise DatasetError(
            f"expected the names in {path} to have the SHA-256 {sha256}, received {split.sha256}: the file was "
            "changed; if on purpose, remove its sha256"
        )
    return split
