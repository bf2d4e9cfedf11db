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

The map's own rule (`NameRates.probability`) is simpler. It knows the log-odds ratio of a right and
a wrong name (`slope`), ρ and the prior odds of one other name (`rival`). A second step fits these
three: those under which the rule's probabilities are likeliest, with the shares of the first step,
or with the truth. `NameFit.errors` has them: h of the first step, and the q that gives the slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from helios_objectmap.instances.name_sightings import NameErrors
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import betaln, expit, logit

from helios_eval.error_models.named_things import NamedThing

NONE, UNKNOWN = -1, -2  # of `NameCounts.right`
LEAST_RATE = 0.15  # names given less often make no instance of the map (`named_from`)
# Normal priors: log-odds of h, q, ρ and ν; of the rule: logarithm of the slope, log-odds of ρ,
# logarithm of rival.
PRIOR = np.array(
    [logit(0.8), logit(0.15), logit(0.2), logit(0.1), np.log(4.0), logit(0.2), np.log(0.1)]
)
PRIOR_SD = np.array([1.0, 1.0, 1.0, 1.0, 0.5, 1.0, 1.5])
RULE_BOUNDS = [(-2.0, 3.0), (-9.0, 9.0), (-9.0, 4.0)]
MOST_SUPPORT = 50.0  # of a name against another, as in the map
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

    model: Array  # [4] log-odds of h, q, ρ, ν
    rule: Array  # [3] of the map's rule, on the scales of `PRIOR`
    steps: tuple[float, ...] = ()

    @property
    def errors(self) -> NameErrors:
        """Parameters of the map's rule."""
        return errors_of(float(expit(self.model[0])), self.rule)

    @property
    def none(self) -> float:
        """Share of things none of whose names is right."""
        return float(expit(self.model[3]))


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


def errors_of(hit: float, rule: Array) -> NameErrors:
    """Parameters of the map's rule from [3] numbers on the scales of `PRIOR`."""
    mistaken = float(expit(logit(hit) - np.exp(rule[0])))
    return NameErrors(hit, mistaken, float(expit(rule[1])), float(np.exp(rule[2])))


def fitted(counts: NameCounts) -> NameFit:
    """Likeliest parameters under the priors."""
    theta, steps = PRIOR[:4].copy(), list[float]()
    for _ in range(MOST_STEPS):
        terms = _terms(counts, theta)
        steps.append(float(_total(counts, terms).sum()) + _log_prior(theta))
        if len(steps) > 1 and steps[-1] - steps[-2] < STEP * abs(steps[-2]):
            break
        theta = _improved(counts, shares(counts, theta), theta)
    share = shares(counts, theta)

    def loss(rule: Array) -> float:
        off = (rule - PRIOR[4:]) / PRIOR_SD[4:]
        return float(_rule_loss(counts, rule, share).sum() + 0.5 * (off**2).sum())

    rule = minimize(loss, PRIOR[4:], method="L-BFGS-B", bounds=RULE_BOUNDS).x
    return NameFit(theta, rule, tuple(steps))


def covariance(counts: NameCounts, fit: NameFit, unit: NDArray[np.int64]) -> Array:
    """Covariance [7, 7] of the parameters on the scales of `PRIOR`.

    unit: [n] things of one unit depend on one another. This is the sandwich estimate for the
    equations that the fit solves; the priors count as one more unit. So the variance of a parameter
    of which the things say nothing is that of its prior.
    """
    at = np.concatenate([fit.model, fit.rule])
    slope = np.stack(
        [
            (_equations(counts, at + d).sum(axis=0) - _equations(counts, at - d).sum(axis=0))
            / (2 * DIFFERENCE)
            for d in DIFFERENCE * np.eye(len(at))
        ],
        -1,
    )
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


def drawn(fit: NameFit, sides: Array, names: int, seed: int) -> NameCounts:
    """Counts of things drawn from the model. sides: [n] whole numbers; names: of each thing."""
    rng, n = np.random.default_rng(seed), len(sides)
    hit, mistaken, correlate, none = expit(fit.model)
    right = np.where(rng.random(n) < none, NONE, rng.integers(0, names, n))
    mean = np.full((n, names), mistaken)
    mean[right >= 0, right[right >= 0]] = hit
    spread = (1 - correlate) / correlate
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
    support = np.where(counts.listed, counts.given * (slope * independent)[:, None], -np.inf)
    own = np.exp(support - support.max(axis=1, keepdims=True))
    own = np.maximum(own, np.exp(-MOST_SUPPORT))
    total = np.where(counts.listed, own, 0.0).sum(axis=1, keepdims=True)
    return (total - own) / own


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


def _log_prior(theta: Array) -> float:
    return float(-0.5 * (((theta - PRIOR[:4]) / PRIOR_SD[:4]) ** 2).sum())


def _improved(counts: NameCounts, share: Array, theta: Array) -> Array:
    """Parameters of a higher expected log-likelihood under shares [n, names + 1]."""

    def loss(t: Array) -> float:
        terms = _terms(counts, t)
        expected = np.where(share > 0, share * np.where(share > 0, terms, 0.0), 0.0)
        return -float(expected.sum()) - _log_prior(t)

    bounds = [(-LIMIT, LIMIT)] * len(theta)
    found = minimize(loss, theta, method="L-BFGS-B", bounds=bounds, options={"maxiter": M_STEP})
    return found.x if found.fun <= loss(theta) else theta


def _rule_loss(counts: NameCounts, rule: Array, share: Array) -> Array:
    """Log loss [n] of the map's rule if names are right with shares [n, names + 1]."""
    p = probabilities(counts, errors_of(0.5, rule))
    return np.where(instances(counts), log_loss(p, share[:, :-1]), 0.0).sum(axis=1)


def _equations(counts: NameCounts, at: Array) -> Array:
    """Equations [n, 7] whose sum over the things, with those of the priors, a fit makes 0."""
    theta, rule = at[:4], at[4:]
    share = shares(counts, theta)
    likely = [
        _total(counts, _terms(counts, theta + d)) - _total(counts, _terms(counts, theta - d))
        for d in DIFFERENCE * np.eye(4)
    ]
    likely += [
        _rule_loss(counts, rule - d, share) - _rule_loss(counts, rule + d, share)
        for d in DIFFERENCE * np.eye(3)
    ]
    return np.stack(likely, -1) / (2 * DIFFERENCE)
