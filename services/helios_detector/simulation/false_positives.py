"""Simulated false positives on furniture, walls and floors.

World-fixed cubes of `cell_m` divide the surfaces in view. Each cell of each surface may show each
search class, by persistent draws (`view_noise.py`). The position is the surface point nearest to a
point of the cube picked by hash. So a false object keeps its position while the camera passes, and
appears or disappears with the viewing direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from helios_core.geometry import Pinhole, lift_pixels
from helios_core.name_rules import plain
from helios_core.types import Frame
from numpy.typing import NDArray

from helios_detector.simulation.mask_errors import Box, Masked, trimmed
from helios_detector.simulation.search import Search
from helios_detector.simulation.view_noise import keys_of, mixed, normal_draws, uniform
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from helios_detector.simulator_truth import Truth, TruthInstance
from helios_detector.vocabulary_matching import SearchTarget

STRIDE_PX = 8  # stride at which surfaces are sampled
MOST_RIM_PX = 24  # largest image margin without false positives
CELL_ORIGIN_M = np.array([0.13, 0.07, 0.23])  # keeps floors and table tops off the cell borders
_AXES = keys_of(("place x", "place y", "place z"))
_STANDARD = NormalDist()


@dataclass(frozen=True)
class FalsePositive:
    """One false positive as reported."""

    want: SearchTarget
    score: float
    box_xyxy: Box
    crop: NDArray[np.bool_]


@dataclass(frozen=True)
class Cells:
    """The n surface cells in view."""

    keys: NDArray[np.uint64]  # [n]
    voxels: NDArray[np.int64]  # [n, 3]
    instances: tuple[TruthInstance, ...]  # [n] instance of each surface
    of_point: NDArray[np.int64]  # [points] cell of each sample
    points_m: NDArray[np.float64]  # [points, 3] samples, world
    pixels: NDArray[np.int64]  # [points, 2] row and column of each sample


def ghosts(
    frame: Frame,
    truth: Truth,
    search: Search,
    table: ViewNoiseTable,
    key_of_instance: Callable[[TruthInstance], int],
) -> list[FalsePositive]:
    """All false positives of a frame."""
    if table.level == 0 or table.file.scale.false == 0 or not search.wanted:
        return []
    cells = surface_cells(frame, truth, table, key_of_instance)
    if cells is None:
        return []
    cell_m = table.file.false_positive.cell_m
    middles_m = np.asarray((cells.voxels + 0.5) * cell_m + CELL_ORIGIN_M, np.float64)
    eye_m = frame.T_world_cam[:3, 3]
    views, _ = table.views(cells.keys, eye_m, middles_m, None)
    at, of, _ = search.false.below(views, limits(cells, search, table), frame.stamp_ns)
    if not len(at):
        return []
    draws = uniform(
        normal_draws(views.part(at), search.false_keys[of], table.shares, frame.stamp_ns)
    )
    out = []
    for n, k, (u_score, u_size) in zip(at.tolist(), of.tolist(), draws.tolist(), strict=True):
        want, score = search.wanted[k], table.score("false", u_score, 1)
        if score < want.threshold:
            continue
        purpose = int(search.false.purposes[k])
        masked = _blob(frame, truth, cells, n, purpose, want, u_size, table)
        if masked is not None:
            out.append(FalsePositive(want, score, *masked))
    return out


def surface_cells(
    frame: Frame,
    truth: Truth,
    table: ViewNoiseTable,
    key_of_instance: Callable[[TruthInstance], int],
) -> Cells | None:
    """The visible cells of surfaces that may carry false positives; None without any."""
    f = table.file.false_positive
    half = STRIDE_PX // 2
    c = frame.camera
    depth_m = frame.depth_m[half::STRIDE_PX, half::STRIDE_PX]
    ids = truth.ids[half::STRIDE_PX, half::STRIDE_PX]
    hosts = {
        id: i
        for id, i in truth.instances.items()
        if id and not i.graspable and plain(i.class_name) not in f.never_on
    }
    if not hosts:
        return None
    usable = np.zeros(int(max(ids.max(), *hosts)) + 1, bool)
    usable[list(hosts)] = True
    with np.errstate(invalid="ignore"):
        good = usable[ids] & (depth_m > 0) & (depth_m < f.max_distance_m)
    rows, columns = np.nonzero(good)
    if not len(rows):
        return None
    v, u, z = rows * STRIDE_PX + half, columns * STRIDE_PX + half, depth_m[rows, columns]
    points_cam = np.stack([(u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z], -1)
    points_m = points_cam @ frame.T_world_cam[:3, :3].T + frame.T_world_cam[:3, 3]
    voxels = np.floor((points_m - CELL_ORIGIN_M) / f.cell_m).astype(np.int64)
    own = np.zeros(len(usable), np.uint64)
    for id, instance in hosts.items():
        own[id] = key_of_instance(instance)
    point_ids = ids[rows, columns]
    keys = own[point_ids]
    for column in voxels.T:
        keys = mixed(keys, column.view(np.uint64))
    keys, first, of_point = np.unique(keys, return_index=True, return_inverse=True)
    instances = tuple(hosts[int(id)] for id in point_ids[first])
    pixels = np.stack([v, u], -1)
    return Cells(keys, voxels[first], instances, of_point.ravel(), points_m, pixels)


def limits(cells: Cells, search: Search, table: ViewNoiseTable) -> NDArray[np.float64]:
    """Draws [cells, classes] below which a false positive appears; -inf on surfaces of the class
    itself."""
    f = table.file.false_positive
    names = [plain(i.class_name) for i in cells.instances]
    on_structure = np.array([name in f.structure for name in names])
    kinds = np.array(
        [[_limit(table.false(s, is_object)) for is_object in (False, True)] for s in (False, True)]
    )
    out = kinds[on_structure.astype(int)[:, None], search.is_object.astype(int)]
    for n, name in enumerate(names):
        if own := search.matching(name):
            out[n, list(own)] = -math.inf
    return out


def _limit(rate: float) -> float:
    return _STANDARD.inv_cdf(rate) if 0 < rate < 1 else math.copysign(math.inf, rate - 0.5)


def _blob(
    frame: Frame,
    truth: Truth,
    cells: Cells,
    n: int,
    purpose: int,
    want: SearchTarget,
    u_size: float,
    table: ViewNoiseTable,
) -> Masked | None:
    """Surface pixels within a ball around the false positive's position; None if too few or at the
    image border."""
    f = table.file.false_positive
    low_m, high_m = f.object_radius_m if want.is_object else f.receptacle_radius_m
    radius_m = low_m + u_size * (high_m - low_m)
    base = mixed(cells.keys[n : n + 1], np.array([purpose], np.uint64))
    in_cell = (mixed(base, _AXES) >> np.uint64(11)).astype(np.float64) / 2**53
    wished_m = (cells.voxels[n] + in_cell) * f.cell_m + CELL_ORIGIN_M
    members = np.flatnonzero(cells.of_point == n)
    at = members[np.argmin(((cells.points_m[members] - wished_m) ** 2).sum(-1))]
    v, u = cells.pixels[at]
    c = frame.camera
    reach = math.ceil(1.2 * radius_m * c.fx / max(0.2, float(frame.depth_m[v, u]))) + STRIDE_PX
    h, w = frame.depth_m.shape
    rim = min(reach, MOST_RIM_PX)
    if not (rim <= u < w - rim and rim <= v < h - rim):
        return None  # at the border the visible part of the surface would shift its position
    x0, y0 = max(0, int(u) - reach), max(0, int(v) - reach)
    x1, y1 = min(w, int(u) + reach + 1), min(h, int(v) + reach + 1)
    own = truth.ids[y0:y1, x0:x1] == cells.instances[n].id
    rows = np.flatnonzero(own.any(axis=1))
    own = own[rows[0] : rows[-1] + 1]
    y0, y1 = y0 + int(rows[0]), y0 + int(rows[-1]) + 1
    depth_m = frame.depth_m[y0:y1, x0:x1]
    own &= (depth_m > 0) & (depth_m < np.inf)
    if np.count_nonzero(own) < f.min_px:
        return None
    camera = Pinhole(c.fx, c.fy, c.cx - x0, c.cy - y0, x1 - x0, y1 - y0)
    points_m = lift_pixels(depth_m, camera, frame.T_world_cam)[own]
    center_m = points_m[np.argmin(_squares(points_m - wished_m))]  # at full resolution
    crop = np.zeros_like(own)
    crop[own] = _squares(points_m - center_m) < radius_m**2
    if np.count_nonzero(crop) < f.min_px:
        return None
    return trimmed((x0, y0, x1, y1), crop)


def _squares(offsets_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared lengths [n] of offsets [n, 3]."""
    x, y, z = offsets_m.T
    return x * x + y * y + z * z
