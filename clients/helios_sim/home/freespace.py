"""Free space for a disc-shaped robot: exact distances from cell centres to rectangles."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_sim.home import floor_plans
from helios_sim.home.home_types import Doorway, Fixture, Receptacle, Room, in_polygon

CELL_M = 0.05


@dataclass(frozen=True)
class Obstacle:
    """Rectangle on the floor: centre, half extents and yaw."""

    x: float
    y: float
    half_x: float
    half_y: float
    yaw_rad: float


def obstacles(
    rooms: tuple[Room, ...],
    doorways: tuple[Doorway, ...],
    receptacles: Iterable[Receptacle],
    fixtures: Iterable[Fixture],
) -> list[Obstacle]:
    """Walls, and footprints of all furniture that blocks a robot."""
    found = [
        Obstacle(*piece.center_xy, *piece.half_extent_xy, 0.0)
        for piece in floor_plans.wall_pieces(rooms, doorways)
        if piece.z0_m == 0.0
    ]
    found += [footprint(item) for item in receptacles]
    found += [footprint(item) for item in fixtures if item.blocks]
    return found


def footprint(item: Receptacle | Fixture) -> Obstacle:
    """Footprint of a piece of furniture."""
    return Obstacle(item.x, item.y, item.size_m[0] / 2, item.size_m[1] / 2, item.yaw_rad)


def grid_shape(bounds: floor_plans.Rect, cell_m: float) -> tuple[int, int]:
    """Number of (rows, columns) that cover the bounds."""
    rows = math.ceil((bounds[3] - bounds[1]) / cell_m - 1e-9)
    columns = math.ceil((bounds[2] - bounds[0]) / cell_m - 1e-9)
    return rows, columns


def cell_centers(
    bounds: floor_plans.Rect, cell_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x [columns] and y [rows] of the cell centres."""
    rows, columns = grid_shape(bounds, cell_m)
    x = bounds[0] + (np.arange(columns, dtype=np.float64) + 0.5) * cell_m
    y = bounds[1] + (np.arange(rows, dtype=np.float64) + 0.5) * cell_m
    return x, y


def clearance_m(
    bounds: floor_plans.Rect, blocked: Sequence[Obstacle], cell_m: float
) -> NDArray[np.float64]:
    """Distance from each cell centre [rows, columns] to the nearest obstacle; 0 inside one."""
    clearance = np.full(grid_shape(bounds, cell_m), np.inf)
    for obstacle in blocked:
        np.minimum(clearance, distance_m(bounds, obstacle, cell_m), out=clearance)
    return clearance


def distance_m(bounds: floor_plans.Rect, obstacle: Obstacle, cell_m: float) -> NDArray[np.float64]:
    """Distance from each cell centre [rows, columns] to one obstacle."""
    x, y = cell_centers(bounds, cell_m)
    dx, dy = x[None, :] - obstacle.x, y[:, None] - obstacle.y
    cos, sin = math.cos(obstacle.yaw_rad), math.sin(obstacle.yaw_rad)
    out_x = np.maximum(np.abs(cos * dx + sin * dy) - obstacle.half_x, 0)
    out_y = np.maximum(np.abs(cos * dy - sin * dx) - obstacle.half_y, 0)
    return np.sqrt(out_x * out_x + out_y * out_y)


def largest_region(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of the largest 4-connected region of the free cells."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        free.astype(np.uint8), connectivity=4
    )
    if count < 2:
        return np.zeros_like(free)
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return labels == best


def room_mask(room: Room, bounds: floor_plans.Rect, cell_m: float) -> NDArray[np.bool_]:
    """Mask of the cells whose centre is in the room."""
    x, y = cell_centers(bounds, cell_m)
    inside_x = (x >= room.x0) & (x < room.x1)
    inside_y = (y >= room.y0) & (y < room.y1)
    inside = inside_y[:, None] & inside_x[None, :]
    return inside & in_polygon(room.outline, x[None, :], y[:, None]) if room.outline else inside


def distance_to_cells_m(cells: NDArray[np.bool_], cell_m: float) -> NDArray[np.float32]:
    """Distance from each cell centre to that of the nearest marked cell; 1e6 without any."""
    if not cells.any():
        return np.full(cells.shape, 1e6, dtype=np.float32)
    pixels = cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return (pixels * cell_m).astype(np.float32)


def cell_of(x: float, y: float, bounds: floor_plans.Rect, cell_m: float) -> tuple[int, int]:
    """(row, column) of a point, clipped to the grid."""
    rows, columns = grid_shape(bounds, cell_m)
    row, column = int((y - bounds[1]) / cell_m), int((x - bounds[0]) / cell_m)
    return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
