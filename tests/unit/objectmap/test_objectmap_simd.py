"""SIMD operations on sixteen lanes equal numpy, and the depth order equals a plain sort."""

from __future__ import annotations

import numpy as np
import pytest
from helios_objectmap.rendering import simd_intrinsics as simd
from helios_objectmap.rendering.kernels import COLUMNS, DEPTH, U, V, depth_order_kernel
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

_f4 = np.float32


@njit(cache=True)
def _lanes_at_work(a, b, out):
    """a, b: at least 17 numbers; out: [6 * 16]."""
    x, y = simd.load(a, 1), simd.load(b, 0)
    simd.store(out, 0, x + y)
    simd.store(out, 16, x - y)
    simd.store(out, 32, x * y)
    simd.store(out, 48, simd.larger(x, y))
    simd.store(out, 64, simd.exp2_above(x, _f4(-8)))
    simd.store(out, 80, simd.ramp() * simd.fill(_f4(3)) + simd.fill_from(a, 2))
    return simd.at_most(x, y), simd.sum_of(x), simd.largest_of(x)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_simd_lanes_compute_the_same_as_numpy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-20, 20, (2, 17)).astype(np.float32)
    out = np.empty(96, np.float32)
    below, total, largest = _lanes_at_work(a, b, out)
    x, y = a[1:17], b[:16]
    assert np.allclose(out[:16], x + y, atol=1e-5)
    assert np.allclose(out[16:32], x - y, atol=1e-5)
    assert np.allclose(out[32:48], x * y, rtol=1e-6)
    assert np.array_equal(out[48:64], np.maximum(x, y))
    exact = np.where(x >= -8, np.exp2(x.astype(np.float64)), 0)
    assert np.allclose(out[64:80], exact, rtol=5e-7)
    assert np.allclose(out[80:], np.arange(16) * 3 + a[2], atol=1e-5)
    assert below == sum(1 << i for i in range(16) if x[i] <= y[i])
    assert total == pytest.approx(float(x.sum()), abs=1e-4)
    assert largest == x.max()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 400), st.integers(1, 50), st.integers(0, 2**32 - 1))
def test_depth_order_is_near_to_far_and_independent_of_the_input_order(n, depths, seed):
    rng = np.random.default_rng(seed)
    splats = np.zeros((n, COLUMNS), np.float32)
    splats[:, DEPTH] = rng.choice(rng.uniform(0.05, 100, depths), n)  # many are equal
    splats[:, U], splats[:, V] = rng.uniform(-5, 5, (2, n))
    order = np.empty(n, np.int32)
    depth_order_kernel(splats, order)
    assert sorted(order.tolist()) == list(range(n))
    assert (np.diff(splats[order, DEPTH]) >= 0).all()
    shuffled = splats[rng.permutation(n)]
    other = np.empty(n, np.int32)
    depth_order_kernel(shuffled, other)
    assert np.array_equal(shuffled[other], splats[order])
