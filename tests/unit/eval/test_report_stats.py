"""Tests the statistics of the report against known values and by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_eval.calibration import statistics
from helios_eval.report.interval_statistics import (
    MIN_DIFFERING_PAIRS,
    discordant,
    mean_sem,
    paired_difference,
    paired_ratio,
    sign_test,
    why_unbounded,
    wilson,
)
from hypothesis import given
from hypothesis import strategies as st

POLITICS = np.array([1.0] * 7 + [0.0] * 3)


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [  # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_interval_has_the_published_bounds(successes, n, low, high):
    found = wilson(successes, n)
    assert found.value == successes / n
    assert found.low == pytest.approx(low, abs=5e-5)
    assert found.high == pytest.approx(high, abs=5e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_wilson_interval_contains_its_share_and_is_symmetric(case):
    k, n = case
    found, mirrored = wilson(k, n), wilson(n - k, n)
    assert 0 <= found.low <= found.value <= found.high <= 1
    assert found.low == pytest.approx(1 - mirrored.high, abs=1e-12)


def test_the_scalar_wilson_interval_equals_the_vectorised_one():
    """Equal to the last bit; if all or none succeeded, the bound is exact."""
    for n in (1, 7, 60, 1199):
        successes = np.arange(n + 1)
        low, high = statistics.wilson(successes, np.full(n + 1, n))
        low[0], high[n] = 0.0, 1.0
        found = [wilson(int(k), n) for k in successes]
        assert [(i.low, i.high) for i in found] == list(zip(low, high, strict=True))


def test_mean_and_standard_error_match_the_textbook_formula():
    found = mean_sem(np.array([2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]))
    assert found.mean == 5
    assert found.sem == pytest.approx(math.sqrt(32 / 7 / 8))
    assert math.isnan(mean_sem(np.array([1.0])).sem)


def test_the_standard_error_of_a_share_matches_the_paper():
    share = np.zeros(1199)
    share[:507] = 1  # FindObj of HELIOS, Table 1: 42.3 ± 1.4
    found = mean_sem(share)
    assert (round(100 * found.mean, 1), round(100 * found.sem, 1)) == (42.3, 1.4)


def test_the_sign_test_matches_the_published_exact_mcnemar_p():
    # Fagerland, Lydersen and Laake, BMC Med. Res. Methodol. 13:91 (2013): 1 and 7 discordant
    first = np.array([1.0] * 7 + [0.0] * 1 + [1.0] * 12 + [0.0])
    second = np.array([0.0] * 7 + [1.0] * 1 + [1.0] * 12 + [0.0])
    assert sign_test(first, second) == pytest.approx(0.0703, abs=5e-5)
    assert discordant(first, second) == (7, 1)
    assert sign_test(second, first) == sign_test(first, second)


# --- where nothing can be told ----------------------------------------------------------------
@pytest.mark.parametrize(
    ("homes", "differ", "why"),
    [
        (1, 0, "too few homes to tell"),
        (1, 1, "too few homes to tell"),
        (5, 5, "too few homes to tell"),
        (6, 5, "too few homes differ to tell"),
        (6, 6, ""),
        (500, 0, "no home differs"),
        (500, 5, "too few homes differ to tell"),
        (500, 6, ""),
    ],
)
def test_an_interval_needs_six_differing_homes(homes, differ, why):
    first = np.ones(homes)
    second = first - (np.arange(homes) < differ)
    assert why_unbounded(first, second) == why
    for found in (
        paired_difference(first, second),
        paired_ratio(first, second),
    ):
        assert found.has_bounds == (why == "")
        assert found.has_bounds or not found.excludes_zero
    assert paired_difference(first, second).value == pytest.approx(differ / homes)


def test_the_minimum_of_differing_homes_is_the_least_for_a_significant_exact_test():
    def p_of_unanimous(homes: int) -> float:
        return sign_test(np.ones(homes), np.zeros(homes))

    assert p_of_unanimous(MIN_DIFFERING_PAIRS) <= 0.05 < p_of_unanimous(MIN_DIFFERING_PAIRS - 1)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=40))
def test_an_interval_that_excludes_zero_has_enough_differing_pairs(pairs):
    first, second = np.array(pairs, dtype=np.float64).T
    found = paired_difference(first, second, draws=200)
    if found.excludes_zero:
        assert sum(discordant(first, second)) >= MIN_DIFFERING_PAIRS
        assert found.high > found.low or sign_test(first, second) <= 0.05


def test_equal_samples_have_p_1():
    assert sign_test(POLITICS, POLITICS) == 1
    assert paired_difference(POLITICS, POLITICS).value == 0


def test_the_paired_bootstrap_covers_the_truth_at_its_nominal_rate():
    """Correlated binary pairs with a true difference of 0.2 and a true ratio of 1.5, n = 100."""
    rng = np.random.default_rng(7)
    differences = ratios = 0
    repeats = 400
    for i in range(repeats):
        hard = rng.random(100)
        second = (hard < 0.4).astype(np.float64)
        first = np.where(rng.random(100) < 0.7, hard < 0.6, rng.random(100) < 0.6)
        d = paired_difference(first.astype(np.float64), second, draws=400, seed=i)
        r = paired_ratio(first.astype(np.float64), second, draws=400, seed=i)
        differences += d.low <= 0.2 <= d.high
        ratios += r.low <= 1.5 <= r.high
    assert 0.91 <= differences / repeats <= 0.98  # 0.95 within sampling and bootstrap error
    assert 0.91 <= ratios / repeats <= 0.98


def test_pairing_narrows_the_interval_when_homes_differ():
    rng = np.random.default_rng(1)
    home = rng.normal(0, 10, 200)
    first, second = home + rng.normal(1, 1, 200), home + rng.normal(0, 1, 200)
    paired = paired_difference(first, second)
    shuffled = paired_difference(first, rng.permutation(second))
    assert paired.low > 0
    assert paired.high - paired.low < (shuffled.high - shuffled.low) / 5


def test_the_same_seed_gives_the_same_interval():
    a, b = np.random.default_rng(3).random((2, 50))
    assert paired_ratio(a, b) == paired_ratio(a, b)
    assert paired_ratio(a, b, seed=1) != paired_ratio(a, b, seed=2)


def test_a_bound_that_divides_by_zero_is_infinite():
    once = np.array([1.0] + [0.0] * 9)
    found = paired_ratio(POLITICS, once)  # six homes differ
    assert found.value == 7
    assert math.isfinite(found.low)
    assert found.high == math.inf
    assert paired_ratio(POLITICS, np.zeros(10)).value == math.inf
    assert math.isnan(paired_ratio(np.zeros(10), np.zeros(10)).value)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: wilson(3, 2),
        lambda: wilson(0, 0),
        lambda: mean_sem(np.array([])),
        lambda: sign_test(np.ones(3), np.ones(4)),
        lambda: paired_ratio(np.ones(0), np.ones(0)),
    ],
)
def test_invalid_samples_are_refused(wrong):
    with pytest.raises(InvalidInput, match="want"):
        wrong()
