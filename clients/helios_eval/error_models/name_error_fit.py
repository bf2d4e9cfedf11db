"""Fit of the errors of a detector's names: counts in, parameters with intervals out.

A thing has W sides (the sum of their weights) and got names; name n was given from k_n of them. Of
all names that it got, one is right, or none is. In a view that names the thing, the right name is
given with chance h (`hit`), each other one of those names with chance q (`mistaken`). Errors of two
sides of a thing correlate by ρ (`sides_correlate`), so k is beta-binomial:

    BB(k; μ) = B(k + a, W − k + b) / B(a, b),   a = μ (1 − ρ) / ρ,   b = (1 − μ) (1 − ρ) / ρ
    p(thing, name n is right)  = (1 − ν) / N · BB(k_n; h) · Π over m ≠ n of BB(k_m; q)
    p(thing, no name is right) = ν · Π over all m of BB(k_m; q)

Where the right name is known, the fit takes that term; else their sum (EM: the expected share of
each term, then the parameters under these shares, and again). Weak normal priors on the log-odds
hold what the data cannot tell. An error that is the same from all sides looks like the truth, so
without truth they decide how often that happens.

`rival` belongs to the map's rule (`NameRates.probability`) and not to this model. Given the others
it is the one under which the rule's probabilities are likeliest, with the same shares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from helios_objectmap.instances.name_sightings import NameErrors
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar
from scipy.special import betaln, expit, logit

from helios_eval.error_models.named_things import NamedThing

NONE, UNKNOWN = -1, -2  # of `NameCounts.right`
LEAST_RATE = 0.15  # names given less often make no instance of the map (`named_from`)
# Normal priors: log-odds of hit, mistaken, sides_correlate and none; logarithm of rival.
PRIOR = np.array([logit(0.8), logit(0.15), logit(0.2), logit(0.1), np.log(0.1)])
PRIOR_SD = np.array([1.0, 1.0, 1.0, 1.0, 1.5])
LIMIT = 12.0  # of a log-odds
MOST_STEPS = 200
M_STEP = 4  # iterations in which a step raises the expected likelihood; more gain little
DIFFERENCE = 1e-3  # of log-odds, for slopes
STEP = 1e-6  # relative gain of a step at which EM ends

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NameCounts:
    """Names of n things; rows have as many names as the thing with the most."""

    given: Array  # [n, names] number of sides (by weight) from which the name was given
    listed: NDArray[np.bool_]  # [n, names] False: no name
    sides: Array  # [n] sum of the weights of the sides
    right: NDArray[np.int64]  # [n] index of the right name, NONE of them, or UNKNOWN
    scene: NDArray[np.int64]  # [n]

    def __len__(self) -> int:
        return len(self.sides)

    def without_truth(self) -> NameCounts:
        return replace(self, right=np.full(len(self), UNKNOWN))

    def part(self, rows: NDArray) -> NameCounts:
        """These rows only."""
        return NameCounts(*(getattr(self, f.name)[rows] for f in fields(self)))

    @cached_property
    def pairs(self) -> tuple[Array, Array, NDArray[np.int64]]:
        """Distinct pairs of k and W, each [m], and the index [n, names] of each entry's pair."""
        W = np.broadcast_to(self.sides[:, None], self.given.shape)
        flat = np.stack([self.given.ravel(), W.ravel()], -1).round(6)
        found, index = np.unique(flat, axis=0, return_inverse=True)
        return found[:, 0], found[:, 1], index.reshape(self.given.shape)


@dataclass(frozen=True)
class NameFit:
    """Parameters, and the log-likelihood of each step with the log of the prior."""

    errors: NameErrors
    none: float  # share of things whose right name was never given
    steps: tuple[float, ...]


def counts_of(things: Sequence[NamedThing]) -> NameCounts:
    """Counts of things. Of several right names the one given most often counts."""
    most = max((len(t.rates.names) for t in things), default=0)
    given, listed = np.zeros((len(things), most)), np.zeros((len(things), most), bool)
    right = np.full(len(things), UNKNOWN)
    for row, thing in enumerate(things):
        r = thing.rates
        sums = r.weight @ r.rate
        given[row, : len(sums)], listed[row, : len(sums)] = sums, True
        if thing.right is not None:
            known = [k for k, name in enumerate(r.names) if name in thing.right]
            right[row] = max(known, key=lambda k: sums[k], default=NONE)
    sides = np.array([t.rates.weight.sum() for t in things])
    return NameCounts(given, listed, sides, right, np.array([t.scene for t in things], np.int64))


