"""One CSV row a grasp: written as the trials come in, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.simulation.object_sets import ObjectModel
from ggcnn_net2net.simulation.trial import Outcome, TrialResult


@dataclass(frozen=True)
class GraspRecord:
    """A grasp trial. Pixels in the 300x300 image, angles in radians, lengths in metres; None where there is none."""

    model: str
    weights: str
    """First 16 hex digits of the SHA-256 of the weights file."""
    object: str
    category: str
    pose: int
    outcome: str
    success: bool
    in_bin: bool
    distance: float
    row: float | None
    col: float | None
    angle: float | None
    width_px: float | None
    quality: float | None
    x: float | None
    y: float | None
    z: float | None
    opening: float | None
    steps: int

    @property
    def key(self) -> tuple[str, str, int]:
        """Weights, object, pose: unique within a results folder."""
        return self.weights, self.object, self.pose

    @property
    def grasp(self) -> Grasp | None:
        """The predicted grasp; None where the network found none."""
        if None in (values := (self.row, self.col, self.angle, self.width_px, self.quality)):
            return None
        return Grasp(*values)  # type: ignore[arg-type]

    @classmethod
    def of(
        cls, model: str, weights: str, item: ObjectModel, pose: int, grasp: Grasp | None, result: TrialResult
    ) -> GraspRecord:
        """Record of one trial."""
        place = result.grasp
        return cls(
            model=model,
            weights=weights,
            object=item.name,
            category=item.category,
            pose=pose,
            outcome=result.outcome.value,
            success=result.success,
            in_bin=result.in_bin,
            distance=result.distance,
            row=grasp.row if grasp else None,
            col=grasp.col if grasp else None,
            angle=grasp.angle if grasp else None,
            width_px=grasp.width_px if grasp else None,
            quality=grasp.quality if grasp else None,
            x=place.point[0] if place else None,
            y=place.point[1] if place else None,
            z=place.point[2] if place else None,
            opening=place.opening if place else None,
            steps=result.steps,
        )

    @classmethod
    def lost(cls, model: str, weights: str, item: ObjectModel, pose: int) -> GraspRecord:
        """Record of a trial for which there is no scene, because the worker that made it died."""
        return cls.of(model, weights, item, pose, None, TrialResult(Outcome.CRASHED, False, False, float("nan"), 0))


COLUMNS = tuple(field.name for field in fields(GraspRecord))
_BOOLEANS = {"True": True, "False": False}


class RecordFile:
    """The CSV of a results folder. A torn last line, from a run that was killed, is ignored and written again."""

    def __init__(self, path: Path) -> None:
        """Name the file, which need not exist.

        Args:
            path: the CSV.
        """
        self.path = path

    def read(self) -> list[GraspRecord]:
        """All complete records; an empty list where there is no file.

        Returns:
            The records in the order in which they were written.

        Raises:
            ResultsError: other columns, or values that cannot be read before the last line.
        """
        if not self.path.is_file():
            return []
        content = self.path.read_bytes()
        try:
            whole = content[: content.rfind(b"\n") + 1].decode("utf-8")
            rows = list(csv.reader(io.StringIO(whole, newline="")))
            if not rows:
                return []
            if tuple(rows[0]) != COLUMNS:
                raise ResultsError(
                    f"expected the columns {', '.join(COLUMNS)} in {self.path}, received {', '.join(rows[0])}: it was "
                    "written by another version; choose another output folder"
                )
            return [_parse(row) for row in rows[1:]]
        except (ValueError, KeyError) as error:
            raise ResultsError(
                f"cannot read {self.path}: {error!r}; remove the file, and its grasps run again"
            ) from error

    def rewrite(self, records: Iterable[GraspRecord]) -> None:
        """Replace the file by these records, whole or not at all."""
        write_text(self.path, _format([COLUMNS, *(_values(record) for record in records)]))

    def append(self, record: GraspRecord) -> None:
        """Add one record and make sure that it is on the disk."""
        with self.path.open("a", encoding="utf-8", newline="") as stream:
            stream.write(_format([_values(record)]))
            stream.flush()
            os.fsync(stream.fileno())


def _values(record: GraspRecord) -> list[Any]:
    return ["" if value is None else value for value in asdict(record).values()]


def _format(rows: Iterable[Iterable[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _parse(row: list[str]) -> GraspRecord:
    texts = dict(zip(COLUMNS, row, strict=True))
    values: dict[str, Any] = {}
    for field in fields(GraspRecord):
        text = texts[field.name]
        if field.type == "str":
            values[field.name] = text
        elif field.type == "bool":
            values[field.name] = _BOOLEANS[text]
        elif field.type == "int":
            values[field.name] = int(text)
        else:
            values[field.name] = float(text) if text else None
    return GraspRecord(**values)
