"""Updates after a frame against plain references: changed tiles, and medians near frontiers."""

from __future__ import annotations

import numpy as np
import pytest
from helios_map2d.kernels import tile_changes as change_kernels
from helios_map2d.kernels import value_fusion as value_kernels
from helios_map2d.kernels.occupancy_fusion import HEIGHTS, MEMORY, SEEN_NOW
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

SIDE, SHAPE, CORNER = 8, (16, 24), (8, 16)
RNG = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@settings(max_examples=40, deadline=None)
@given(RNG, st.integers(0, 12))
def test_changes_per_tile_equal_the_reference(rng: np.random.Generator, many: int) -> None:
    occupancy, explored = np.zeros((40, 48), np.int8), np.zeros((40, 48), np.uint8)
    at = tuple(slice(lo, lo + n) for lo, n in zip(CORNER, SHAPE, strict=True))
    before, sought = occupancy[at].copy(), explored[at].copy()
    came = np.zeros(SHAPE, np.uint8)
    for _ in range(many):
        r, c = int(rng.integers(0, SHAPE[0])), int(rng.integers(0, SHAPE[1]))
        what = rng.integers(0, 4)
        if what == 0:
            before[r, c] = rng.choice([-1, 100])
        elif what == 1:
            sought[r, c] = 1
        else:
            came[r, c] = rng.choice([SEEN_NOW, HEIGHTS | MEMORY, MEMORY])
    changed, border = np.zeros((2, 3), np.uint8), np.zeros((4, 5), np.uint8)
    extent = change_kernels.note_changes(
        before, sought, occupancy, explored, CORNER, came, changed, border, SIDE
    )
    other = (before != occupancy[at]) | (sought != explored[at])
    flags = np.where(other, SEEN_NOW, 0) | (came & (HEIGHTS | MEMORY))
    wanted, touched = np.zeros_like(changed), np.zeros_like(border)
    for r, c in np.argwhere(flags):
        wanted[r // SIDE, c // SIDE] |= flags[r, c]
    for r, c in np.argwhere(other):
        for y, x in ((r, c), (r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            touched[y // SIDE + 1, x // SIDE + 1] = 1
    assert (changed == wanted).all()
    assert (border == touched).all()
    rows, columns = np.nonzero(other)
    if len(rows):
        assert extent == (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1)
    else:
        assert extent[0] >= extent[1]


FLOATS = st.floats(-(2.0**99), 2.0**99, width=32, allow_subnormal=False) | st.just(0.25)


@given(arrays(np.float32, st.integers(1, 70), elements=FLOATS))
def test_the_median_kernel_equals_numpys_median(values: NDArray[np.float32]) -> None:
    assert value_kernels.median(values) == np.median(values.astype(np.float64))


@settings(max_examples=20, deadline=None)
@given(RNG, st.integers(0, 19), st.integers(0, 29), st.floats(0.5, 9))
def test_the_value_near_a_cell_is_the_median_of_the_known_values_around_the_cell(
    rng: np.random.Generator, row: int, column: int, radius: float
) -> None:
    value = (rng.choice([0.0, 0.2, 0.7], (20, 30)) * rng.random((20, 30))).astype(np.float32)
    out = np.empty(1, np.float64)
    value_kernels.median_near(value, np.array([[row, column]], np.int32), radius, out)
    r, c = np.indices(value.shape)
    reach = int(radius)
    near = value[
        ((r - row) ** 2 + (c - column) ** 2 <= radius**2) & (abs(r - row) <= reach) & (value != 0)
    ]
    assert out[0] == pytest.approx(np.median(near.astype(np.float64)) if len(near) else 0.0)
