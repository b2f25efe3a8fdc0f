"""Two networks of one benchmark, scene by scene: is one better, and on which objects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.reproduce.records import GraspRecord
from ggcnn_net2net.reproduce.statistics import PairedComparison, Rate
from ggcnn_net2net.simulation.trial import Outcome


@dataclass(frozen=True)
class ObjectCounts:
    """One object: successes of both networks in the poses that both have grasped."""

    name: str
    first: int
    second: int
    poses: int


@dataclass(frozen=True)
class Comparison:
    """Two networks on the scenes that both have grasped."""

    first: Rate
    second: Rate
    paired: PairedComparison
    objects: tuple[ObjectCounts, ...]
    """All objects: those that the second network gains most on come first, then by name."""


def compare(records: Iterable[GraspRecord], first: str, second: str) -> Comparison:
    """Compare two networks on the same scenes.

    Args:
        records: of `current_records`; grasps that were lost to dead worker processes do not count.
        first: name of a network, as in the column `model`.
        second: the other one's.

    Returns:
        Successes by the paper's rule, McNemar's exact test, and the counts of each object.

    Raises:
        ResultsError: no grasps of such a network, or no scene that both have grasped.
    """
    successes: dict[str, dict[tuple[str, int], bool]] = {}
    for record in records:
        if record.outcome != Outcome.CRASHED:
            successes.setdefault(record.model, {})[record.object, record.pose] = record.success
    for name in (first, second):
        if name not in successes:
            raise ResultsError(f"expected one of the networks {'; '.join(successes) or 'none'}, received {name!r}")
    ours, theirs = successes[first], successes[second]
    scenes = sorted(ours.keys() & theirs.keys())
    if not scenes:
        raise ResultsError(f"expected scenes that both {first!r} and {second!r} have grasped, found none")
    poses = Counter(name for name, _ in scenes)
    counts = [Counter(scene[0] for scene in scenes if one[scene]) for one in (ours, theirs)]
    objects = [ObjectCounts(name, counts[0][name], counts[1][name], number) for name, number in poses.items()]
    return Comparison(
        Rate(counts[0].total(), len(scenes)),
        Rate(counts[1].total(), len(scenes)),
        PairedComparison.of([ours[scene] for scene in scenes], [theirs[scene] for scene in scenes]),
        tuple(sorted(objects, key=lambda item: (item.first - item.second, item.name))),
    )
