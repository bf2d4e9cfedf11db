"""Explored area the way VLFM counts it: the whole cone of view out to the largest depth, as far as
no known obstacle, widened by the robot's radius, stands in the way; and of all that, the one part
that the robot stands in, with its holes filled.

Our own way (see `occupancy`) believes only what depth really measured. This one serves to compare
with VLFM on equal terms.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_map2d.explored import SearchArea
from helios_map2d.fuse_kernels import SEEN_NOW
from helios_map2d.grid import Box
from helios_map2d.ground import OpenGround
from helios_map2d.occupancy import OccupancyLayer
from helios_map2d.value import Cone, bin_directions
from helios_map2d.view import View


class ByCone:
    """VLFM's way to count ground as explored; see `exploring.Exploring`."""

    def reach_m(self, max_depth_m: float) -> float:
        return max_depth_m

    def cone(self, view: View) -> Cone:
        return cone_by_column(view)

    def mark(
        self,
        view: View,
        layer: OccupancyLayer,
        ground: OpenGround,
        before: NDArray[np.int8],
        came_of_it: NDArray[np.uint8],
        box: Box,
    ) -> NDArray[np.int8]:
        ground.update(layer.occupancy, before, box)
        followed = layer.occupancy[box.slices].copy()
        reveal(layer, view, ground.crowd, came_of_it, box)
        return followed

    def tidy(self, search: SearchArea, ground: OpenGround, cell: tuple[int, int], box: Box) -> None:
        search.take_back(ground.crowd[box.slices] > 0, box)
        part = search.grid.to_local(search.box)
        search.explored[part.slices] = part_around(
            search.explored[part.slices].copy(), (cell[0] - part.row_lo, cell[1] - part.column_lo)
        )


def reveal(
    layer: OccupancyLayer,
    view: View,
    crowd: NDArray[np.uint16],
    came_of_it: NDArray[np.uint8],
    box: Box,
) -> None:
    """Mark what the cone shows: `SEEN_NOW` in `came_of_it` (uint8 over `box`) in place of what was
    there, and free ground in `layer`. `crowd` is that of `OpenGround`, over the grid.
    """
    at = box.slices
    reach_cells = view.max_depth_m / layer.grid.cell_m
    camera = np.array(view.camera_xy_cells) - (box.column_lo, box.row_lo)
    follow_cone(
        crowd[at], camera, math.atan2(*view.heading[::-1]), view.half_fov_rad, reach_cells,
        layer.occupancy[at], layer.floor_seen[at], came_of_it,
    )  # fmt: skip


def cone_by_column(view: View) -> Cone:
    """The cone of a view the way VLFM draws it: each image column is one direction, evenly spread
    over the field of view, and its largest depth, not measured counting as far, is the range."""
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
    """The 8-connected part of `explored` [rows, columns] that holds a cell, or lies nearest to it,
    with its holes filled."""
    outlines, _ = cv2.findContours(explored, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if len(outlines) < 2:
        return explored
    at = (float(cell[1]), float(cell[0]))
    # Positive within: what holds the cell comes first, then by distance.
    nearest = max(outlines, key=lambda outline: cv2.pointPolygonTest(outline, at, True))
    out = np.zeros(explored.shape, np.uint8)
    cv2.drawContours(out, [nearest], 0, 1, cv2.FILLED)
    return out


@njit(cache=True, nogil=True)
def follow_cone(crowd, camera, yaw, half_fov, reach, occupancy, floor_seen, came_of_it):
    """Follow rays half a cell apart at their ends until one meets a cell with `crowd`."""
    rows, columns = crowd.shape
    for r in range(rows):
        for c in range(columns):
            came_of_it[r, c] &= 255 - SEEN_NOW
    rays = int(2 * half_fov * reach * 2) + 1
    for k in range(rays + 1):
        angle = yaw - half_fov + 2 * half_fov * k / rays
        dx, dy = math.cos(angle), math.sin(angle)
        for step in range(int(reach * 2)):
            c = math.floor(camera[0] + dx * step * 0.5)
            r = math.floor(camera[1] + dy * step * 0.5)
            if r < 0 or c < 0 or r >= rows or c >= columns or crowd[r, c] != 0:
                break
            for y in range(max(0, r - 1), min(rows, r + 2)):
                for x in range(max(0, c - 1), min(columns, c + 2)):
                    came_of_it[y, x] |= SEEN_NOW
            floor_seen[r, c] = 1
            if occupancy[r, c] == -1:
                occupancy[r, c] = 0
