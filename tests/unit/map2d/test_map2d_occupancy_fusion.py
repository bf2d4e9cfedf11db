"""Fusing a frame into the map's window, and the window itself, against plain references."""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
from helios_core.geometry import Pinhole
from helios_core.map_snapshot import OCCUPIED as TAKEN
from helios_map2d.camera_view import spans_between, view_of
from helios_map2d.grid import GridSpec
from helios_map2d.kernels import occupancy_fusion as fuse_kernels
from helios_map2d.kernels.depth_projection import NO_LOW
from helios_map2d.kernels.occupancy_fusion import HEIGHTS, MEMORY, SEEN_NOW
from helios_map2d.layers.occupancy import OccupancyLayer, OccupancyRules
from hypothesis import given, settings
from hypothesis import strategies as st
from map2d_scene import Block, camera_pose, cast, room, table
from numpy.typing import NDArray

CAMERA = Pinhole(50.0, 50.0, 31.5, 23.5, 64, 48)
LENS = np.array([50.0, 50.0, 31.5, 23.5], np.float32)
CELL_M, ROWS, COLUMNS = 0.05, 40, 50
CORNER, MAP = (3, 5), (ROWS + 8, COLUMNS + 8)
BINS, FIRST, RANGES = 130, 40, 60
RULES = WEAK, STRONG, TAIL, OCCUPIED, MOST, GAIN, LOSS = 3, 5, 20, 2, 5, 2, 2
TOLERANCE, FAR = (0.03, 0.02), 5.0
EYE = 25.3, 4.2  # column, row of the camera in the window

RNG = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@settings(max_examples=40, deadline=None)
@given(RNG, st.integers(2, 5))
def test_spans_cover_the_hull_of_their_points_and_little_more(
    rng: np.random.Generator, n: int
) -> None:
    points = rng.uniform(-20, 70, (n, 2))
    spans = np.empty((50, 2), np.int32)
    spans_between(points, 50, spans)
    share = np.linspace(0, 1, 400)[:, None]
    edges = np.vstack([a + share * (b - a) for a, b in itertools.combinations(points, 2)])
    for row, (first, end) in enumerate(spans):
        assert 0 <= first <= end <= 50
        found = edges[(edges[:, 1] >= row - 2) & (edges[:, 1] <= row + 3), 0]
        if not len(found):
            continue  # the samples may miss an edge that only grazes the row
        low, high = math.floor(found.min()) - 2, math.ceil(found.max()) + 3
        assert min(max(low, 0), 50) - 2 <= first <= min(max(low, 0), 50)
        assert min(max(high, 0), 50) <= end <= min(max(high, 0), 50) + 2


def azimuth_bin(forward: float, left: float) -> int:
    quarter, rest = divmod(math.atan2(left, forward), math.pi / 2)
    diamond = math.sin(rest) / (math.sin(rest) + math.cos(rest))
    return min(BINS - 1, int((2 + quarter + diamond) * BINS / 4))


@settings(max_examples=15, deadline=None)
@given(RNG, st.floats(-3, 3))
def test_fold_floor_equals_the_reference(rng: np.random.Generator, yaw: float) -> None:
    floor = (rng.random((RANGES + 1, BINS - FIRST - 9)) < 0.5).astype(np.uint8)
    floor[-1] = 0
    evidence = rng.integers(0, 4, MAP).astype(np.uint8) * (rng.random(MAP) < 0.2).astype(np.uint8)
    known = (rng.random(MAP) < 0.3).astype(np.uint8)
    occupancy = rng.choice(np.array([-1, 0, 100], np.int8), MAP)
    count = (rng.random((ROWS, COLUMNS)) < 0.1).astype(np.int32)
    spans = np.sort(rng.integers(0, COLUMNS + 1, (ROWS, 2)), axis=1).astype(np.int32)
    pose = np.zeros((3, 4), np.float32)
    pose[:2, 3] = EYE
    heading = np.array([math.cos(yaw), math.sin(yaw)], np.float32)
    came, active = np.full((ROWS, COLUMNS), 9, np.uint8), np.empty((2008, 2), np.int32)
    wanted_known, wanted_state = known.copy(), occupancy.copy()
    wanted_came, wanted_active = np.zeros_like(came), []
    for r, c in np.ndindex(ROWS, COLUMNS):
        if not spans[r, 0] <= c < spans[r, 1]:
            continue
        at = r + CORNER[0], c + CORNER[1]
        dx, dy = c + 0.5 - EYE[0], r + 0.5 - EYE[1]
        k = int(math.hypot(dx, dy))
        b = azimuth_bin(heading[0] * dx + heading[1] * dy, heading[0] * dy - heading[1] * dx)
        inside = k < RANGES and 0 <= b - FIRST < floor.shape[1]
        seen = inside and floor[k, b - FIRST] > 0
        wanted_came[r, c] = seen * SEEN_NOW + (seen and not known[at]) * MEMORY
        wanted_known[at] |= seen
        ground = 0 if wanted_known[at] else -1
        wanted_state[at] = 100 if evidence[at] >= OCCUPIED else ground
        if evidence[at] or count[r, c]:
            wanted_active.append((r, c))
    n = fuse_kernels.fold_floor(
        pose, heading, np.array([FIRST, BINS], np.int32), floor, np.uint8(OCCUPIED), CORNER, spans,
        count, evidence, known, occupancy, came, active,
    )  # fmt: skip
    assert active[:n].tolist() == [list(cell) for cell in wanted_active]
    # float32 against float64: a cell on the border of a bin may fall to either side of it.
    on_border = int((came != wanted_came).sum())
    assert on_border <= 0.005 * came.size
    assert (known != wanted_known).sum() <= on_border
    assert (occupancy != wanted_state).sum() <= on_border


