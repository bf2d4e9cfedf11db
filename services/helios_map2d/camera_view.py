"""Projection of a camera view onto the grid: its window of cells and its azimuth bins.

If the camera is tilted or rolled, an image column is not one direction on the ground. So each
measured point is binned by its own azimuth around the camera. The "diamond angle" replaces the
azimuth: it rises monotonically with it and needs one division instead of an arctangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole
from numba import njit
from numpy.typing import NDArray

from helios_map2d.grid import Box, GridSpec

SATURATED_M = 65.5
MAX_AZIMUTH_BINS = 1440
MIN_AZIMUTH_BINS = 96
LEAST_AHEAD = 0.1  # a smaller horizontal part of the optical axis: straight up or down
RAYS_PER_CELL = 1.0
Ray = tuple[float, float, float]


@dataclass(frozen=True)
class View:
    """Depth image with the camera's place on the grid and the cells that it may change.

    `heading` is the unit horizontal direction of view in the world: the optical axis, or the
    image's upward direction if the camera looks straight up or down.
    """

    depth_m: NDArray[np.float32]  # [h, w]; NaN, infinite and <= 0 mean "not measured"
    camera: Pinhole
    T_world_cam: NDArray[np.float64]  # [4, 4]
    min_depth_m: float
    max_depth_m: float
    grid: GridSpec
    heading: tuple[float, float]
    half_fov_rad: float
    azimuth_bins: int
    seen_bins: tuple[int, int]  # bins that it may see, half open
    range_cells: int
    pixel_step: int  # step between processed pixels of a row, and between processed rows
    window: Box
    spans: NDArray[np.int32]  # [window rows, 2] columns that it may change, half open

    @property
    def camera_xy_cells(self) -> tuple[float, float]:
        """Camera position in cells (column, row), not rounded."""
        x_m, y_m = self.T_world_cam[0, 3], self.T_world_cam[1, 3]
        origin_x, origin_y = self.grid.origin_m
        return (x_m - origin_x) / self.grid.cell_m, (y_m - origin_y) / self.grid.cell_m


def check_pose(T: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """`T` as float64 [4, 4]. Raises InvalidInput if it is not finite or not rigid."""
    pose = np.ascontiguousarray(T, dtype=np.float64)
    if pose.shape != (4, 4):
        raise InvalidInput(f"{name} has shape {pose.shape}, wanted (4, 4): send a rigid transform")
    a, b, c, last = pose.tolist()  # plain floats: faster than numpy for so few numbers
    if not all(map(math.isfinite, (*a, *b, *c, *last))):
        raise InvalidInput(f"{name} holds NaN or infinity: send the pose only once it is known")
    pairs = ((a, a, 1), (b, b, 1), (c, c, 1), (a, b, 0), (a, c, 0), (b, c, 0))
    off = max(abs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] - same) for p, q, same in pairs)
    handed = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    apart = max(map(abs, (last[0], last[1], last[2], last[3] - 1.0)))
    if off > 1e-3 or handed < 0 or apart > 1e-6:
        raise InvalidInput(f"{name} is not a rigid motion: its rotation must be orthonormal")
    return pose


def check_depth(depth_m: NDArray[np.float32], camera: Pinhole) -> NDArray[np.float32]:
    """Depth as contiguous float32 [h, w]. Raises InvalidInput if it does not fit its camera."""
    depth = np.asarray(depth_m)
    wanted = (camera.height, camera.width)
    if depth.shape != wanted:
        raise InvalidInput(
            f"depth is {depth.shape}, the calibration says {wanted} (height, width): "
            "send the calibration of this very image"
        )
    if depth.dtype.kind != "f":
        raise InvalidInput(f"depth is {depth.dtype}, wanted metres as float32: convert it first")
    if not (camera.fx > 0 and camera.fy > 0 and math.isfinite(camera.fx * camera.fy)):
        raise InvalidInput(f"focal lengths are {camera.fx}, {camera.fy} px, wanted above 0")
    return np.ascontiguousarray(depth, dtype=np.float32)


def without_saturated_depth(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """The depth image, with 0 in place of saturated values: infinite, or at the limit of 16 bits of
    millimetres. Such a value is no evidence of free space in front of it."""
    if not any_from(depth_m, np.float32(SATURATED_M)):
        return depth_m
    return np.where(depth_m >= SATURATED_M, np.float32(0), depth_m)


@njit(cache=True, nogil=True)
def any_from(depth_m, least_m):
    """True if any value of float32 [h, w] is at least `least_m`."""
    for v in range(depth_m.shape[0]):
        row, found = depth_m[v], False
        for u in range(row.size):  # no early exit, so that it runs in SIMD
            found |= row[u] >= least_m
        if found:
            return True
    return False


@dataclass(frozen=True)
class ViewExtent:
    """Extent of a camera view: the checked pose, the rays to the image corners at the largest depth
    in world axes (m), and the world cells that the view may change."""

    T_world_cam: NDArray[np.float64]
    rays_m: list[Ray]
    box: Box


def view_of(
    depth_m: NDArray[np.float32],
    camera: Pinhole,
    T_world_cam: NDArray[np.float64],
    grid: GridSpec,
    min_depth_m: float,
    max_depth_m: float,
    rays_per_cell: float = RAYS_PER_CELL,
) -> View:
    """View of an image after checks of image and pose; see `view_on_grid`.

    Raises InvalidInput if sizes disagree or the pose is not rigid.
    """
    reach = view_extent(camera, T_world_cam, grid.cell_m, max_depth_m)
    depth = check_depth(depth_m, camera)
    return view_on_grid(depth, camera, reach, grid, min_depth_m, max_depth_m, rays_per_cell)


def view_on_grid(
    depth_m: NDArray[np.float32],
    camera: Pinhole,
    reach: ViewExtent,
    grid: GridSpec,
    min_depth_m: float,
    max_depth_m: float,
    rays_per_cell: float,
) -> View:
    """View of a checked image, cut to the grid. `reach` is for the same largest depth.

    `rays_per_cell`: see `pixel_step`.
    """
    depth = without_saturated_depth(depth_m)
    pose, rays = reach.T_world_cam, reach.rays_m
    window = grid.to_local(reach.box).intersection(grid.whole)
    bins = min(max(int(2.6 * camera.fx), MIN_AZIMUTH_BINS), MAX_AZIMUTH_BINS)
    half_fov_rad = max(
        math.atan(camera.cx / camera.fx), math.atan((camera.width - camera.cx) / camera.fx)
    )
    heading = heading_of(pose)
    return View(
        depth_m=depth,
        camera=camera,
        T_world_cam=pose,
        min_depth_m=min_depth_m,
        max_depth_m=max_depth_m,
        grid=grid,
        heading=heading,
        half_fov_rad=half_fov_rad,
        azimuth_bins=bins,
        seen_bins=bins_of(rays, camera, pose, heading, bins),
        range_cells=int(max(math.hypot(x, y) for x, y, _ in rays) / grid.cell_m) + 2,
        pixel_step=pixel_step(camera, grid.cell_m, max_depth_m, rays_per_cell),
        window=window,
        spans=spans_of(rays, pose, grid, window),
    )


def view_extent(
    camera: Pinhole, T_world_cam: NDArray[np.float64], cell_m: float, max_depth_m: float
) -> ViewExtent:
    """Extent of a camera view. Raises InvalidInput if the pose is not rigid."""
    pose = check_pose(T_world_cam, "T_world_cam")
    rays = corner_rays(camera, pose, max_depth_m)
    return ViewExtent(pose, rays, box_of(rays, pose, cell_m))


def pixel_step(camera: Pinhole, cell_m: float, max_depth_m: float, rays_per_cell: float) -> int:
    """Step between processed pixels of a row, and between processed rows: the largest step with
    `rays_per_cell` rays across a cell at the largest depth. 0 rays: step 1."""
    if rays_per_cell <= 0:
        return 1
    finest_px = min(camera.fx, camera.fy) * cell_m / max_depth_m
    return max(1, int(finest_px / rays_per_cell))


def corner_rays(camera: Pinhole, T_world_cam: NDArray[np.float64], depth_m: float) -> list[Ray]:
    """Vectors from the camera to the image corners at a depth, in world axes."""
    (a, b, c), (d, e, f), (g, h, i) = T_world_cam[:3, :3].tolist()
    us = [(u - camera.cx) / camera.fx for u in (-0.5, camera.width - 0.5)]
    vs = [(v - camera.cy) / camera.fy for v in (-0.5, camera.height - 0.5)]
    rays = [(a * u + b * v + c, d * u + e * v + f, g * u + h * v + i) for u in us for v in vs]
    return [(depth_m * x, depth_m * y, depth_m * z) for x, y, z in rays]


def box_of(rays_m: list[Ray], T_world_cam: NDArray[np.float64], cell_m: float) -> Box:
    """World cells around a camera and the ends of its rays, plus one cell on each side."""
    x_m, y_m = T_world_cam[:2, 3].tolist()
    xs, ys = [0.0, *(x for x, _, _ in rays_m)], [0.0, *(y for _, y, _ in rays_m)]
    return Box(
        math.floor((y_m + min(ys)) / cell_m) - 1,
        math.floor((y_m + max(ys)) / cell_m) + 2,
        math.floor((x_m + min(xs)) / cell_m) - 1,
        math.floor((x_m + max(xs)) / cell_m) + 2,
    )


def bins_of(
    rays_m: list[Ray],
    camera: Pinhole,
    T_world_cam: NDArray[np.float64],
    heading: tuple[float, float],
    bins: int,
) -> tuple[int, int]:
    """Azimuth bins that an image may see, half open, plus two bins on each side."""
    c, s = heading
    down = T_world_cam[2, :3].tolist()  # the vertical in camera axes
    ahead = abs(down[2]) if down[2] else 1e-9
    sign = math.copysign(1.0, down[2])
    u = camera.fx * sign * down[0] / ahead + camera.cx
    v = camera.fy * sign * down[1] / ahead + camera.cy
    overhead = -1 <= u <= camera.width and -1 <= v <= camera.height
    if overhead or math.hypot(*T_world_cam[:2, 2].tolist()) < LEAST_AHEAD:
        return 0, bins  # the view contains the point straight below or above: all directions
    angles = [diamond(c * x + s * y, c * y - s * x) * bins / 4 for x, y, _ in rays_m]
    return max(0, math.floor(min(angles)) - 2), min(bins, math.floor(max(angles)) + 3)


def diamond(forward: float, left: float) -> float:
    """Diamond angle, 0..4, which rises with the azimuth from -pi to pi; 2 is straight ahead."""
    a = left / ((abs(forward) + abs(left)) or 1.0)
    if forward >= 0:
        return 2 + a
    return 4 - a if left >= 0 else -a


def spans_of(
    rays_m: list[Ray], T_world_cam: NDArray[np.float64], grid: GridSpec, window: Box
) -> NDArray[np.int32]:
    """Columns in each row of `window` within two cells of the ground under a view: [rows, 2].

    A view lies within the convex hull of its camera and the ends of its corner rays.
    """
    x_m, y_m = T_world_cam[:2, 3].tolist()
    column, row = grid.corner[1] + window.column_lo, grid.corner[0] + window.row_lo
    points = np.array(
        [
            ((x + x_m) / grid.cell_m - column, (y + y_m) / grid.cell_m - row)
            for x, y, _ in (*rays_m, (0.0, 0.0, 0.0))
        ]
    )
    spans = np.empty((window.rows, 2), np.int32)
    spans_between(points, window.columns, spans)
    return spans


@njit(cache=True, nogil=True)
def spans_between(points, columns, spans):
    """Write to `spans` int32 [rows, 2] the columns of each row within two cells of the convex hull
    of `points` float64 [n, 2] (column, row), half open."""
    for row in range(spans.shape[0]):
        bottom, top = row - 2.0, row + 3.0
        low, high = np.inf, -np.inf
        for i in range(points.shape[0]):
            for j in range(i):  # segments between two points lie within the hull
                x0, y0 = points[i]
                x1, y1 = points[j]
                if y0 > y1:
                    x0, y0, x1, y1 = x1, y1, x0, y0
                if top < y0 or bottom > y1:
                    continue
                a, b = x0, x1
                if y1 - y0 > 1e-9:
                    slope = (x1 - x0) / (y1 - y0)
                    a = x0 + slope * (min(max(bottom, y0), y1) - y0)
                    b = x0 + slope * (min(max(top, y0), y1) - y0)
                low = min(low, a, b)
                high = max(high, a, b)
        first = last = 0
        if low <= high:
            first = min(max(math.floor(low) - 2, 0), columns)
            last = min(max(math.ceil(high) + 3, 0), columns)
        spans[row, 0] = first
        spans[row, 1] = last


def heading_of(T_world_cam: NDArray[np.float64]) -> tuple[float, float]:
    """Unit horizontal direction of view (x, y) of a camera pose."""
    x, y = T_world_cam[:2, 2].tolist()
    if math.hypot(x, y) < LEAST_AHEAD:
        sign = 1.0 if T_world_cam[2, 2] < 0 else -1.0
        x, y = (-sign * v for v in T_world_cam[:2, 1].tolist())
    far = math.hypot(x, y)
    return x / far, y / far
