"""Figures of a detector's errors from its sightings: rates, scores, persistence, wrong names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from helios_eval.studies.detector_errors.persistence import (
    RELATIONS,
    Correlation,
    correlations,
    pairs_of,
)
from helios_eval.studies.detector_errors.sightings import COUNTED, FalseAlarms, Sightings

PIXELS = (60, 150, 400, 1000, 3000, 10_000, 40_000, 400_000)  # borders of the bands
DISTANCES_M = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
RESAMPLES = 1000  # of the homes, for intervals
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
LEAST_SCORE = 0.1  # scores below are left out of the quantiles
LEAST_PAIRS = 50  # a share or correlation of fewer is not given
LEAST_OF_CLASS = 30  # sightings of a class for its own rate


@dataclass(frozen=True)
class Rates:
    """Shares of sightings of one band: a right name; only a wrong one; none. n of them.

    right_low, right_high: 95 % interval of `right` over homes.
    """

    right: float
    wrong: float
    none: float
    n: int
    right_low: float
    right_high: float


@dataclass(frozen=True)
class Summary:
    """Figures of one detector on unobstructed objects."""

    sightings: int
    all: Rates
    obstructed: Rates
    by_pixels: tuple[Rates, ...]
    by_distance: tuple[Rates, ...]
    wrong_per_name: float  # probability that one wrong name that is asked for is reported
    wrong_with_right: float  # share with a wrong name among sightings with a right one
    right_scores: tuple[float, ...]  # at QUANTILES
    wrong_scores: tuple[float, ...]
    alarm_scores: tuple[float, ...]
    alarms: float  # false alarms per image
    alarms_per_name: float  # per image and name that is asked for
    alarms_by_pixels: tuple[float, ...]  # per 100 images, by the box, in the bands of PIXELS
    alarms_by_distance: tuple[float, ...]  # the same in the bands of DISTANCES_M
    alarm_names: tuple[tuple[str, int], ...]  # most frequent first
    right_persists: Mapping[str, Correlation]
    wrong_persists: Mapping[str, Correlation]
    same_wrong_name: Mapping[str, float]  # by relation, among pairs with a wrong name each
    score_persists: Mapping[str, float]  # rank correlation of right scores by relation
    scores_together: float  # rank correlation of right and best wrong score of one sighting
    wrong_by_class: Mapping[str, float]  # share of sightings with a wrong name


def summary(seen: Sightings, alarms: FalseAlarms) -> Summary:
    """Figures of a detector's sightings and false alarms."""
    clear = seen.part(seen.unobstructed)
    right, wrong = clear.right >= COUNTED, clear.wrong >= COUNTED
    pairs = pairs_of(clear)
    hidden = seen.part(~seen.unobstructed)
    counted = alarms.score >= COUNTED
    names, counts = np.unique(alarms.name[counted], return_counts=True)
    order = np.argsort(-counts, kind="stable")[:5]
    both = (clear.right >= LEAST_SCORE) & (clear.wrong >= LEAST_SCORE)
    return Summary(
        sightings=len(clear),
        all=rates_of(right, wrong, clear.home),
        obstructed=rates_of(hidden.right >= COUNTED, hidden.wrong >= COUNTED, hidden.home),
        by_pixels=_by_band(clear, clear.pixels, PIXELS),
        by_distance=_by_band(clear, clear.distance_m, DISTANCES_M),
        wrong_per_name=float(clear.wrong_names.sum() / max(1, len(clear) * (alarms.asked - 1))),
        wrong_with_right=_share(wrong[right]),
        right_scores=quantiles(clear.right),
        wrong_scores=quantiles(clear.wrong),
        alarm_scores=quantiles(alarms.score),
        alarms=float(counted.sum() / max(1, alarms.images)),
        alarms_per_name=float(counted.sum() / max(1, alarms.images * alarms.asked)),
        alarms_by_pixels=_per_100(alarms.box_px[counted], PIXELS, alarms.images),
        alarms_by_distance=_per_100(alarms.distance_m[counted], DISTANCES_M, alarms.images),
        alarm_names=tuple((str(names[k]), int(counts[k])) for k in order),
        right_persists=correlations(clear, right, pairs),
        wrong_persists=correlations(clear, wrong, pairs),
        same_wrong_name={name: _same_name(clear, wrong, pairs[name]) for name in RELATIONS},
        score_persists={name: _score_pairs(clear, right, pairs[name]) for name in RELATIONS},
        scores_together=_rank_correlation(clear.right[both], clear.wrong[both]),
        wrong_by_class=_by_class(clear, wrong),
    )


