"""Errors of names are fitted back from data drawn with known ones, with and without truth."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
from helios_eval.error_models.model_building import intervals
from helios_eval.error_models.name_error_fit import (
    NONE,
    PRIOR,
    UNKNOWN,
    NameCounts,
    NameFit,
    covariance,
    drawn,
    fitted,
    instances,
    log_loss,
    probabilities,
    shares,
)
from helios_objectmap.instances.name_sightings import NameErrors, NameRates
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logit

NAMES = 4


def without_truth(counts: NameCounts) -> NameCounts:
    return replace(counts, right=np.full(len(counts), UNKNOWN))


def sample(values: tuple[float, float, float, float], things: int, seed: int) -> NameCounts:
    """Things of two to twelve sides, each with `NAMES` names, drawn with h, q, ρ and ν."""
    sides = np.random.default_rng(seed).integers(2, 13, things).astype(float)
    return drawn(NameFit(logit(values), PRIOR[4:]), sides, NAMES, seed)


@pytest.mark.parametrize("known", [True, False], ids=["with truth", "agreement alone"])
def test_known_errors_are_fitted_back_within_their_intervals(known: bool) -> None:
    values, inside, number = (0.85, 0.2, 0.25, 0.1), 0, 8
    for seed in range(number):
        counts = sample(values, 150, seed)
        counts = counts if known else without_truth(counts)
        fit = fitted(counts)
        deviation = np.sqrt(np.diag(covariance(counts, fit, np.arange(len(counts)))))[:4]
        inside += int((np.abs(fit.model - logit(values)) <= 1.96 * deviation).sum())
        assert (deviation[:3] < 0.4).all()
    assert inside >= 0.85 * 4 * number  # of 95 % intervals


def test_the_rule_fits_the_truth_better_than_the_broad_prior() -> None:
    counts, other = (sample((0.85, 0.2, 0.25, 0.1), 200, seed) for seed in (1, 2))
    right = np.eye(NAMES + 1)[other.right][:, :-1]
    losses = [
        log_loss(probabilities(other, errors), right).mean()
        for errors in (fitted(counts).errors, fitted(without_truth(counts)).errors, NameErrors())
    ]
    assert losses[0] <= losses[1] + 0.005
    assert losses[1] < losses[2]


@settings(max_examples=8, deadline=None)
@given(
    st.floats(0.5, 0.97),
    st.floats(0.02, 0.45),
    st.floats(0.02, 0.7),
    st.floats(0.01, 0.5),
    st.integers(0, 999),
)
def test_no_step_lowers_the_likelihood(hit, mistaken, correlate, none, seed) -> None:
    counts = without_truth(sample((hit, mistaken, correlate, none), 40, seed))
    steps = np.array(fitted(counts).steps)
    assert len(steps) > 1
    assert (np.diff(steps) >= -1e-6 * np.abs(steps[:-1])).all()


def test_shares_add_up_and_keep_what_is_known() -> None:
    counts = sample((0.9, 0.1, 0.2, 0.2), 60, 1)
    theta = fitted(without_truth(counts)).model
    told, untold = shares(counts, theta), shares(without_truth(counts), theta)
    assert told.sum(axis=1) == pytest.approx(np.ones(60))
    assert untold.sum(axis=1) == pytest.approx(np.ones(60))
    assert set(np.unique(told)) == {0.0, 1.0}
    assert (told[counts.right == NONE, -1] == 1).all()


@given(st.integers(0, 200))
@settings(max_examples=20, deadline=None)
def test_probabilities_are_those_of_the_map(seed: int) -> None:
    errors = NameErrors(0.8, 0.3, 0.4, 0.5)
    counts = sample((0.8, 0.3, 0.4, 0.1), 5, seed)
    names = tuple(f"name {k}" for k in range(NAMES))
    found = probabilities(counts, errors)
    for row in range(5):
        sides = int(counts.sides[row])
        rate = np.repeat(counts.given[row][None] / sides, sides, axis=0)
        of_map = NameRates(names, rate, np.ones(sides))
        for k, name in enumerate(names):
            assert found[row, k] == pytest.approx(of_map.probability(name, errors), rel=1e-9)


def test_things_that_say_nothing_leave_the_prior() -> None:
    counts = without_truth(sample((0.9, 0.1, 0.2, 0.1), 1, 0))
    nothing = NameCounts(
        counts.given[:, :1] * 0, counts.listed[:, :1], counts.sides * 0, counts.right, counts.scene
    )
    low, high = intervals(nothing, fitted(nothing))
    assert high[0] - low[0] > 0.4  # of `hit`: the prior's width
    assert asdict(fitted(nothing).errors)["hit"] == pytest.approx(0.8, abs=0.02)


def test_names_given_now_and_then_make_no_instance() -> None:
    counts = NameCounts(
        np.array([[3.0, 0.2]]),
        np.ones((1, 2), bool),
        np.array([4.0]),
        np.array([0]),
        np.array([0]),
    )
    assert instances(counts).tolist() == [[True, False]]
