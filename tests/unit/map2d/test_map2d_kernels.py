"""The depth projection kernels against plain references."""

from __future__ import annotations

import itertools
import math

import numpy as np
from helios_core.geometry import Pinhole
from helios_map2d.kernels import depth_projection as project_kernels
from helios_map2d.kernels.depth_projection import FLOOR, OBSTACLE
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from map2d_scene import Block, camera_pose, cast, room
from numpy.typing import NDArray

CAMERA = Pinhole(50.0, 50.0, 31.5, 23.5, 64, 48)
CELL_M = 0.05
CELLS = 240
BINS, RANGES = 130, 160
NEAR, FAR, FLOOR_TOL, LO, HI, RISE, JUMP, JUMP_RATIO = 0.1, 5.0, 0.08, 0.1, 1.5, 0.006, 0.05, 0.03


def azimuth_bin(forward: float, left: float) -> int:
    """The bin of a direction, computed from its angle."""
    angle = math.atan2(left, forward)
    quarter, rest = divmod(angle, math.pi / 2)
    diamond = math.sin(rest) / (math.sin(rest) + math.cos(rest))
    return min(BINS - 1, int((2 + quarter + diamond) * BINS / 4))


def is_flying_pixel(depth: NDArray[np.float32], v: int, u: int) -> bool:
    z = float(depth[v, u])
    jump = JUMP + JUMP_RATIO * z
    apart = []
    for a, b in ((depth[v, u - 1], depth[v, u + 1]), (depth[v - 1, u], depth[v + 1, u])):
        off = [float(x) - z for x in (a, b)]
        far = a > 0 and b > 0 and abs(off[0]) > jump and abs(off[1]) > jump
        if far and off[0] * off[1] < 0:
            return True
        apart.append(far)
    return all(apart)


def project_depth_reference(
    depth: NDArray[np.float32], T: NDArray[np.float64], step: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], set[tuple[int, int, int]]]:
    """Counts and highest heights per cell, and (bin, range, kind) of every pixel that counts."""
    count = np.zeros((CELLS, CELLS), np.int64)
    high = np.full((CELLS, CELLS), -np.inf)
    polar: set[tuple[int, int, int]] = set()
    forward = T[:2, 2] / np.hypot(*T[:2, 2])
    for v, u in np.ndindex(48, 64):
        z = float(depth[v, u])
        if v % step or u % step or not NEAR < z < FAR:
            continue
        ray = np.array([(u - 31.5) / 50, (v - 23.5) / 50, 1.0])
        off = T[:3, :3] @ (ray * z)
        height = off[2] + T[2, 3]
        if LO + RISE * z * z <= height <= HI:
            inner = 0 < v < 47 and 0 < u < 63
            if inner and is_flying_pixel(depth, v, u):
                continue
            kind = OBSTACLE
            column, row = np.floor(off[:2] / CELL_M + CELLS / 2).astype(int)
            if 0 <= row < CELLS and 0 <= column < CELLS:
                count[row, column] += 1
                high[row, column] = max(high[row, column], HI if v == 0 else height)
        elif abs(height) <= FLOOR_TOL:
            kind = FLOOR
        else:
            continue
        k = int(np.hypot(*off[:2]) / CELL_M)
        b = azimuth_bin(forward @ off[:2], forward[0] * off[1] - forward[1] * off[0])
        if k < RANGES:
            polar.add((b, k, kind))
    return count, high, polar