def image_shows(depth: NDArray[np.float32], p: NDArray[np.float64]) -> str:
    """What an image shows at a point in camera axes: through, surface or hidden."""
    x, y, z = p
    if not 0.05 < z < FAR:
        return "hidden"
    u, v = math.floor(50 * x / z + 31.5 + 0.5), math.floor(50 * y / z + 23.5 + 0.5)
    r = min(6, int(0.5 * CELL_M / z * 50) + 1)
    if u < r or v < r or u + r >= 64 or v + r >= 48:
        return "hidden"
    seen = depth[v - r : v + r + 1, u - r : u + r + 1]
    seen = seen[seen > 0]
    tol = TOLERANCE[0] + TOLERANCE[1] * z
    if (abs(seen - z) <= tol).any():
        return "surface"
    return "through" if len(seen) and (seen > z + tol).all() else "hidden"


@settings(max_examples=12, deadline=None)
@given(RNG, st.floats(-0.3, 0.3))
def test_fold_obstacles_equals_the_reference(rng: np.random.Generator, turn: float) -> None:
    T = camera_pose(0, 0, math.pi / 2 + turn, 0.4)
    depth = rng.choice([0.0, 0.8, 1.2, 4.0, 4.0], (48, 64)).astype(np.float32)
    depth = np.repeat(np.repeat(depth[::12, ::16], 12, 0), 16, 1)  # patches
    count = rng.integers(0, 8, (ROWS, COLUMNS)) * (rng.random((ROWS, COLUMNS)) < 0.2)
    count = count.astype(np.int32)
    low = rng.uniform(0.1, 0.6, count.shape).astype(np.float32)
    high = low + rng.uniform(0, 0.6, count.shape).astype(np.float32)
    state = {
        "evidence": (rng.integers(0, 6, MAP) * (rng.random(MAP) < 0.4)).astype(np.uint8),
        "floor": (rng.random(MAP) < 0.5).astype(np.uint8),
        "low": rng.uniform(0.1, 0.5, MAP).astype(np.float32),
    }
    state["high"] = state["low"] + rng.choice([0.01, 0.4], MAP).astype(np.float32)
    state["occupancy"] = rng.choice(np.array([-1, 0, 100], np.int8), MAP)
    came = rng.choice(np.array([0, SEEN_NOW, MEMORY], np.uint8), count.shape)
    active = np.argwhere((state["evidence"][3:-5, 5:-3] > 0) | (count > 0)).astype(np.int32)
    wanted, wanted_came = {k: v.copy() for k, v in state.items()}, came.copy()
    for r, c in active:
        fold_cell_reference(depth, T, count, low, high, wanted, wanted_came, int(r), int(c))
    pose = np.array(T[:3], np.float32)
    pose[:2, 3] = EYE
    fuse_kernels.fold_obstacles(
        depth, LENS, pose, np.float32(CELL_M), np.array(TOLERANCE, np.float32), np.float32(FAR),
        np.array(RULES), count, low, high, active, CORNER, state["evidence"], state["floor"],
        state["low"], state["high"], state["occupancy"], came,
    )  # fmt: skip
    # float32 against float64: a point on the border of a pixel may fall to either side of it.
    for name, got in state.items():
        assert np.mean(np.abs(got - wanted[name].astype(np.float64)) < 1e-4) > 0.99, name
    assert (came != wanted_came).mean() < 0.01


