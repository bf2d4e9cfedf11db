"""Remembered draws are those of `normal_draws`, for the same views again and for new ones."""

import numpy as np
import pytest
from helios_detector.simulation import remembered_draws
from helios_detector.simulation.remembered_draws import RememberedDraws
from helios_detector.simulation.smooth_view_noise import SmoothViews
from helios_detector.simulation.view_noise import (
    SectorViews,
    Shares,
    Views,
    key_of,
    keys_of,
    normal_draws,
)
from hypothesis import given, settings
from hypothesis import strategies as st

PURPOSES = keys_of([f"purpose {n}" for n in range(40)])
KEYS = np.array([key_of(f"thing {n}") for n in range(60)], np.uint64)
ALL_SHARES = (Shares(0.3, 0.4, 0.2, 0.1), Shares(0.5, 0.5, 0, 0), Shares(0, 0, 0, 1))


def views_of(seed: int, smooth: bool) -> Views:
    rng = np.random.default_rng(seed)
    keys = KEYS[rng.permutation(len(KEYS))[: rng.integers(1, 40)]]
    if smooth:
        return SmoothViews(keys, rng.uniform(0, 6.2, len(keys)), rng.uniform(0.1, 9, len(keys)))
    sectors = rng.integers(0, 12, len(keys))
    return SectorViews(keys, sectors, sectors + 12 * rng.integers(0, 3, len(keys)))


@settings(max_examples=40, deadline=None)
@given(
    seeds=st.lists(st.integers(0, 20), min_size=1, max_size=6),
    shares=st.sampled_from(ALL_SHARES),
    smooth=st.booleans(),
    level=st.floats(-4, 1),
)
def test_remembered_draws_below_a_limit_are_those_of_normal_draws(
    seeds: list[int], shares: Shares, smooth: bool, level: float
) -> None:
    draws = RememberedDraws(PURPOSES, shares)
    for stamp_ns, seed in enumerate(seeds):
        views = views_of(seed, smooth)
        limits = np.random.default_rng(seed).normal(level, 0.5, (len(views), len(PURPOSES)))
        limits[0, ::3] = -np.inf
        z = normal_draws(views, PURPOSES, shares, stamp_ns)
        columns, rows = np.nonzero((z < limits).T)
        found_rows, found_columns, found = draws.below(views, limits, stamp_ns)
        assert np.array_equal(found_rows, rows)
        assert np.array_equal(found_columns, columns)
        assert np.array_equal(found, z[rows, columns])


def test_more_views_than_are_remembered_give_the_same_draws(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(remembered_draws, "_FIRST_ROWS", 4)
    monkeypatch.setattr(remembered_draws, "_MOST_ROWS", 50)
    draws = RememberedDraws(PURPOSES, ALL_SHARES[0])
    for seed in range(20):
        views = views_of(seed, smooth=False)
        z = normal_draws(views, PURPOSES, ALL_SHARES[0], seed)
        _, _, found = draws.below(views, np.full(z.shape, np.inf), seed)
        assert np.array_equal(found, z.T.ravel())
        assert len(draws._rows) <= 50
