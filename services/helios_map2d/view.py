"""One camera view laid over the grid: its window of cells and its azimuth bins.

An image column is not a direction on the ground when the camera is tilted or rolled, so every
measured point is binned by its own azimuth around the camera. The "diamond angle" stands in for
the azimuth: it rises monotonically with it and costs one division instead of an arctangent.
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

MAX_AZIMUTH_BINS = 1440
MIN_AZIMUTH_BINS = 96


@dataclass(frozen=True)
class View:
    """Where a camera stands on the grid and which cells it may touch.

    `heading` is the unit horizontal direction of view in the world: the optical axis, or the
    image's upward direction when the camera looks straight up or down.
    """

    depth_m: NDArray[np.float32]  # [h, w], NaN, infinite and <= 0 are "not measured"
    camera: Pinhole
    T_world_cam: NDArray[np.float64]  # [4, 4]
    min_depth_m: float
    max_depth_m: float
    grid: GridSpec
    heading: tuple[float, float]
    half_fov_rad: float
    azimuth_bins: int
    range_cells: int
    window: Box
    spans: NDArray[np.int32]  # [window rows, 2] the columns that it may touch, half open

    @property
    def camera_xy_cells(self) -> tuple[float, float]:
        """The camera's place in cells, column and row, not rounded."""
        x_m, y_m = self.T_world_cam[0, 3], self.T_world_cam[1, 3]
        origin_x, origin_y = self.grid.origin_m
        return (x_m - origin_x) / self.grid.cell_m, (y_m - origin_y) / self.grid.cell_m


def check_pose(T: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """`T` as float64 [4, 4]; InvalidInput unless it is finite and a rigid motion."""
    pose = np.asarray(T, dtype=np.float64)
    if pose.shape != (4, 4):
        raise InvalidInput(f"{name} has shape {pose.shape}, wanted (4, 4): send a rigid transform")
    if not np.isfinite(pose).all():
        raise InvalidInput(f"{name} holds NaN or infinity: send the pose only once it is known")
    rotation = pose[:3, :3]
    off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    a, b, c = rotation
    handed = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    if off > 1e-3 or handed < 0 or np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise InvalidInput(f"{name} is not a rigid motion: its rotation must be orthonormal")
    return np.ascontiguousarray(pose)


def check_depth(depth_m: NDArray[np.float32], camera: Pinhole) -> NDArray[np.float32]:
    """Depth as contiguous float32 [h, w]; InvalidInput when it does not fit its camera."""
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


def view_of(
    depth_m: NDArray[np.float32],
    camera: Pinhole,
    T_world_cam: NDArray[np.float64],
    grid: GridSpec,
    min_depth_m: float,
    max_depth_m: float,
) -> View:
    """Check an image and its pose, and lay it over the grid.

    What it may touch beyond the grid is left out (see `reach_of`). Raises InvalidInput when sizes
    disagree or the pose is not a rigid motion.
    """
    depth = check_depth(depth_m, camera)
    pose = check_pose(T_world_cam, "T_world_cam")
    rays = corner_rays(camera, pose, max_depth_m)
    window = grid.to_local(box_of(rays, pose, grid.cell_m)).cut(grid.whole)
    bins = int(np.clip(2.6 * camera.fx, MIN_AZIMUTH_BINS, MAX_AZIMUTH_BINS))
    half_fov_rad = max(math.atan(camera.cx / camera.fx),
                       math.atan((camera.width - camera.cx) / camera.fx))  # fmt: skip
    return View(
        depth_m=depth,
        camera=camera,
        T_world_cam=pose,
        min_depth_m=min_depth_m,
        max_depth_m=max_depth_m,
        grid=grid,
        heading=heading_of(pose),
        half_fov_rad=half_fov_rad,
        azimuth_bins=bins,
        range_cells=int(np.linalg.norm(rays[:, :2], axis=1).max() / grid.cell_m) + 2,
        window=window,
        spans=spans_of(rays, pose, grid, window),
    )


def reach_of(
    camera: Pinhole, T_world_cam: NDArray[np.float64], cell_m: float, max_depth_m: float
) -> Box:
    """The world cells that a view may touch. Raises InvalidInput for a pose that is none."""
    pose = check_pose(T_world_cam, "T_world_cam")
    return box_of(corner_rays(camera, pose, max_depth_m), pose, cell_m)


def corner_rays(
    camera: Pinhole, T_world_cam: NDArray[np.float64], depth_m: float
) -> NDArray[np.float64]:
    """From the camera to the image's corners at a depth, [4, 3] in world axes."""
    u = np.array([-0.5, camera.width - 0.5])
    v = np.array([-0.5, camera.height - 0.5])
    corners = np.array([[(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]
                        for x in u for y in v])  # fmt: skip
    return corners @ T_world_cam[:3, :3].T * depth_m


def box_of(rays_m: NDArray[np.float64], T_world_cam: NDArray[np.float64], cell_m: float) -> Box:
    """The world cells around a camera and the ends of its rays, and one more on each side."""
    ends = np.vstack([rays_m[:, :2], np.zeros(2)]) + T_world_cam[:2, 3]
    column_lo, row_lo = np.floor(ends.min(axis=0) / cell_m)
    column_hi, row_hi = np.floor(ends.max(axis=0) / cell_m) + 1
    return Box(int(row_lo), int(row_hi), int(column_lo), int(column_hi)).grown(1)


def spans_of(
    rays_m: NDArray[np.float64], T_world_cam: NDArray[np.float64], grid: GridSpec, window: Box
) -> NDArray[np.int32]:
    """The columns of each row of `window` within two cells of the ground under a view: [rows, 2].

    A view lies within the convex hull of its camera and the ends of its corner rays.
    """
    ends = np.vstack([rays_m[:, :2], np.zeros(2)]) + T_world_cam[:2, 3]
    corner = np.array([grid.corner[1] + window.column_lo, grid.corner[0] + window.row_lo])
    spans = np.empty((window.rows, 2), np.int32)
    spans_between(ends / grid.cell_m - corner, window.columns, spans)
    return spans


@njit(cache=True, nogil=True)
def spans_between(points, columns, spans):
    """The columns of each row within two cells of the convex hull of `points` float64 [n, 2]
    (column, row): half open, into `spans` int32 [rows, 2]."""
    for row in range(spans.shape[0]):
        bottom, top = row - 2.0, row + 3.0
        low, high = np.inf, -np.inf
        for i in range(points.shape[0]):
            for j in range(i):  # every segment between two points lies within the hull
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
    axis = T_world_cam[:2, 2]
    if np.hypot(*axis) < 0.1:
        axis = -T_world_cam[:2, 1] * (1.0 if T_world_cam[2, 2] < 0 else -1.0)
    axis = axis / np.hypot(*axis)
    return float(axis[0]), float(axis[1])
