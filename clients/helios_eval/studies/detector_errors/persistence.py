"""Persistence of a detector's errors: correlation of outcomes in two images of one object.

An outcome is 0 or 1, for example "reported with a right name". Behind it we assume a standard
normal number: the outcome is 1 where Φ of that number is below the outcome's own probability. The
latent correlation of two images is the one under which their outcomes are likeliest (tetrachoric
correlation, Pearson 1900), given the probability of each outcome.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from helios_eval.studies.detector_errors.sightings import Sightings

GRID = np.linspace(-0.2, 0.98, 60)  # correlations that are tried
MOST_PAIRS = 40_000  # of one relation; more are thinned
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
SAME_DISTANCE, OTHER_DISTANCE = 1.15, 1.25  # ratios: at most, at least
SAME_SIDE_RAD = math.radians(10)
ANGLES_DEG = {"30°": (20, 40), "60°": (50, 70), "90°": (80, 100), "180°": (160, 180)}

RELATIONS = (
    "same view, next frame",
    "same side, other distance",
    *(f"{name} further, same distance" for name in ANGLES_DEG),
    "opposite side, other distance",
    "other object of the class",
)


@dataclass(frozen=True)
class Correlation:
    """Latent correlation with a 95 % interval over homes; NaN without pairs."""

    value: float
    low: float
    high: float
    pairs: int


def expected(seen: Sightings, outcome: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Probability [n] of an outcome by class, visible pixels and distance.

    Logistic regression with a weak ridge (Newton's method): an intercept of each class, and
    piecewise linear terms of the logarithms of pixels and distance.
    """
    _, group = np.unique(seen.class_name, return_inverse=True)
    size, far = np.log(seen.pixels), np.log(seen.distance_m)
    knots = [np.quantile(size, q) for q in (0.25, 0.5, 0.75)]
    columns = [size, far, *(np.clip(size - k, 0, None) for k in knots)]
    shared = np.stack([(c - c.mean()) / max(c.std(), 1e-9) for c in columns], -1)
    X = np.concatenate([np.ones((len(seen), 1)), shared, np.eye(group.max() + 1)[group]], 1)
    ridge = np.full(X.shape[1], 0.5)
    ridge[: 1 + len(columns)] = 1e-3
    beta, y = np.zeros(X.shape[1]), outcome.astype(np.float64)
    for _ in range(30):
        p = 1 / (1 + np.exp(-np.clip(X @ beta, -30, 30)))
        slope = X.T @ (y - p) - ridge * beta
        curve = (X * (p * (1 - p))[:, None]).T @ X + np.diag(ridge)
        step = np.linalg.solve(curve, slope)
        beta += step
        if np.abs(step).max() < 1e-6:
            break
    return 1 / (1 + np.exp(-np.clip(X @ beta, -30, 30)))


def pairs_of(seen: Sightings, seed: int = 0) -> dict[str, NDArray[np.int64]]:
    """Pairs of rows [m, 2] by relation, drawn at random where there are too many."""
    rng = np.random.default_rng(seed)
    found: dict[str, list[NDArray[np.int64]]] = {name: [] for name in RELATIONS}
    for rows in _groups(seen.thing):
        a, b = (rows[side] for side in np.triu_indices(len(rows), 1))
        turn = np.abs((seen.angle_rad[a] - seen.angle_rad[b] + math.pi) % math.tau - math.pi)
        ratio = np.exp(np.abs(np.log(seen.distance_m[a] / seen.distance_m[b])))
        one_view = seen.view[a] == seen.view[b]
        chosen = {
            RELATIONS[0]: one_view,
            RELATIONS[1]: ~one_view & (turn < SAME_SIDE_RAD) & (ratio > OTHER_DISTANCE),
            RELATIONS[-2]: (turn > math.radians(160)) & (ratio > OTHER_DISTANCE),
        }
        for name, (low, high) in ANGLES_DEG.items():
            between = (turn >= math.radians(low)) & (turn <= math.radians(high))
            chosen[f"{name} further, same distance"] = between & (ratio < SAME_DISTANCE)
        for name, mask in chosen.items():
            found[name].append(np.stack([a[mask], b[mask]], -1))
    for rows in _groups(np.unique(seen.class_name, return_inverse=True)[1]):
        a, b = (rng.choice(rows, 8 * len(rows)) for _ in range(2))
        apart = (seen.thing[a] != seen.thing[b]) & (seen.home[a] == seen.home[b])
        found[RELATIONS[-1]].append(np.stack([a[apart], b[apart]], -1))
    out = {name: np.concatenate(parts) for name, parts in found.items()}
    return {
        name: p if len(p) <= MOST_PAIRS else p[rng.permutation(len(p))[:MOST_PAIRS]]
        for name, p in out.items()
    }


def correlations(
    seen: Sightings,
    outcome: NDArray[np.bool_],
    pairs: Mapping[str, NDArray[np.int64]],
    resamples: int = 400,
) -> dict[str, Correlation]:
    """Latent correlation of an outcome [n] by relation."""
    p = np.clip(expected(seen, outcome), 1e-3, 1 - 1e-3)
    return {
        name: latent_correlation(
            outcome[rows[:, 0]],
            outcome[rows[:, 1]],
            p[rows[:, 0]],
            p[rows[:, 1]],
            seen.home[rows[:, 0]],
            resamples,
        )
        for name, rows in pairs.items()
    }


def latent_correlation(
    first: NDArray[np.bool_],
    second: NDArray[np.bool_],
    p_first: NDArray[np.float64],
    p_second: NDArray[np.float64],
    home: NDArray[np.int64],
    resamples: int = 400,
) -> Correlation:
    """Likeliest latent correlation of pairs of outcomes [m] with probabilities [m].

    home: [m] homes are drawn with replacement for the interval.
    """
    if not len(first):
        return Correlation(math.nan, math.nan, math.nan, 0)
    h, k = ndtri(p_first), ndtri(p_second)
    _, group = np.unique(home, return_inverse=True)
    by_home = np.zeros((group.max() + 1, len(GRID)))
    for n, rho in enumerate(GRID):
        both = np.clip(both_below(h, k, rho), 1e-9, 1.0)
        one, other = np.clip(p_first - both, 1e-9, 1.0), np.clip(p_second - both, 1e-9, 1.0)
        neither = np.clip(1 - p_first - p_second + both, 1e-9, 1.0)
        likely = np.where(first, np.where(second, both, one), np.where(second, other, neither))
        by_home[:, n] = np.bincount(group, np.log(likely))
    rng = np.random.default_rng(0)
    weights = rng.multinomial(len(by_home), np.full(len(by_home), 1 / len(by_home)), resamples)
    drawn = GRID[np.argmax(weights @ by_home, 1)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Correlation(
        float(GRID[int(np.argmax(by_home.sum(0)))]), float(low), float(high), len(first)
    )


def both_below(h: NDArray[np.float64], k: NDArray[np.float64], rho: float) -> NDArray[np.float64]:
    """P(X < h and Y < k) [m] of standard normal numbers with correlation `rho`.

    Plackett's identity: the derivative by the correlation is the density at (h, k).
    """
    middle = rho / 2
    out = ndtr(h) * ndtr(k)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        r = middle * (1 + node)
        rest = 1 - r * r
        density = np.exp(-(h * h - 2 * r * h * k + k * k) / (2 * rest))
        out = out + middle * weight * density / (math.tau * math.sqrt(rest))
    return out


def _groups(number: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rows of each number."""
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)
