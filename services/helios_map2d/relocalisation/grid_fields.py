"""What alignment reads from occupancy grids: surfaces and free floor of the present map, and fields
of distance to those of the stored one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN
from numpy.typing import NDArray
from scipy import ndimage

from helios_map2d.relocalisation.poses import Points

_MARGIN_M = 0.5  # unknown border around a stored map
_FREE_STEP_M = 0.05  # spacing of the points on free floor
_CROSS = ndimage.generate_binary_structure(2, 1)


@dataclass(frozen=True)
class OccupancyGrid:
    """Occupancy [rows, columns] (UNKNOWN, FREE, OCCUPIED); rows along y, columns along x."""

    occupancy: NDArray[np.int8]
    origin_m: tuple[float, float]  # x, y of the corner of cell [0, 0]
    cell_m: float

    def centres_of(self, cells: NDArray[np.bool_]) -> Points:
        """Centres [n, 2] of the cells of a mask, x and y in m."""
        row, column = np.nonzero(cells)
        centres = np.stack([column, row], 1).astype(np.float64) + 0.5
        return centres * self.cell_m + np.array(self.origin_m)

    @property
    def known_m2(self) -> float:
        return float((self.occupancy != UNKNOWN).sum()) * self.cell_m**2


@dataclass(frozen=True)
class PresentPoints:
    """Points of the present map. A surface cell is an occupied one beside free floor."""

    surface_m: Points  # [n, 2] centres of surface cells
    free_m: Points  # [m, 2] centres of free cells away from surfaces, thinned out
    surface_weight_m: float  # length of surface that a point stands for
    free_weight_m2: float  # area that a point stands for

    @property
    def centre_m(self) -> NDArray[np.float64]:
        """Mean [2] of the surface points."""
        return self.surface_m.mean(axis=0)


@dataclass(frozen=True)
class StoredFields:
    """Fields of the stored map over its grid with a margin; `[rows, columns]`."""

    grid: OccupancyGrid
    surface_m: NDArray[np.float32]  # distance to the nearest surface cell
    nearest: NDArray[np.int32]  # [2, rows, columns] row and column of that cell
    inside_m: NDArray[np.float32]  # distance of an occupied cell to one that is not; 0 elsewhere
    free: NDArray[np.bool_]
    known: NDArray[np.bool_]

    def cells_of(self, points_m: Points) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Flat cell numbers [n] of points, and which are on the grid; the others have number 0."""
        at = np.floor((points_m - self.grid.origin_m) / self.grid.cell_m).astype(np.intp)
        rows, columns = self.grid.occupancy.shape
        on = (at[:, 1] >= 0) & (at[:, 1] < rows) & (at[:, 0] >= 0) & (at[:, 0] < columns)
        return np.where(on, at[:, 1] * columns + at[:, 0], 0), on


def present_points(grid: OccupancyGrid) -> PresentPoints:
    """Points of the present map."""
    surface = _surface(grid.occupancy)
    free = grid.occupancy == FREE
    clear = np.asarray(ndimage.binary_erosion(free, _CROSS, iterations=2, border_value=0), bool)
    step = max(1, round(_FREE_STEP_M / grid.cell_m))
    thin = np.zeros_like(clear)
    thin[::step, ::step] = clear[::step, ::step]
    return PresentPoints(
        grid.centres_of(surface), grid.centres_of(thin), grid.cell_m, (step * grid.cell_m) ** 2
    )


def stored_fields(grid: OccupancyGrid) -> StoredFields | None:
    """Fields of a stored map; None without any surface."""
    pad = int(np.ceil(_MARGIN_M / grid.cell_m))
    occupancy = np.pad(grid.occupancy, pad, constant_values=UNKNOWN)
    x_m, y_m = grid.origin_m
    margin_m = pad * grid.cell_m
    padded = OccupancyGrid(occupancy, (x_m - margin_m, y_m - margin_m), grid.cell_m)
    surface = _surface(occupancy)
    if not surface.any():
        return None
    away, nearest = np.empty(surface.shape), np.empty((2, *surface.shape), np.int32)
    ndimage.distance_transform_edt(~surface, return_indices=True, distances=away, indices=nearest)
    inside = np.asarray(ndimage.distance_transform_edt(occupancy == OCCUPIED))
    cell = np.float32(grid.cell_m)
    return StoredFields(
        padded,
        away.astype(np.float32) * cell,
        nearest,
        inside.astype(np.float32) * cell,
        occupancy == FREE,
        occupancy != UNKNOWN,
    )


def _surface(occupancy: NDArray[np.int8]) -> NDArray[np.bool_]:
    beside_free = ndimage.binary_dilation(occupancy == FREE, _CROSS)
    return (occupancy == OCCUPIED) & beside_free
