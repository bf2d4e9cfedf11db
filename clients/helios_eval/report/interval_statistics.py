"""Statistics of the report: numbers in, intervals out. Pure; random draws use a fixed seed.

Pairs are the same seeds run by two agents, so that easy and hard homes cancel out.

No interval, and so no verdict, is drawn from fewer than `MIN_DIFFERING_PAIRS` pairs that differ. A
bootstrap only resamples its input: from one home, or from homes that are all alike, it gives an
interval of zero width. An exact two-sided test of n pairs that differ can be significant at 5 %
only if 2 / 2^n <= 0.05, so n >= 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_eval.calibration import statistics

DRAWS = 10_000
SEED = 20260
MIN_DIFFERING_PAIRS = 6  # smallest n with 2 / 2**n <= 0.05

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Mean:
    """Mean and standard error of the mean; `sem` is NaN for a single value."""

    mean: float
    sem: float
    n: int


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval; an undefined bound is NaN."""

    value: float
    low: float
    high: float

    @property
    def has_bounds(self) -> bool:
        """True if the bounds are defined."""
        return not math.isnan(self.low)

    @property
    def excludes_zero(self) -> bool:
        """True if the bounds are defined and exclude 0."""
        return self.low > 0 or self.high < 0


def mean_sem(values: Values) -> Mean:
    """Mean of [n] values with its standard error (ddof 1). Raises InvalidInput for no values."""
    x = np.asarray(values, dtype=np.float64)
    if x.size == 0:
        raise InvalidInput("no values came; a mean wants at least one")
    sem = float(x.std(ddof=1) / math.sqrt(x.size)) if x.size > 1 else math.nan
    return Mean(float(x.mean()), sem, int(x.size))


def wilson(successes: int, n: int) -> Interval:
    """Wilson's interval of a proportion; the outer bound is exact if all or none succeeded."""
    if not 0 <= successes <= n or n == 0:
        raise InvalidInput(f"{successes} successes of {n} came; wanted 0 <= successes <= n, n > 0")
    low, high = statistics.wilson(np.array(successes), np.array(n))
    return Interval(
        successes / n,
        0.0 if successes == 0 else float(low),  # without rounding error
        1.0 if successes == n else float(high),
    )


def _resampled_sums(columns: Values, draws: int, seed: int) -> Values:
    """Sums of the columns [n, k] over episodes drawn with replacement: [draws, k]."""
    n = len(columns)
    rng = np.random.default_rng(seed)
    out = np.empty((draws, columns.shape[1]))
    step = max(1, 2_000_000 // n)  # limits memory
    for begin in range(0, draws, step):
        rows = rng.integers(0, n, size=(min(step, draws - begin), n))
        out[begin : begin + len(rows)] = columns[rows].sum(axis=1)
    return out


def paired_difference(
    first: Values, second: Values, draws: int = DRAWS, seed: int = SEED
) -> Interval:
    """Mean of first - second over the same episodes [n]; percentile bootstrap over episodes.

    The bounds are NaN where they would mean nothing; see the module.
    """
    a, b = _pair(first, second)
    difference = (a - b)[:, None]
    if why_unbounded(a, b):
        return Interval(float(difference.mean()), math.nan, math.nan)
    means = _resampled_sums(difference, draws, seed)[:, 0] / len(a)
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(float(difference.mean()), float(low), float(high))


def score_difference(first: Values, second: Values) -> Interval:
    """Mean of first - second of binary values over the same episodes [n], with the score interval
    of Newcombe (1998, method 10).

    It has bounds also where few or no episodes differ, and then tells how large a difference they
    leave possible. Raises InvalidInput for other values than 0 and 1.
    """
    a, b = _pair(first, second)
    if not np.isin(np.concatenate([a, b]), (0.0, 1.0)).all():
        raise InvalidInput("a score interval came for values other than 0 and 1")
    n = len(a)
    both, only_a, only_b = ((a * b).sum(), (a * (1 - b)).sum(), ((1 - a) * b).sum())
    neither = n - both - only_a - only_b
    margins = (both + only_a) * (both + only_b) * (only_b + neither) * (only_a + neither)
    product = both * neither - only_a * only_b
    phi = 0.0
    if margins > 0:
        phi = (max(product - n / 2, 0.0) if product > 0 else product) / math.sqrt(margins)
    x, y = wilson(int(a.sum()), n), wilson(int(b.sum()), n)

    def reach(one: float, other: float) -> float:
        return math.sqrt(max(one**2 - 2 * phi * one * other + other**2, 0.0))

    d = x.value - y.value
    low = d - reach(x.value - x.low, y.high - y.value)
    high = d + reach(x.high - x.value, y.value - y.low)
    return Interval(d, low, high)


def paired_ratio(first: Values, second: Values, draws: int = DRAWS, seed: int = SEED) -> Interval:
    """Mean of first over mean of second, the same episodes [n]; percentile bootstrap.

    A draw that divides by zero counts as infinite, so a bound may be infinite; draws of 0/0 are
    left out. All NaN if the ratio itself is 0/0. The bounds are NaN where they would mean nothing;
    see the module.
    """
    a, b = _pair(first, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(a.sum() / b.sum())
        if math.isnan(value) or why_unbounded(a, b):
            return Interval(value, math.nan, math.nan)
        sums = _resampled_sums(np.stack([a, b], axis=1), draws, seed)
        drawn = sums[:, 0] / sums[:, 1]
    drawn = drawn[~np.isnan(drawn)]
    low, high = np.quantile(drawn, [0.025, 0.975], method="inverted_cdf")
    return Interval(value, float(low), float(high))


def json_bounds(i: Interval) -> tuple[float | None, float | None, float | None]:
    """Value and bounds for JSON, which has no NaN and no infinity: None instead."""
    value, low, high = (x if math.isfinite(x) else None for x in (i.value, i.low, i.high))
    return value, low, high


def sign_test(first: Values, second: Values) -> float:
    """Two-sided exact p that neither of two paired samples [n] tends to be larger.

    Equal pairs are ignored. For binary values this is McNemar's exact test.
    """
    a, b = _pair(first, second)
    more, less = int((a > b).sum()), int((a < b).sum())
    n = more + less
    tail = sum(math.comb(n, k) for k in range(min(more, less) + 1))
    return min(1.0, 2 * tail / 2**n)


def why_unbounded(first: Values, second: Values) -> str:
    """Reason why two paired samples [n] have no interval; empty if they have one."""
    a, b = _pair(first, second)
    differ = sum(discordant(a, b))
    if differ >= MIN_DIFFERING_PAIRS:
        return ""
    if a.size < MIN_DIFFERING_PAIRS:
        return "too few homes to tell"
    return "too few homes differ to tell" if differ else "no home differs"


def discordant(first: Values, second: Values) -> tuple[int, int]:
    """Number of episodes in which the first value is larger, and in which the second is."""
    a, b = _pair(first, second)
    return int((a > b).sum()), int((a < b).sum())


def _pair(first: Values, second: Values) -> tuple[Values, Values]:
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1 or a.size == 0:
        raise InvalidInput(
            f"values of shape {a.shape} and {b.shape} came; a pair wants two rows of one length"
        )
    return a, b
