"""The score interval of a paired difference has a width even where hardly any home differs."""

from __future__ import annotations

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_eval.report.interval_statistics import paired_difference, score_difference
from hypothesis import given
from hypothesis import strategies as st

PAIRS = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60)


def columns(pairs: list[tuple[bool, bool]]) -> tuple[np.ndarray, np.ndarray]:
    a, b = np.array(pairs, float).T
    return a, b


def test_a_run_without_a_difference_still_says_how_large_one_may_be() -> None:
    same = np.array([1.0] * 19 + [0.0] * 81)
    d = score_difference(same, same)
    assert d.value == 0
    assert -0.05 < d.low < -0.005
    assert d.high == pytest.approx(-d.low)
    assert not paired_difference(same, same).has_bounds


@given(PAIRS)
def test_the_interval_holds_the_difference_and_turns_with_the_order(pairs) -> None:
    a, b = columns(pairs)
    d, turned = score_difference(a, b), score_difference(b, a)
    assert d.value == pytest.approx(a.mean() - b.mean())
    assert -1 - 1e-9 <= d.low <= d.value <= d.high <= 1 + 1e-9
    assert (turned.low, turned.high) == (pytest.approx(-d.high), pytest.approx(-d.low))


def test_19_of_20_intervals_hold_the_true_difference() -> None:
    rng = np.random.default_rng(5)
    cells = rng.choice(4, p=[0.6, 0.08, 0.05, 0.27], size=(2000, 100))  # both, first, second, none
    held = 0
    for row in cells:
        d = score_difference((row <= 1).astype(float), np.isin(row, (0, 2)).astype(float))
        held += d.low <= 0.03 <= d.high
    assert 0.93 < held / len(cells) < 0.98


def test_other_values_are_refused() -> None:
    with pytest.raises(InvalidInput, match="other than 0 and 1"):
        score_difference(np.array([0.5]), np.array([1.0]))