def fold_cell_reference(
    depth: NDArray[np.float32],
    T: NDArray[np.float64],
    count: NDArray[np.int32],
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    state: dict[str, NDArray],
    came: NDArray[np.uint8],
    r: int,
    c: int,
) -> None:
    """One cell: remove evidence where the view sees through it, add this frame's hit."""
    at = r + CORNER[0], c + CORNER[1]
    e = before = int(state["evidence"][at])
    bottom, top = was = float(state["low"][at]), float(state["high"][at])
    near = count[max(0, r - 1) : r + 2, max(0, c - 1) : c + 2]
    hit = count[r, c] > 0 and near.sum() >= WEAK and count[r, c] * TAIL >= near.max()
    strong = count[r, c] >= STRONG or near.sum() >= 2 * STRONG
    if e > 0:
        tall = top - bottom > 0.05
        heights = [bottom + f * (top - bottom) for f in (np.linspace(0, 1, 6) if tall else [0.5])]
        offset = np.array([(c + 0.5 - EYE[0]) * CELL_M, (r + 0.5 - EYE[1]) * CELL_M])
        said = [image_shows(depth, T[:3, :3].T @ np.array([*offset, z - T[2, 3]])) for z in heights]
        through = said.count("through")
        if not hit and "surface" not in said and 2 * through > len(said):
            e = max(0, e - LOSS)
        left = [z for z, what in zip(heights, said, strict=True) if what != "through"]
        if tall and through and left:
            bottom, top = min(left), max(left)
    if hit:
        bottom = min(bottom, low[r, c]) if e > 0 else float(low[r, c])
        top = max(top, high[r, c]) if e > 0 else float(high[r, c])
        e = min(MOST, e + (GAIN if strong else 1))
    state["evidence"][at], state["low"][at], state["high"][at] = e, bottom, top
    came[r, c] |= MEMORY * (e != before) | (HEIGHTS | MEMORY) * ((bottom, top) != was and e > 0)
    came[r, c] |= SEEN_NOW * (e >= OCCUPIED and hit)
    state["occupancy"][at] = 100 if e >= OCCUPIED else (0 if state["floor"][at] else -1)


def test_forget_pixels_clears_the_pixel_buffers() -> None:
    count, low, high = np.full((3, 4, 5), 7, np.int32)
    cells = np.array(list(np.ndindex(4, 5)), np.int32)
    fuse_kernels.forget_pixels(cells, count, low, high)
    assert not count.any()
    assert (low == NO_LOW).all()
    assert not high.any()


@settings(max_examples=30, deadline=None)
@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_every_pixel_lies_within_the_bins_of_its_view(
    yaw: float, pitch: float, roll: float
) -> None:
    T = camera_pose(0, 0, yaw, pitch, roll)
    grid = GridSpec.centred_on(0, 0, CELL_M, 300)
    view = view_of(np.zeros((48, 64), np.float32), CAMERA, T, grid, 0.1, 5.0)
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    x, y, _ = T[:3, :3] @ [(u.ravel() - 31.5) / 50, (v.ravel() - 23.5) / 50, np.ones(u.size)]
    c, s = view.heading
    forward, left = c * x + s * y, c * y - s * x
    a = left / (np.abs(forward) + np.abs(left))
    diamond = np.where(forward >= 0, 2 + a, np.where(left >= 0, 4 - a, -a))
    bins = np.minimum((diamond * view.azimuth_bins / 4).astype(int), view.azimuth_bins - 1)
    first, end = view.seen_bins
    assert first <= bins.min()
    assert bins.max() < end


@settings(max_examples=20, deadline=None)
@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3), st.floats(0, 2))
def test_no_pixel_of_a_frame_remains_for_the_next_frame(
    yaw: float, pitch: float, roll: float, nearest_m: float
) -> None:
    """All pixels lie in cells that are processed, at any camera orientation."""
    depth = np.random.default_rng(5).uniform(nearest_m, 5.0, (48, 64)).astype(np.float32)
    grid = GridSpec.centred_on(0, 0, CELL_M, 300)
    layer = OccupancyLayer(grid, OccupancyRules(band_rise_per_m=0.0, flying_jump_m=10.0))
    T = camera_pose(0, 0, yaw, pitch, roll)
    layer.integrate(view_of(depth, CAMERA, T, grid, 0.1, 5.0), (0.0, 0.0), 0.0)
    count, low, high = layer._pixels
    assert not count.any()
    assert (low == NO_LOW).all()
    assert not high.any()


def test_sampled_pixels_give_the_same_map_as_all_pixels_to_within_a_cell() -> None:
    camera = Pinhole(300.0, 300.0, 159.5, 119.5, 320, 240)
    blocks = [*room(), *table(2.5, 1.5), Block((3.0, 2.2, 0), (3.03, 2.23, 0.8))]
    grid = GridSpec.centred_on(2.0, 1.5, CELL_M, 200)
    taken, floors, steps = [], [], []
    for rays_per_cell in (0.0, 1.0):
        layer = OccupancyLayer(grid, OccupancyRules())
        for yaw in (0.0, 0.25, 0.5, 0.75):
            T = camera_pose(0.5, 1.5, yaw)
            view = view_of(cast(blocks, T, camera), camera, T, grid, 0.1, 5.0, rays_per_cell)
            layer.integrate(view, (0.5, 1.5), 0.2)
        taken.append((layer.occupancy == TAKEN).astype(np.uint8))
        floors.append(layer.floor_seen > 0)
        steps.append(view.pixel_step)
    assert steps == [1, 3]
    widened = [cv2.dilate(cells, np.ones((3, 3), np.uint8)) for cells in taken]
    assert (taken[0] & (1 - widened[1])).sum() <= 0.01 * taken[0].sum()
    assert not (taken[1] & (1 - widened[0])).any()
    assert taken[1][grid.cell_of(3.01, 2.21)] == 1  # a post of 3 cm
    assert (floors[0] ^ floors[1]).sum() <= 0.06 * floors[0].sum()
