"""Uncertainty of success rates, and whether two networks differ on the same scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import binomtest


@dataclass(frozen=True)
class Rate:
    """k successes of n, with the Wilson 95% interval."""

    successes: int
    trials: int

    @property
    def value(self) -> float:
        """Success rate; NaN without trials."""
        return self.successes / self.trials if self.trials else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson 95% interval (0 to 1 without trials)."""
        if not self.trials:
            return 0.0, 1.0
        bounds = binomtest(self.successes, self.trials).proportion_ci(0.95, method="wilson")
        return float(bounds.low), float(bounds.high)


@dataclass(frozen=True)
class PairedComparison:
    """Two networks on the same scenes: McNemar's exact test."""

    only_first: int
    """Scenes on which only the first succeeds."""
    only_second: int
    """Scenes on which only the second succeeds."""

    @classmethod
    def of(cls, first: Sequence[bool], second: Sequence[bool]) -> PairedComparison:
        """Compare success on n scenes, pairwise in order."""
        pairs = list(zip(first, second, strict=True))
        return cls(sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs))

    @property
    def p_value(self) -> float:
        """Two-sided exact probability of a split at least this uneven if neither network is better."""
        disagreements = self.only_first + self.only_second
        return float(binomtest(self.only_first, disagreements).pvalue) if disagreements else 1.0
