"""What is left out to be faster changes nothing."""

from __future__ import annotations

import cv2
import numpy as np
from helios_objectmap.instances import count_pairs, distinct
from helios_objectmap.objects import MANY_POINTS, outline
from hypothesis import given, settings
from hypothesis import strategies as st


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["blob", "grid", "line", "one place"]))
def test_the_outline_of_many_points_is_their_convex_hull(seed, kind):
    rng = np.random.default_rng(seed)
    n = MANY_POINTS + 500
    points = {
        "blob": rng.normal(0, 1, (n, 3)),
        "grid": rng.integers(-20, 20, (n, 3)) * 0.05,  # many on the hull's edges
        "line": np.outer(rng.uniform(-1, 1, n), [1.0, 2.0, 0.0]),
        "one place": np.tile(rng.normal(size=3), (n, 1)),
    }[kind].astype(np.float32)
    hull = cv2.convexHull(points[:, :2].copy()).reshape(-1, 2)
    found = outline(points.astype(np.float64))
    assert abs(area(found) - area(hull)) <= 1e-5
    assert {tuple(p) for p in found} <= {tuple(p) for p in points[:, :2].astype(np.float64)}


def area(polygon) -> float:
    return cv2.contourArea(np.ascontiguousarray(polygon, np.float32))


@given(st.lists(st.integers(-3, 3), max_size=60))
def test_distinct_values_are_those_of_numpy(values):
    array = np.array(values, np.int64)
    found, of_value = distinct(array)
    wanted, inverse = np.unique(array, return_inverse=True)
    assert np.array_equal(found, wanted)
    assert np.array_equal(of_value, inverse)


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3)), max_size=60))
def test_pairs_are_counted(pairs):
    a, b = np.array(pairs, np.int64).reshape(-1, 2).T
    counted = dict(zip(zip(*(x.tolist() for x in count_pairs(a, b)[:2]), strict=True),
                       count_pairs(a, b)[2].tolist(), strict=True))  # fmt: skip
    assert counted == {pair: pairs.count(pair) for pair in set(pairs)}