def rates_of(right: NDArray[np.bool_], wrong: NDArray[np.bool_], home: NDArray[np.int64]) -> Rates:
    """Shares of sightings [n] with a right name, and with a wrong one.

    home: [n] homes are drawn with replacement for the interval.
    """
    low, high = _interval_over_homes(right, home)
    none = _share(~wrong & ~right)
    return Rates(_share(right), _share(wrong & ~right), none, len(right), low, high)


def _by_band(
    seen: Sightings, values: NDArray[np.float64], borders: tuple[float, ...]
) -> tuple[Rates, ...]:
    """Rates of the sightings with a value [n] between two borders each."""
    band = np.searchsorted(borders, values, "right") - 1
    parts = (seen.part(band == k) for k in range(len(borders) - 1))
    return tuple(rates_of(p.right >= COUNTED, p.wrong >= COUNTED, p.home) for p in parts)


def _interval_over_homes(mask: NDArray[np.bool_], home: NDArray[np.int64]) -> tuple[float, float]:
    if not len(mask):
        return math.nan, math.nan
    _, group = np.unique(home, return_inverse=True)
    total = np.bincount(group)
    rng = np.random.default_rng(0)
    weights = rng.multinomial(len(total), np.full(len(total), 1 / len(total)), RESAMPLES)
    shares = (weights @ np.bincount(group, mask)) / (weights @ total)
    low, high = np.quantile(shares, [0.025, 0.975])
    return float(low), float(high)


def _share(mask: NDArray[np.bool_]) -> float:
    return float(mask.mean()) if len(mask) else math.nan


def _per_100(
    values: NDArray[np.float64], borders: tuple[float, ...], images: int
) -> tuple[float, ...]:
    """Number of values between two borders each, per 100 images."""
    counts, _ = np.histogram(values[np.isfinite(values)], borders)
    return tuple(float(100 * count / max(1, images)) for count in counts)


def quantiles(scores: NDArray[np.float64]) -> tuple[float, ...]:
    """Scores from LEAST_SCORE on, at QUANTILES; NaN without any."""
    kept = scores[scores >= LEAST_SCORE]
    if not len(kept):
        return (math.nan,) * len(QUANTILES)
    return tuple(float(q) for q in np.quantile(kept, QUANTILES))


def _same_name(seen: Sightings, wrong: NDArray[np.bool_], pairs: NDArray[np.int64]) -> float:
    """Share of pairs with the same wrong name among pairs with a wrong name in each image."""
    a, b = pairs.T
    both = wrong[a] & wrong[b]
    if both.sum() < LEAST_PAIRS:
        return math.nan
    return _share(seen.wrong_name[a[both]] == seen.wrong_name[b[both]])


def _score_pairs(seen: Sightings, right: NDArray[np.bool_], pairs: NDArray[np.int64]) -> float:
    """Rank correlation of the scores of right names, less the mean of the class."""
    _, group = np.unique(seen.class_name, return_inverse=True)
    mean = np.bincount(group, seen.right * right) / np.maximum(np.bincount(group, right), 1)
    rest = seen.right - mean[group]
    a, b = pairs.T
    both = right[a] & right[b]
    return _rank_correlation(rest[a[both]], rest[b[both]])


def _rank_correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    if len(a) < LEAST_PAIRS or np.ptp(a) == 0 or np.ptp(b) == 0:
        return math.nan
    return float(np.corrcoef(rankdata(a), rankdata(b))[0, 1])


def _by_class(seen: Sightings, wrong: NDArray[np.bool_]) -> dict[str, float]:
    names = np.unique(seen.class_name)
    rows = {str(name): seen.class_name == name for name in names}
    return {
        name: float(wrong[mask].mean())
        for name, mask in rows.items()
        if mask.sum() >= LEAST_OF_CLASS
    }
