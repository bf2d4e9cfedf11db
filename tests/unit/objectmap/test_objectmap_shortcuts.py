"""Shortcuts that save time give the same results as the full computation."""

from __future__ import annotations

import cv2
import numpy as np
from helios_objectmap.instances.clustering import distinct
from helios_objectmap.instances.summary import MANY_POINTS, outline, quantiles
from hypothesis import given, settings
from hypothesis import strategies as st


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["blob", "grid", "line", "one place"]))
def test_the_outline_of_many_points_is_their_convex_hull(seed, kind):
    rng = np.random.default_rng(seed)
    n = MANY_POINTS + 500
    points = {
        "blob": rng.normal(0, 1, (n, 2)),
        "grid": rng.integers(-20, 20, (n, 2)) * 0.05,  # many on the hull's edges
        "line": np.outer(rng.uniform(-1, 1, n), [1.0, 2.0]),
        "one place": np.tile(rng.normal(size=2), (n, 1)),
    }[kind].astype(np.float32)
    hull = cv2.convexHull(points).reshape(-1, 2)
    found = outline(points)
    assert abs(area(found) - area(hull)) <= 1e-5
    assert {tuple(p) for p in found} <= {tuple(p) for p in points.astype(np.float64)}


def area(polygon) -> float:
    return cv2.contourArea(np.ascontiguousarray(polygon, np.float32))


@given(st.lists(st.integers(-3, 3), max_size=60))
def test_distinct_values_equal_numpys_unique_values(values):
    array = np.array(values, np.int64)
    found, of_value = distinct(array)
    wanted, inverse = np.unique(array, return_inverse=True)
    assert np.array_equal(found, wanted)
    assert np.array_equal(of_value, inverse)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 400), st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-3, 0.0]))
def test_quantiles_equal_numpys_even_with_ties_and_far_outliers(n, seed, spread):
    rng = np.random.default_rng(seed)
    values = (5 + spread * rng.normal(0, 1, (3, n))).astype(np.float32).round(3)
    values[:, rng.random(n) < 0.02] = 1e4
    wanted = np.quantile(values.astype(np.float64), (0.02, 0.5, 0.98), axis=1)
    assert np.allclose(quantiles(values, (0.02, 0.5, 0.98)), wanted, rtol=1e-12)