@settings(max_examples=6, deadline=None)
@given(st.floats(-3, 3), st.floats(0.0, 0.9), st.integers(0, 2**31), st.sampled_from([1, 2, 3]))
def test_project_depth_equals_the_reference(
    yaw: float, pitch_down: float, seed: int, step: int
) -> None:
    T = camera_pose(1.013, 1.517, yaw, pitch_down)  # no wall lies on a cell border
    rng = np.random.default_rng(seed)
    depth = cast([*room(), Block((2.0, 1.2, 0), (2.5, 1.8, 0.6))], T, CAMERA)
    wild = rng.random(depth.shape) < 0.02
    depth = np.where(wild, rng.choice([np.nan, 0.0, 1.0, 3.0], depth.shape), depth)
    depth = np.ascontiguousarray(depth, np.float32)
    counts, low, high = (np.full(CELLS**2, v, np.int32) for v in (0, project_kernels.NO_LOW, 0))
    first, bins = 3, BINS - 5  # other azimuths are left out
    found = np.zeros((3, RANGES, bins), np.uint8)
    pose = np.empty((3, 4), np.float32)
    pose[:, :3] = T[:3, :3]
    pose[:, 3] = CELLS / 2, CELLS / 2, T[2, 3]
    heading = (T[:2, 2] / np.hypot(*T[:2, 2])).astype(np.float32)
    limits = np.array(
        [NEAR, FAR, FLOOR_TOL, LO, HI, RISE, JUMP, JUMP_RATIO, 1 / CELL_M], np.float32
    )
    intrinsics = np.array([1 / 50, 1 / 50, 31.5, 23.5], np.float32)
    body = np.array([0, 0, 0], np.float32)
    project_kernels.project_depth(
        depth, step, intrinsics, pose, heading, limits, body, np.array([first, BINS], np.int32),
        np.array([CELLS, CELLS], np.int32), counts, low, high, found,
    )  # fmt: skip
    count, highs = counts.reshape(CELLS, CELLS), high.view(np.float32).reshape(CELLS, CELLS)
    expected, top, marks = project_depth_reference(depth, T, step)
    # float32 against float64: a pixel on a border may fall to either side of it.
    assert abs(count.astype(int) - expected).sum() <= 0.01 * expected.sum() + 4
    both = (count > 0) & (count == expected)
    assert np.mean(abs(highs[both] - top[both]) < 1e-3) > 0.99
    got = {
        (int(b) + first, int(k), kind)
        for kind in (FLOOR, OBSTACLE)
        for k, b in np.argwhere(found[kind])
    }
    wanted = {mark for mark in marks if first <= mark[0] < first + bins}
    assert len(got ^ wanted) <= 0.02 * len(wanted) + 4


def floor_along_azimuth_reference(
    line: NDArray[np.uint8], gap: int, shadow: int
) -> NDArray[np.bool_]:
    """Which ranges of one azimuth are seen as floor."""
    obstacles = np.flatnonzero(line & OBSTACLE)
    believed = [
        k
        for k in np.flatnonzero(line == FLOOR)
        if not ((obstacles < k) & (k - obstacles <= shadow)).any()
    ]
    seen = np.zeros(line.size, bool)
    seen[believed] = True
    for a, b in itertools.pairwise(believed):
        if b - a <= gap and not ((a < obstacles) & (obstacles < b)).any():
            seen[a : b + 1] = True
    return seen


@given(arrays(np.uint8, (4, 30), elements=st.integers(0, 3)), st.integers(1, 6), st.integers(0, 5))
def test_floor_along_azimuths_equals_the_reference(
    polar: NDArray[np.uint8], gap: int, shadow: int
) -> None:
    found = np.stack([polar * 0, polar & FLOOR, (polar & OBSTACLE) // OBSTACLE]).swapaxes(1, 2)
    expected = np.array([floor_along_azimuth_reference(line, gap, shadow) for line in polar]).T
    # Each azimuth also marks both its neighbours; the last one is beside the first.
    expected |= np.roll(expected, 1, axis=1) | np.roll(expected, -1, axis=1)
    seen = np.empty((30, 4), np.uint8)
    marks = np.ascontiguousarray(found)
    project_kernels.floor_along_azimuths(marks, gap, shadow, seen)
    assert (seen == expected).all()
    assert not marks.any()  # cleared for the next frame
