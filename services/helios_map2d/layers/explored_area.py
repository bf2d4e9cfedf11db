"""Explored area: the floor that views have seen, by depth (default) or by cone of view (VLFM).

`DepthVisibility` counts only cells measured by depth, which `occupancy` has marked.
`ConeVisibility` counts the whole cone of view up to known obstacles.
"""

from __future__ import annotations

import math
from typing import Protocol

import cv2
import numpy as np
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN
from numpy.typing import NDArray

from helios_map2d.camera_view import View
from helios_map2d.grid import EMPTY, Box, GridSpec, copy_to_larger_grid
from helios_map2d.kernels import flood_fill as flood_kernels
from helios_map2d.kernels import tile_changes as change_kernels
from helios_map2d.kernels.occupancy_fusion import SEEN_NOW
from helios_map2d.layers.occupancy import OccupancyLayer
from helios_map2d.layers.value_layers import Cone, bin_directions, cone_of


class ExplorationRule(Protocol):
    """Rule that decides which ground a view explores."""

    def reach_m(self, max_depth_m: float) -> float:
        """Distance from the robot up to which cells outside the view's window may change."""
        ...

    def cone(self, view: View) -> Cone:
        """Cone over which a view's score is spread."""
        ...

    def mark(
        self,
        view: View,
        layer: OccupancyLayer,
        came_of_it: NDArray[np.uint8],
        box: Box,
    ) -> None:
        """Set the flag of seen cells in `came_of_it` (over `box`), after fusion of occupancy."""
        ...

    def tidy(
        self, layer: OccupancyLayer, search: ExploredArea, cell: tuple[int, int], box: Box
    ) -> None:
        """Correct the explored area after the fusion of a frame; `cell` is the robot's."""
        ...


class DepthVisibility:
    """Rule that counts only cells measured by depth."""

    def reach_m(self, max_depth_m: float) -> float:
        return 0.0

    def cone(self, view: View) -> Cone:
        return cone_of(view)

    def mark(
        self,
        view: View,
        layer: OccupancyLayer,
        came_of_it: NDArray[np.uint8],
        box: Box,
    ) -> None:
        pass

    def tidy(
        self, layer: OccupancyLayer, search: ExploredArea, cell: tuple[int, int], box: Box
    ) -> None:
        pass


