"""Floor of a home with its furniture: where a robot can move, and what it reaches from there."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from helios_sim.home import freespace
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.color_palette import Palette
from helios_sim.home.freespace import CELL_M, Obstacle
from helios_sim.home.home_types import Fixture, Receptacle, Room, Surface
from helios_sim.home.presets import HomePreset
from helios_sim.home.wall_placement import Pose

_LATTICE_M = 0.1
_REACHABLE_SHARE = 0.2


def world_surface(surface: Surface, pose: Pose) -> Surface:
    """Surface in the world frame, of a shape at `pose`."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    cx, cy = surface.center_xy
    return replace(
        surface,
        center_xy=(pose[0] + cos * cx - sin * cy, pose[1] + sin * cx + cos * cy),
        yaw_rad=surface.yaw_rad + pose[2],
    )


def surface_points(surface: Surface, inset_m: float = 0.06) -> NDArray[np.float64]:
    """Lattice of points [n, 2] on a surface (world frame), `inset_m` from its edges."""
    axes = []
    for half in surface.half_extent_xy:
        reach = max(half - inset_m, 0.0)
        axes.append(np.linspace(-reach, reach, max(2, round(2 * reach / _LATTICE_M) + 1)))
    u, v = (grid.ravel() for grid in np.meshgrid(*axes))
    cos, sin = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    return np.stack(
        [surface.center_xy[0] + cos * u - sin * v, surface.center_xy[1] + sin * u + cos * v], axis=1
    )


class FurnishedFloor:
    """Rooms, furniture and free space of a home while its contents are placed."""

    def __init__(
        self,
        rooms: tuple[Room, ...],
        bounds: tuple[float, float, float, float],
        blocked: Sequence[Obstacle],
        preset: HomePreset,
        palette: Palette,
        rng: np.random.Generator,
    ) -> None:
        """bounds: (x0, y0, x1, y1) in m. blocked: what blocks the robot so far, first the walls."""
        self.rooms, self.bounds, self.preset = rooms, bounds, preset
        self.palette, self.rng = palette, rng
        self.catalog = CATALOGS[preset.catalog]
        self.receptacles: list[Receptacle] = []
        self.fixtures: list[Fixture] = []
        self.clearance = freespace.clearance_m(bounds, blocked, CELL_M)
        self._masks = [freespace.room_mask(room, bounds, CELL_M) for room in rooms]
        self._counts: dict[str, int] = {}

    def name(self, stem: str) -> str:
        """Next free body name of a stem: mug_0, mug_1, …"""
        number = self._counts.get(stem, 0)
        self._counts[stem] = number + 1
        return f"{stem}_{number}"

    def passable(self) -> NDArray[np.bool_]:
        """Mask of the largest region in which the robot, with its margin, can move."""
        return freespace.largest_region(self.clearance > self.preset.passage_radius_m)

    def reach_map(self, room: int, passable: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Distance from each cell to the nearest passable cell of that room."""
        return freespace.distance_to_cells_m(passable & self._masks[room], CELL_M)

    def reachable(self, surfaces: tuple[Surface, ...], reach: NDArray[np.float32]) -> bool:
        """True if the robot reaches enough of the surfaces. reach: as of `reach_map`."""
        points = np.concatenate([surface_points(surface) for surface in surfaces])
        near = self.distances(points, reach) <= self.preset.reach_m - 0.1
        return int(near.sum()) >= max(2, math.ceil(_REACHABLE_SHARE * len(points)))

    def distances(
        self, points: NDArray[np.float64], reach: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Values of a reach map at points [n, 2]."""
        columns = ((points[:, 0] - self.bounds[0]) / CELL_M).astype(int)
        rows = ((points[:, 1] - self.bounds[1]) / CELL_M).astype(int)
        return reach[np.clip(rows, 0, reach.shape[0] - 1), np.clip(columns, 0, reach.shape[1] - 1)]