def fitted(
    counts: NameCounts,
    weight: Array | None = None,
    start: Array | None = None,
    prior: Array = PRIOR,
) -> NameFit:
    """Likeliest parameters under the priors.

    weight: [n] of each thing, 1 without; start: [4] log-odds; prior: [5] means of the priors.
    """
    weight = np.ones(len(counts)) if weight is None else weight
    theta = prior[:4].copy() if start is None else start
    steps: list[float] = []
    for _ in range(MOST_STEPS):
        terms = _terms(counts, theta)
        steps.append(float(weight @ _total(counts, terms)) + _log_prior(theta, prior))
        if len(steps) > 1 and steps[-1] - steps[-2] < STEP * abs(steps[-2]):
            break
        theta = _improved(counts, weight, shares(counts, theta), theta, prior)
    hit, mistaken, correlate, none = expit(theta).tolist()
    errors = NameErrors(hit, mistaken, correlate, 1.0)
    rival = _rival(counts, weight, shares(counts, theta), errors, prior[4])
    return NameFit(replace(errors, rival=rival), none, tuple(steps))


def theta_of(fit: NameFit) -> Array:
    """Log-odds of the parameters, as a start of another fit."""
    e = fit.errors
    return np.clip(logit([e.hit, e.mistaken, e.sides_correlate, fit.none]), -LIMIT, LIMIT)


def covariance(counts: NameCounts, fit: NameFit, unit: NDArray[np.int64]) -> Array:
    """Covariance [5, 5] of the parameters on the scales of `PRIOR`.

    unit: [n] things of one unit depend on one another. This is the sandwich estimate for the
    equations that the fit solves; the priors count as one more unit. So the variance of a parameter
    of which the things say nothing is that of its prior.
    """
    at = np.array([*theta_of(fit), np.log(fit.errors.rival)])
    slope = np.stack([
        (_equations(counts, at + d).sum(axis=0) - _equations(counts, at - d).sum(axis=0))
        / (2 * DIFFERENCE)
        for d in DIFFERENCE * np.eye(len(at))
    ], -1)  # fmt: skip
    by_unit = np.zeros((int(unit.max()) + 1, len(at)))
    np.add.at(by_unit, unit, _equations(counts, at))
    prior = np.diag(1 / PRIOR_SD**2)
    inverse = np.linalg.inv(slope - prior)
    small = len(by_unit) / max(len(by_unit) - 1, 1)
    return inverse @ (small * by_unit.T @ by_unit + prior) @ inverse.T


def shares(counts: NameCounts, theta: Array) -> Array:
    """Probability [n, names + 1] that a name is right; last: none is. Known truth is 0 or 1."""
    terms = _terms(counts, theta)
    out = np.exp(terms - _total(counts, terms)[:, None])
    known = counts.right != UNKNOWN
    out[known] = np.eye(terms.shape[1])[counts.right[known]]  # NONE is the last one
    return out


def drawn(fit: NameFit, counts: NameCounts, sides: Array, names: int, seed: int) -> NameCounts:
    """Counts of things drawn from the model. sides: [n] whole numbers; names: of each thing."""
    rng, e = np.random.default_rng(seed), fit.errors
    n = len(sides)
    right = np.where(rng.random(n) < fit.none, NONE, rng.integers(0, names, n))
    mean = np.full((n, names), e.mistaken)
    mean[right >= 0, right[right >= 0]] = e.hit
    spread = (1 - e.sides_correlate) / e.sides_correlate
    chance = rng.beta(mean * spread, (1 - mean) * spread)
    given = rng.binomial(sides.astype(int)[:, None], chance).astype(float)
    return NameCounts(given, np.ones((n, names), bool), sides, right, np.arange(n))


def probabilities(counts: NameCounts, errors: NameErrors) -> Array:
    """`NameRates.probability` [n, names] of each name, for all things at once."""
    return 1 / (1 + errors.rival * _odds(counts, errors))


def _odds(counts: NameCounts, errors: NameErrors) -> Array:
    """Odds [n, names] of all other names against each name, where one has even odds before."""
    independent = 1 / (1 + errors.sides_correlate * np.maximum(counts.sides - 1, 0))
    slope = logit(errors.hit) - logit(errors.mistaken)
    support = counts.given * (slope * independent)[:, None]
    more = support[:, None, :] - support[:, :, None]  # [n, own, other]
    other = counts.listed[:, None, :] & ~np.eye(support.shape[1], dtype=bool)
    return (np.exp(np.minimum(more, 50.0)) * other).sum(axis=2)


