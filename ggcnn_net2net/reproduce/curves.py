"""Curves over the depth of a search: results as CSV, those that ship, and the paper's readings beside them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.reproduce.experiments import EXPERIMENTS, Curve, Experiment
from ggcnn_net2net.reproduce.statistics import Rate

IOU, SIM, SCORE = "IOU", "SIM", "SCORE"
"""Share of all test images with IoU > 0.25; success rate in simulation; what the search saw, on its own images."""

_SHIPPED = resources.files("ggcnn_net2net.reproduce") / "shipped"
_READINGS = "paper_readings.csv"


@dataclass(frozen=True)
class CurvePoint:
    """One value of one network on the path of a search."""

    figure: str
    """Name of the experiment."""
    curve: str
    protocol: str
    metric: str
    """IOU, SIM or SCORE."""
    depth: int
    """Operations from the network that the search started from."""
    value: float
    successes: int | None
    """None, like `trials`, where only the rate is known."""
    trials: int | None
    parameters: int
    architecture: str
    """In the paper's notation."""
    operation: str
    """That led to the network: deeper(3), retrain(8), root."""
    seed: int
    budget: str
    """Of the search, with its limit of parameters and its learning rate where they are not the paper's."""
    objects: str
    """What was grasped, or the test images."""
    network: str
    """What the search started from."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """Wilson 95% interval; None where the counts are not known."""
        if self.successes is None or self.trials is None:
            return None
        return Rate(self.successes, self.trials).interval


COLUMNS = tuple(field.name for field in fields(CurvePoint))


@dataclass(frozen=True)
class CurveResult:
    """A curve in one protocol: ours, and what the paper reports."""

    curve: Curve
    protocol: str
    points: tuple[CurvePoint, ...]
    """None for a curve that was not run yet."""
    paper: dict[tuple[str, int], float]
    """The paper's readings by metric and depth; none for a curve that it does not show."""

    def at(self, metric: str) -> list[CurvePoint]:
        """Points of one metric, by depth."""
        return sorted((point for point in self.points if point.metric == metric), key=lambda point: point.depth)

    def drawn(self, metric: str) -> list[CurvePoint]:
        """Points of a panel: where nobody computed the IoU rate over all test images, what the search saw of it."""
        return self.at(metric) or (self.at(SCORE) if metric == IOU else [])

    def paper_at(self, metric: str) -> list[tuple[int, float]]:
        """The paper's depths and values of one metric."""
        return sorted((depth, value) for (name, depth), value in self.paper.items() if name == metric)


def shipped_points() -> list[CurvePoint]:
    """All results that ship with the package; none as long as nothing does."""
    files = [_SHIPPED / f"{name}.csv" for name in EXPERIMENTS]
    return [point for file in files if file.is_file() for point in read_points(file)]


def paper_readings() -> dict[tuple[str, str], dict[tuple[str, int], float]]:
    """Figs. 2 and 3 read off the plots: by figure and curve, then by metric and depth."""
    readings: dict[tuple[str, str], dict[tuple[str, int], float]] = {}
    with (_SHIPPED / _READINGS).open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            curve = readings.setdefault((row["figure"], row["curve"]), {})
            curve[row["metric"], int(row["depth"])] = float(row["value"])
    return readings


def results_of(experiment: Experiment, points: Sequence[CurvePoint]) -> list[CurveResult]:
    """What is known of an experiment.

    Args:
        experiment: which curves.
        points: results, also of other experiments: a curve of the same name is the same search, so it need not be run
            twice. The experiment's own come first.

    Returns:
        A result for each of its protocols, and any other that it was run in, and each curve.
    """
    names = {curve.name for curve in experiment.curves}
    ours = {point.protocol for point in points if point.figure == experiment.name and point.curve in names}
    protocols = [protocol.name for protocol in experiment.protocols]
    protocols += sorted(ours - set(protocols))
    papers = {curve: values for (_, curve), values in paper_readings().items()}
    return [
        CurveResult(curve, protocol, _points_of(experiment, curve, protocol, points), papers.get(curve.name, {}))
        for protocol in protocols
        for curve in experiment.curves
    ]


def _points_of(
    experiment: Experiment, curve: Curve, protocol: str, points: Sequence[CurvePoint]
) -> tuple[CurvePoint, ...]:
    found = [point for point in points if (point.curve, point.protocol) == (curve.name, protocol)]
    figures = sorted({point.figure for point in found}, key=lambda figure: (figure != experiment.name, figure))
    return tuple(point for point in found if point.figure in figures[:1])


def read_points(path: Path | Traversable) -> list[CurvePoint]:
    """Results from a CSV file.

    Args:
        path: a results.csv, as `write_points` writes it.

    Returns:
        Its points in order.

    Raises:
        ResultsError: other columns, or values that cannot be read.
    """
    try:
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
        if not rows or tuple(rows[0]) != COLUMNS:
            raise ResultsError(
                f"expected the columns {', '.join(COLUMNS)} in {path}, received "
                f"{', '.join(rows[0]) if rows else 'none'}: it was written by something else; choose another --output"
            )
        return [_parse(row) for row in rows[1:]]
    except ValueError as error:
        raise ResultsError(f"cannot read {path}: {error}; remove it and run the experiment again") from error


def write_points(path: Path, points: Iterable[CurvePoint]) -> None:
    """Write results, sorted, to a CSV file."""
    order = sorted(points, key=lambda point: (point.figure, point.protocol, point.curve, point.metric, point.depth))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(["" if value is None else value for value in vars(point).values()] for point in order)
    write_text(path, text.getvalue())


def _parse(row: Sequence[str]) -> CurvePoint:
    values: dict[str, Any] = dict(zip(COLUMNS, row, strict=True))
    for name in ("depth", "parameters", "seed"):
        values[name] = int(values[name])
    for name in ("successes", "trials"):
        values[name] = int(values[name]) if values[name] else None
    return CurvePoint(**{**values, "value": float(values["value"])})