class ConeVisibility:
    """VLFM's rule: it counts the cone of view up to known obstacles.

    Obstacles are dilated by a square of the robot's diameter, an odd number of cells, as in VLFM.
    """

    def __init__(self, robot_radius_m: float, cell_m: float) -> None:
        self._square = np.ones((int(2 * robot_radius_m / cell_m) // 2 * 2 + 1,) * 2, np.uint8)

    def reach_m(self, max_depth_m: float) -> float:
        return max_depth_m

    def cone(self, view: View) -> Cone:
        return cone_by_column(view)

    def mark(
        self,
        view: View,
        layer: OccupancyLayer,
        came_of_it: NDArray[np.uint8],
        box: Box,
    ) -> None:
        occupancy, floor_seen = layer.occupancy[box.slices], layer.floor_seen[box.slices]
        blocked = self._blocked(layer.occupancy, box)
        column, row = (math.floor(v) for v in view.camera_xy_cells)
        seen = seen_of_cone(
            blocked,
            (row - box.row_lo, column - box.column_lo),
            math.atan2(*view.heading[::-1]),
            view.half_fov_rad,
            view.max_depth_m / layer.grid.cell_m,
        )
        came_of_it &= np.uint8(255 - SEEN_NOW)
        came_of_it[cv2.dilate(seen, np.ones((3, 3), np.uint8)) > 0] |= np.uint8(SEEN_NOW)
        open_cells = (seen > 0) & (blocked == 0)
        floor_seen[open_cells] = 1
        occupancy[open_cells & (occupancy == UNKNOWN)] = FREE

    def tidy(
        self,
        layer: OccupancyLayer,
        search: ExploredArea,
        cell: tuple[int, int],
        box: Box,
    ) -> None:
        search.take_back(self._blocked(layer.occupancy, box) > 0, box)
        part = search.grid.to_local(search.box)
        search.explored[part.slices] = part_around(
            search.explored[part.slices].copy(), (cell[0] - part.row_lo, cell[1] - part.column_lo)
        )

    def _blocked(self, occupancy: NDArray[np.int8], box: Box) -> NDArray[np.uint8]:
        """Array over `box`, 1 where an obstacle is nearer than the robot's radius."""
        whole = Box(0, occupancy.shape[0], 0, occupancy.shape[1])
        around = box.grown(len(self._square), whole)
        wide = cv2.dilate((occupancy[around.slices] == OCCUPIED).astype(np.uint8), self._square)
        return np.asarray(wide[box.moved(-around.row_lo, -around.column_lo).slices], np.uint8)


def seen_of_cone(
    blocked: NDArray[np.uint8],
    camera: tuple[int, int],
    yaw_rad: float,
    half_fov_rad: float,
    reach_cells: float,
) -> NDArray[np.uint8]:
    """Visible cells of a cone of view between obstacles: uint8, as `blocked` [rows, columns].

    `camera` is its cell (row, column). Obstacles cast shadows from their outline points, convex
    ones from their two extreme points; the edge of a shadow is two cells wide. Only the piece that
    begins within three cells of the camera is visible. A cone without obstacles is completely
    visible; in VLFM none of it is.
    """
    at = (camera[1], camera[0])
    cone = np.zeros(blocked.shape, np.uint8)
    sides_deg = math.degrees(yaw_rad - half_fov_rad), math.degrees(yaw_rad + half_fov_rad)
    cv2.ellipse(cone, at, (int(reach_cells),) * 2, 0, *sides_deg, 1, cv2.FILLED)
    outlines, _ = cv2.findContours(cone & blocked, cv2.RETR_TREE, cv2.CHAIN_APPROX_SIMPLE)
    if not outlines:
        return cone
    out = np.zeros(blocked.shape, np.uint8)
    seen = cone & (1 - blocked)
    for outline in outlines:
        off = outline.reshape(-1, 2).astype(np.float64) - at
        angle = np.arctan2(off[:, 1], off[:, 0])
        ends = off + at + 1.05 * reach_cells * np.stack([np.cos(angle), np.sin(angle)], 1)
        edges = np.stack([off + at, np.trunc(ends)], 1).astype(np.int32)
        if cv2.isContourConvex(outline):
            turned = np.angle(np.exp(1j * (angle - yaw_rad)))
            edges = edges[[int(np.argmin(turned)), int(np.argmax(turned))]]
        cv2.polylines(seen, list(edges), False, (0,), 2)
    pieces, _ = cv2.findContours(seen, cv2.RETR_TREE, cv2.CHAIN_APPROX_SIMPLE)
    far = [abs(cv2.pointPolygonTest(p, (float(at[0]), float(at[1])), True)) for p in pieces]
    if far and min(far) <= 3:
        cv2.drawContours(out, [pieces[far.index(min(far))]], 0, (1,), cv2.FILLED)
    return out


def cone_by_column(view: View) -> Cone:
    """Cone of a view as in VLFM: the image columns are evenly spread directions over the field of
    view, and a column's largest depth is its range (unmeasured pixels count as the maximum)."""
    depth = view.depth_m
    good = (depth > view.min_depth_m) & (depth < view.max_depth_m)
    farthest = np.where(good, depth, view.max_depth_m).max(axis=0)
    forward, left = bin_directions(view.azimuth_bins)
    angle = np.arctan2(left, forward)
    inside = np.abs(angle) <= view.half_fov_rad
    columns = np.linspace(view.half_fov_rad, -view.half_fov_rad, len(farthest))
    along = np.interp(angle, columns[::-1], farthest[::-1])
    reach = np.where(inside, along / np.maximum(np.cos(angle), 0.1), 0).astype(np.float32)
    x_m, y_m = view.T_world_cam[:2, 3]
    return Cone(float(x_m), float(y_m), view.heading, view.half_fov_rad, reach)


def part_around(explored: NDArray[np.uint8], cell: tuple[int, int]) -> NDArray[np.uint8]:
    """The 8-connected part of `explored` [rows, columns] that contains a cell or is nearest to it,
    with its holes filled."""
    outlines, _ = cv2.findContours(explored, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if len(outlines) < 2:
        return explored
    at = (float(cell[1]), float(cell[0]))
    # The distance is positive inside, so a part that contains the cell wins, else the nearest.
    nearest = max(outlines, key=lambda outline: cv2.pointPolygonTest(outline, at, True))
    out = np.zeros(explored.shape, np.uint8)
    cv2.drawContours(out, [nearest], 0, 1, cv2.FILLED)
    return out


class ExploredArea:
    """Explored area of the current search: `explored` uint8 [rows, columns] is 1 in seen cells;
    `box` (world cells) contains all of them."""

    def __init__(self, grid: GridSpec) -> None:
        self.grid = grid
        self.explored = np.zeros(grid.shape, np.uint8)
        self.box = EMPTY

    def grow(self, grid: GridSpec) -> None:
        """Continue on a larger grid."""
        self.explored = copy_to_larger_grid(self.explored, self.grid, grid, self.box)
        self.grid = grid

    def reset(self) -> None:
        self.explored[self.grid.to_local(self.box).slices] = 0
        self.box = EMPTY

    def add(self, seen: NDArray[np.uint8], window: Box) -> None:
        """Mark the cells that one view saw (flags over `window`, `SEEN_NOW`) as explored."""
        change_kernels.merge_seen(seen, self.explored[window.slices])
        self.box = self.grid.to_world(window).union(self.box)

    def take_back(self, cells: NDArray[np.bool_], window: Box) -> None:
        """Mark cells (bool over `window`) as not explored."""
        self.explored[window.slices][cells] = 0

    def add_near_robot(
        self, occupancy: NDArray[np.int8], x_m: float, y_m: float, radius_m: float
    ) -> None:
        """Mark the ground around the robot as explored, up to the obstacles around it."""
        row, column = self.grid.cell_of(x_m, y_m)
        radius_cells = radius_m / self.grid.cell_m
        reach = int(radius_cells) + 1
        box = Box(row, row + 1, column, column + 1).grown(reach, self.grid.whole)
        self.add(near_ground(occupancy, box, (row, column), radius_cells), box)


def near_ground(
    occupancy: NDArray[np.int8], box: Box, cell: tuple[int, int], radius_cells: float
) -> NDArray[np.uint8]:
    """Cells of `box` within a radius of `cell` that a path without obstacles reaches: uint8."""
    near = np.zeros((box.rows, box.columns), np.uint8)
    flood_kernels.near_ground(occupancy, (box.row_lo, box.column_lo), cell, radius_cells, near)
    return near
