"""Occupancy by ground projection of depth (paper 3.1.1): obstacles and free floor.

A cell collects evidence from pixels whose height lies in the obstacle band. Only a view *through*
the heights at which evidence was found reduces it; floor seen in the same cell does not. So a table
stays although the floor under it is visible, a thin leg stays although most of its cell is floor,
and a chair that was moved away disappears. A cell is floor where depth lies within a tolerance of
z = 0, and between two such places on one line of sight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import UNKNOWN
from numpy.typing import NDArray

from helios_map2d.camera_view import View
from helios_map2d.grid import Box, GridSpec, copy_to_larger_grid
from helios_map2d.kernels import depth_projection as project_kernels
from helios_map2d.kernels import occupancy_fusion as fuse_kernels

FLOOR_TOLERANCE_M = 0.08

Pixels = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]
"""By cell of a window, flat: how many, and the bits of the lowest and highest height."""


@dataclass(frozen=True)
class OccupancyRules:
    """Parameters of occupancy evidence. Lengths in metres; counts are pixels of one frame.

    The band's lower edge rises by `band_rise_per_m` times depth squared, as depth noise does, so
    that distant floor is no obstacle. `weak_pixels` counts a cell and its neighbours,
    `strong_pixels` the cell itself (or twice as many with its neighbours). A cell with less than
    one `tail_ratio`-th of a neighbour's pixels is noise of that neighbour.
    """

    band_lo_m: float = 0.10
    band_hi_m: float = 1.50
    band_rise_per_m: float = 0.006
    floor_tolerance_m: float = FLOOR_TOLERANCE_M
    weak_pixels: int = 3
    strong_pixels: int = 5
    tail_ratio: int = 20
    occupied_evidence: int = 2
    most_evidence: int = 5
    hit_gain: int = 2
    miss_loss: int = 2
    through_tolerance_m: float = 0.03
    through_tolerance_ratio: float = 0.02
    flying_jump_m: float = 0.05
    flying_jump_ratio: float = 0.03
    floor_gap_m: float = 0.30
    shadow_m: float = 0.30
    body_margin_m: float = 0.05

    def __post_init__(self) -> None:
        if self.floor_tolerance_m >= self.band_lo_m:
            raise InvalidInput(
                f"floor tolerance {self.floor_tolerance_m} m reaches into the obstacle band that "
                f"starts at {self.band_lo_m} m: raise band_lo_m"
            )
        if self.band_hi_m <= self.band_lo_m:
            raise InvalidInput(
                f"the obstacle band {self.band_lo_m} to {self.band_hi_m} m is empty: raise its top"
            )


class OccupancyLayer:
    """Occupancy arrays over one grid, and the fusion of views into them.

    Attributes, all `[rows, columns]`: `occupancy` int8 (-1 unknown, 0 free, 100 occupied),
    `z_low_m` and `z_high_m` float32 (lowest and highest obstacle; meaningful where occupied),
    `evidence` uint8, `floor_seen` uint8.
    """

    def __init__(self, grid: GridSpec, rules: OccupancyRules) -> None:
        self.grid = grid
        self.rules = rules
        self.occupancy = np.full(grid.shape, UNKNOWN, np.int8)
        self.z_low_m = np.zeros(grid.shape, np.float32)
        self.z_high_m = np.zeros(grid.shape, np.float32)
        self.evidence = np.zeros(grid.shape, np.uint8)
        self.floor_seen = np.zeros(grid.shape, np.uint8)
        self._tolerance = np.array(
            [rules.through_tolerance_m, rules.through_tolerance_ratio], np.float32
        )
        self._counts = np.array(
            [
                rules.weak_pixels,
                rules.strong_pixels,
                rules.tail_ratio,
                rules.occupied_evidence,
                rules.most_evidence,
                rules.hit_gain,
                rules.miss_loss,
            ]
        )
        # Reused for each frame: fresh memory costs more than the work on it.
        self._active = np.empty((0, 2), np.int32)
        nothing = np.empty(0, np.int32)
        self._pixels: Pixels = nothing, nothing, nothing
        self._marks = np.empty(0, np.uint8)

    def grow(self, grid: GridSpec, known: Box) -> None:
        """Continue on a larger grid; `known` (world cells) contains all known cells."""
        self.occupancy = copy_to_larger_grid(self.occupancy, self.grid, grid, known, UNKNOWN)
        self.z_low_m = copy_to_larger_grid(self.z_low_m, self.grid, grid, known)
        self.z_high_m = copy_to_larger_grid(self.z_high_m, self.grid, grid, known)
        self.evidence = copy_to_larger_grid(self.evidence, self.grid, grid, known)
        self.floor_seen = copy_to_larger_grid(self.floor_seen, self.grid, grid, known)
        self.grid = grid

    def integrate(
        self, view: View, body_xy_m: tuple[float, float], body_radius_m: float
    ) -> NDArray[np.uint8]:
        """Fuse one view and return the flags of its effect on each cell of `view.window`.

        `fuse_kernels.SEEN_NOW`: this view saw the cell; `HEIGHTS`: obstacle heights changed;
        `MEMORY`: stored data of the cell changed, maybe without a visible effect. Pixels on the
        robot's own body (within `body_radius_m` plus a margin of `body_xy_m`) are no obstacles.
        """
        rules, window, cell_m = self.rules, view.window, self.grid.cell_m
        shape = (window.rows, window.columns)
        first_bin, bins_end = view.seen_bins
        ranges, bins = view.range_cells, bins_end - first_bin
        pixels = self._room_for(window)
        marks = self._marks_for(ranges, bins)
        floor = np.empty((ranges + 1, bins), np.uint8)
        floor[-1] = 0
        azimuths = np.array([first_bin, view.azimuth_bins], np.int32)
        heading = np.array(view.heading, np.float32)
        pose = pose_in_window(view)
        limits = np.array(
            [view.min_depth_m, view.max_depth_m, rules.floor_tolerance_m, rules.band_lo_m,
             rules.band_hi_m, rules.band_rise_per_m, rules.flying_jump_m, rules.flying_jump_ratio,
             1.0 / cell_m],
            np.float32,
        )  # fmt: skip
        corner = self.grid.crop(window).origin_m
        radius = (body_radius_m + rules.body_margin_m) / cell_m if body_radius_m > 0 else 0.0
        body = np.array(
            [(body_xy_m[0] - corner[0]) / cell_m, (body_xy_m[1] - corner[1]) / cell_m, radius**2],
            np.float32,
        )
        project_kernels.project_depth(
            view.depth_m, view.pixel_step, intrinsics_of(view), pose, heading, limits, body,
            azimuths, np.array(shape, np.int32), *pixels, marks,
        )  # fmt: skip
        project_kernels.floor_along_azimuths(
            marks, int(rules.floor_gap_m / cell_m), int(rules.shadow_m / cell_m), floor[:-1]
        )
        camera = view.camera
        count, low, high = (a[: window.rows * window.columns].reshape(shape) for a in pixels)
        came_of_it = np.empty(shape, np.uint8)
        found = fuse_kernels.fold_floor(
            pose, heading, azimuths, floor, np.uint8(rules.occupied_evidence),
            (window.row_lo, window.column_lo), view.spans, count,
            self.evidence, self.floor_seen, self.occupancy, came_of_it, self._active,
        )  # fmt: skip
        fuse_kernels.fold_obstacles(
            view.depth_m, np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32), pose,
            np.float32(cell_m),
            self._tolerance, np.float32(view.max_depth_m), self._counts,
            count, low.view(np.float32), high.view(np.float32), self._active[:found],
            (window.row_lo, window.column_lo),
            self.evidence, self.floor_seen, self.z_low_m, self.z_high_m, self.occupancy, came_of_it,
        )  # fmt: skip
        fuse_kernels.forget_pixels(self._active[:found], count, low, high)
        return came_of_it

    def _room_for(self, window: Box) -> Pixels:
        """Cleared arrays for the count of this frame's pixels by cell."""
        cells = window.rows * window.columns
        if cells + 8 > len(self._active):
            self._active = np.empty((cells + 8, 2), np.int32)
            count, high = np.zeros((2, cells), np.int32)
            self._pixels = count, np.full(cells, project_kernels.NO_LOW, np.int32), high
        return self._pixels

    def _marks_for(self, ranges: int, bins: int) -> NDArray[np.uint8]:
        """Cleared array for marks of this frame's pixels by kind, range and azimuth."""
        needed = 3 * ranges * bins
        if needed > len(self._marks):
            self._marks = np.zeros(needed, np.uint8)
        return self._marks[:needed].reshape(3, ranges, bins)

    def clear_disc(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        came_of_it: NDArray[np.uint8],
        corner: tuple[int, int],
    ) -> None:
        """Set the robot's own disc to free. Changes are flagged in `came_of_it`, over a box whose
        corner is at `corner`."""
        row, column = self.grid.cell_of(x_m, y_m)
        reach = math.ceil(radius_m / self.grid.cell_m)
        box = Box(row, row + 1, column, column + 1).grown(reach, self.grid.whole)
        fuse_kernels.clear_disc(
            (box.row_lo, box.row_hi, box.column_lo, box.column_hi),
            self.grid.origin_m,
            self.grid.cell_m,
            (x_m, y_m, radius_m),
            self.evidence,
            self.floor_seen,
            self.occupancy,
            corner,
            came_of_it,
        )


def intrinsics_of(view: View) -> NDArray[np.float32]:
    camera = view.camera
    return np.array([1.0 / camera.fx, 1.0 / camera.fy, camera.cx, camera.cy], np.float32)


def camera_in_window(view: View) -> NDArray[np.float32]:
    """Camera position in cells of the window: column, row."""
    column, row = view.camera_xy_cells
    return np.array([column - view.window.column_lo, row - view.window.row_lo], np.float32)


def pose_in_window(view: View) -> NDArray[np.float32]:
    """Camera pose [3, 4]: axes in the world, position in cells of the window (column, row), and
    height (m)."""
    pose = np.array(view.T_world_cam[:3], np.float32)
    pose[:2, 3] = camera_in_window(view)
    return pose