def instances(counts: NameCounts) -> NDArray[np.bool_]:
    """Names [n, names] that are given often enough for an instance of the map."""
    return counts.listed & (counts.given >= LEAST_RATE * counts.sides[:, None])


def log_loss(probability: Array, right: Array) -> Array:
    """Negative log-likelihood of right [...] in 0 to 1 under probabilities [...]."""
    p = np.clip(probability, 1e-6, 1 - 1e-6)
    return -(right * np.log(p) + (1 - right) * np.log(1 - p))


def _terms(counts: NameCounts, theta: Array) -> Array:
    """Log-likelihood [n, names + 1] of each name being the right one; last: none of them."""
    hit, mistaken, correlate, none = expit(np.clip(theta, -LIMIT, LIMIT))
    (k, W, index), listed = counts.pairs, counts.listed
    wrong = np.where(listed, _beta_binomial(k, W, mistaken, correlate)[index], 0.0)
    right = _beta_binomial(k, W, hit, correlate)[index]
    number = np.maximum(listed.sum(axis=1, keepdims=True), 1)
    all_wrong = wrong.sum(axis=1, keepdims=True)
    one = np.where(listed, all_wrong - wrong + right + np.log((1 - none) / number), -np.inf)
    return np.concatenate([one, all_wrong + np.log(none)], axis=1)


def _beta_binomial(k: Array, W: Array, mean: float, correlate: float) -> Array:
    """Log-likelihood without the binomial coefficient, which no parameter changes."""
    spread = (1 - correlate) / correlate
    a, b = mean * spread, (1 - mean) * spread
    return betaln(k + a, np.maximum(W - k, 0) + b) - betaln(a, b)


def _total(counts: NameCounts, terms: Array) -> Array:
    """Log-likelihood [n] of the things: of the known name, or of all names together."""
    known = counts.right != UNKNOWN
    most = terms.max(axis=1, keepdims=True)
    out = most[:, 0] + np.log(np.exp(terms - most).sum(axis=1))
    out[known] = terms[known, counts.right[known]]
    return out


def _log_prior(theta: Array, prior: Array) -> float:
    return float(-0.5 * (((theta - prior[:4]) / PRIOR_SD[:4]) ** 2).sum())


def _improved(counts: NameCounts, weight: Array, share: Array, theta: Array, prior: Array) -> Array:
    """Parameters of a higher expected log-likelihood under shares [n, names + 1]."""

    def loss(t: Array) -> float:
        terms = _terms(counts, t)
        expected = np.where(share > 0, share * np.where(share > 0, terms, 0.0), 0.0)
        return -float(weight @ expected.sum(axis=1)) - _log_prior(t, prior)

    bounds = [(-LIMIT, LIMIT)] * len(theta)
    found = minimize(loss, theta, method="L-BFGS-B", bounds=bounds, options={"maxiter": M_STEP})
    return found.x if found.fun <= loss(theta) else theta


def _equations(counts: NameCounts, at: Array) -> Array:
    """Equations [n, 5] whose sum over the things, with those of the priors, a fit makes 0."""
    steps = DIFFERENCE * np.eye(4)
    theta = at[:4]
    likely = [
        _total(counts, _terms(counts, theta + d)) - _total(counts, _terms(counts, theta - d))
        for d in steps
    ]
    hit, mistaken, correlate, _ = expit(theta).tolist()
    p = probabilities(counts, NameErrors(hit, mistaken, correlate, float(np.exp(at[4]))))
    more = np.where(instances(counts), p - shares(counts, theta)[:, :-1], 0.0).sum(axis=1)
    return np.stack([*(change / (2 * DIFFERENCE) for change in likely), more], -1)


def _rival(
    counts: NameCounts, weight: Array, share: Array, errors: NameErrors, prior: float
) -> float:
    """Likeliest `rival` of the map's rule if names are right with these shares."""
    rows, columns = np.nonzero(instances(counts))
    right, odds = share[rows, columns], _odds(counts, errors)[rows, columns]

    def loss(log_rival: float) -> float:
        misfit = float(weight[rows] @ log_loss(1 / (1 + np.exp(log_rival) * odds), right))
        return misfit + 0.5 * ((log_rival - prior) / PRIOR_SD[4]) ** 2

    return float(np.exp(minimize_scalar(loss, bounds=(-9, 4), method="bounded").x))
