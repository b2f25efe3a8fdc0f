"""What the paper reports, to stand beside what we measure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperRow:
    """A row of Table I."""

    accuracy: float
    """Success rate over 200 grasps (40 ShapeNetSem objects x 5 poses)."""
    parameters: int


TABLE1 = {
    "original": PaperRow(0.785, 62_420),
    "extended": PaperRow(0.835, 67_644),
    "optimized": PaperRow(0.715, 16_104),
}
