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
    rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
    if not rigid or np.linalg.det(rotation) < 0 or not np.allclose(pose[3], (0, 0, 0, 1)):
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

    Raises InvalidInput when sizes disagree, the pose is not a rigid motion, or the camera stands
    outside the grid.
    """
    depth = check_depth(depth_m, camera)
    pose = check_pose(T_world_cam, "T_world_cam")
    require_inside(grid, pose[0, 3], pose[1, 3], "the camera")

    u = np.array([-0.5, camera.width - 0.5])
    v = np.array([-0.5, camera.height - 0.5])
    corners = np.array([[(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]
                        for x in u for y in v])  # fmt: skip
    reach = corners @ pose[:3, :3].T * max_depth_m
    reach_xy = np.vstack([reach[:, :2], np.zeros(2)]) + pose[:2, 3]
    cells = grid.cells_of(reach_xy)
    row_lo, column_lo = cells.min(axis=0)
    row_hi, column_hi = cells.max(axis=0) + 1
    window = Box(int(row_lo), int(row_hi), int(column_lo), int(column_hi)).grown(1, grid.whole)

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
        range_cells=int(np.linalg.norm(reach[:, :2], axis=1).max() / grid.cell_m) + 2,
        window=window,
    )


def heading_of(T_world_cam: NDArray[np.float64]) -> tuple[float, float]:
    """Unit horizontal direction of view (x, y) of a camera pose."""
    axis = T_world_cam[:2, 2]
    if np.hypot(*axis) < 0.1:
        axis = -T_world_cam[:2, 1] * (1.0 if T_world_cam[2, 2] < 0 else -1.0)
    axis = axis / np.hypot(*axis)
    return float(axis[0]), float(axis[1])


def require_inside(grid: GridSpec, x_m: float, y_m: float, who: str) -> None:
    """InvalidInput when a place lies outside the grid."""
    if not grid.contains(x_m, y_m):
        width_m, height_m = grid.size_m
        x0, y0 = grid.origin_m
        raise InvalidInput(
            f"{who} is at ({x_m:.2f}, {y_m:.2f}) m, outside the map, which spans x {x0:.2f} to "
            f"{x0 + width_m:.2f} and y {y0:.2f} to {y0 + height_m:.2f} m: "
            "start the service with a larger HELIOS_MAP2D_SIZE_CELLS"
        )
