"""Errors of names are fitted back from data drawn with known ones, with and without truth."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from helios_eval.error_models.model_building import FITTED, intervals
from helios_eval.error_models.name_error_fit import (
    NONE,
    NameCounts,
    NameFit,
    drawn,
    fitted,
    instances,
    probabilities,
    shares,
    theta_of,
)
from helios_objectmap.instances.name_sightings import NameErrors, NameRates
from hypothesis import given, settings
from hypothesis import strategies as st

NAMES = 4


def sample(errors: NameErrors, none: float, things: int, seed: int) -> NameCounts:
    """Things of two to twelve sides, each with `NAMES` names, drawn from the model."""
    sides = np.random.default_rng(seed).integers(2, 13, things).astype(float)
    empty = NameCounts(
        np.zeros((0, NAMES)), np.zeros((0, NAMES), bool), sides[:0], np.zeros(0, int),
        np.zeros(0, int),
    )  # fmt: skip
    return drawn(NameFit(errors, none, ()), empty, sides, NAMES, seed)


@pytest.mark.parametrize("known", [True, False], ids=["with truth", "agreement alone"])
def test_known_errors_are_fitted_back_within_their_intervals(known: bool) -> None:
    truth = NameErrors(hit=0.85, mistaken=0.2, sides_correlate=0.25)
    counts = sample(truth, 0.1, 250, 3)
    counts = counts if known else counts.without_truth()
    fit = fitted(counts)
    low, high = intervals(counts, fit)
    for k, name in enumerate(FITTED[:3]):
        assert low[k] <= getattr(truth, name) <= high[k], name
        assert high[k] - low[k] < 0.25, name


@settings(max_examples=8, deadline=None)
@given(
    st.floats(0.5, 0.97), st.floats(0.02, 0.45), st.floats(0.02, 0.7), st.floats(0.01, 0.5),
    st.integers(0, 999),
)  # fmt: skip
def test_no_step_lowers_the_likelihood(hit, mistaken, correlate, none, seed) -> None:
    counts = sample(NameErrors(hit, mistaken, correlate), none, 40, seed).without_truth()
    steps = np.array(fitted(counts).steps)
    assert len(steps) > 1
    assert (np.diff(steps) >= -1e-6 * np.abs(steps[:-1])).all()


def test_shares_add_up_and_keep_what_is_known() -> None:
    counts = sample(NameErrors(), 0.2, 60, 1)
    theta = theta_of(fitted(counts.without_truth()))
    told, untold = shares(counts, theta), shares(counts.without_truth(), theta)
    assert told.sum(axis=1) == pytest.approx(np.ones(60))
    assert untold.sum(axis=1) == pytest.approx(np.ones(60))
    assert set(np.unique(told)) == {0.0, 1.0}
    assert (told[counts.right == NONE, -1] == 1).all()


@given(st.integers(0, 200))
@settings(max_examples=20, deadline=None)
def test_probabilities_are_those_of_the_map(seed: int) -> None:
    errors = NameErrors(0.8, 0.3, 0.4, 0.5)
    counts = sample(errors, 0.1, 5, seed)
    names = tuple(f"name {k}" for k in range(NAMES))
    found = probabilities(counts, errors)
    for row in range(5):
        sides = int(counts.sides[row])
        rate = np.repeat(counts.given[row][None] / sides, sides, axis=0)
        of_map = NameRates(names, rate, np.ones(sides))
        for k, name in enumerate(names):
            assert found[row, k] == pytest.approx(of_map.probability(name, errors), rel=1e-9)


def test_things_that_say_nothing_leave_the_prior() -> None:
    counts = sample(NameErrors(), 0.1, 1, 0).without_truth()
    nothing = NameCounts(
        counts.given[:, :1] * 0, counts.listed[:, :1], counts.sides * 0, counts.right, counts.scene
    )
    low, high = intervals(nothing, fitted(nothing))
    assert high[0] - low[0] > 0.4  # of `hit`: the prior's width
    assert asdict(fitted(nothing).errors)["hit"] == pytest.approx(0.8, abs=0.02)


def test_names_given_now_and_then_make_no_instance() -> None:
    counts = NameCounts(
        np.array([[3.0, 0.2]]), np.ones((1, 2), bool), np.array([4.0]), np.array([0]),
        np.array([0]),
    )  # fmt: skip
    assert instances(counts).tolist() == [[True, False]]
