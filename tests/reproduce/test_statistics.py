import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.reproduce.statistics import PairedComparison, Rate


def test_wilson_interval_of_the_papers_original():
    """157 of 200, by the textbook formula."""
    n, p, z = 200, 157 / 200, 1.959964
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert Rate(157, 200).value == 0.785
    assert Rate(157, 200).interval == pytest.approx((middle - half, middle + half), abs=1e-6)


def test_rate_without_trials():
    assert math.isnan(Rate(0, 0).value)
    assert Rate(0, 0).interval == (0.0, 1.0)


@given(st.integers(1, 300).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_interval_holds_the_rate(counts):
    low, high = Rate(*counts).interval
    assert -1e-12 <= low <= Rate(*counts).value <= high <= 1 + 1e-12


def test_mcnemar_by_hand():
    """1 against 6 disagreements: 2 * (1 + 7) / 2^7."""
    first = [True] * 10 + [True] + [False] * 6
    second = [True] * 10 + [False] + [True] * 6
    comparison = PairedComparison.of(first, second)
    assert (comparison.only_first, comparison.only_second) == (1, 6)
    assert comparison.p_value == pytest.approx(2 * (1 + 7) / 2**7)


def test_equal_networks_do_not_differ():
    assert PairedComparison.of([True, False], [True, False]).p_value == 1.0


def test_pairs_have_to_match():
    with pytest.raises(ValueError, match="shorter"):
        PairedComparison.of([True], [])
