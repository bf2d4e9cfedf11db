"""All layers of one map over one grid: fusion of views, and the resulting changes by tile.

The grid grows when a view needs it; the numbering of world cells never changes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from helios_core.geometry import Pinhole
from helios_core.map_snapshot import UNKNOWN
from helios_core.types import Frame
from numpy.typing import NDArray

from helios_map2d.camera_view import View, ViewExtent, view_extent, view_on_grid
from helios_map2d.grid import EMPTY, TILE, Box, GridSpec, Tile, TileMask
from helios_map2d.kernels import tile_changes as change_kernels
from helios_map2d.kernels.occupancy_fusion import HEIGHTS, SEEN_NOW
from helios_map2d.layers.explored_area import (
    ConeVisibility,
    DepthVisibility,
    ExplorationRule,
    ExploredArea,
)
from helios_map2d.layers.frontiers import Frontier, FrontierFinder
from helios_map2d.layers.grid_growth import grown_for
from helios_map2d.layers.occupancy import OccupancyLayer
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.reachability import ReachableFloor
from helios_map2d.layers.value_layers import Cone, ValueLayers
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.snapshots.tiles import GroundTile, ValueTile


class LayerStack:
    """Occupancy, explored area, values, open ground and frontiers over `grid`.

    `known` is a box of world cells that contains all known cells. Ground under the robot's
    footprint of `footprint_radius_m` (0: no body) becomes free.
    """

    def __init__(
        self, rules: MapRules, centre_m: tuple[float, float], footprint_radius_m: float
    ) -> None:
        self.rules = rules
        self.grid = GridSpec.centred_on(*centre_m, rules.cell_m, rules.size_cells)
        self.known = EMPTY
        self.occupancy = OccupancyLayer(self.grid, rules.occupancy)
        self.search = ExploredArea(self.grid)
        self.values = ValueLayers(self.grid, rules.values)
        self.ground = ReachableFloor(self.grid, rules.frontiers.robot_radius_m / rules.cell_m)
        self.frontiers = FrontierFinder(self.grid, rules.frontiers)
        self._footprint_radius_m = footprint_radius_m
        self._exploring: ExplorationRule = (
            ConeVisibility(rules.frontiers.robot_radius_m, rules.cell_m)
            if rules.explored_by_cone
            else DepthVisibility()
        )

    def reach_of(self, frame: Frame) -> ViewExtent:
        """Extent of a frame's view. Raises InvalidInput if the pose is not rigid."""
        return view_extent(
            frame.camera, frame.T_world_cam, self.rules.cell_m, self.rules.max_depth_m
        )

    def view_of(self, depth_m: NDArray[np.float32], camera: Pinhole, reach: ViewExtent) -> View:
        """View of a checked depth image on the grid."""
        return view_on_grid(
            depth_m,
            camera,
            reach,
            self.grid,
            self.rules.min_depth_m,
            self.rules.max_depth_m,
            self.rules.rays_per_cell,
        )

    def cone(self, view: View) -> Cone:
        """Cone over which a view's score is spread."""
        return self._exploring.cone(view)

    def make_room_for(self, reach: ViewExtent, robot_m: tuple[float, float]) -> None:
        """Grow the grid to all cells that a frame, or the robot at `robot_m` (world x, y), may
        change. Raises InvalidInput if the grid would exceed the rules' limit."""
        row, column = self.grid.cell_of(*robot_m)
        self.make_room(reach.box.union(self.grid.to_world(self._around(row, column))))

    def make_room(self, needed: Box) -> None:
        """Grow the grid so that it contains a box of world cells and a margin.

        Raises InvalidInput if the grid would exceed the rules' limit.
        """
        margin = max(TILE, self.ground.reach + 2)
        grid = grown_for(self.grid, needed, margin, self.rules.most_cells)
        if grid is self.grid:
            return
        self.occupancy.grow(grid, self.known)
        self.ground.grow(grid, self.known)
        self.search.grow(grid)
        self.values.grow(grid)
        self.frontiers.grow(grid)
        self.grid = grid

    def fuse(
        self, view: View, robot_m: tuple[float, float], *, holding: bool
    ) -> list[tuple[Tile, bool, bool]]:
        """Fuse a view into occupancy, explored area and open ground; it must fit the grid.

        Returns the changed tiles, each with two flags: its published content has changed, and its
        obstacle heights have changed. `robot_m`: position of the robot (world x, y); `holding`:
        True if it holds an object.
        """
        row, column = self.grid.cell_of(*robot_m)
        box = self.grid.to_local(
            self.grid.to_world(view.window.union(self._around(row, column))).tiled
        )
        at = box.slices
        before, searched = self.occupancy.occupancy[at].copy(), self.search.explored[at].copy()
        body_m = self._footprint_radius_m
        if body_m > 0 and holding:
            body_m += self.rules.held_reach_m
        came_of_it = np.zeros((box.rows, box.columns), np.uint8)
        seen = self.occupancy.integrate(view, robot_m, body_m)
        came_of_it[view.window.moved(-box.row_lo, -box.column_lo).slices] = seen
        self._exploring.mark(view, self.occupancy, came_of_it, box)
        self.search.add(came_of_it, box)
        if self._footprint_radius_m > 0:
            self.occupancy.clear_disc(
                *robot_m, self._footprint_radius_m, came_of_it, (box.row_lo, box.column_lo)
            )
            self.search.add_near_robot(
                self.occupancy.occupancy, *robot_m, self.rules.frontiers.blind_radius_m
            )
        self.ground.update(self.occupancy.occupancy, before, box)
        self._exploring.tidy(self.occupancy, self.search, (row, column), box)
        return self._settled(box, before, searched, came_of_it)

    def restore(
        self,
        tiles: Mapping[Tile, GroundTile],
        layers: Mapping[str, Mapping[Tile, ValueTile]],
    ) -> None:
        """Fill empty layers with tiles of ground and values."""
        for place in {*tiles, *(place for values in layers.values() for place in values)}:
            self.make_room(Box.of_tile(place))
        layer, everything = self.occupancy, EMPTY
        for place, tile in tiles.items():
            box = self.grid.to_local(Box.of_tile(place))
            at = box.slices
            layer.occupancy[at], layer.evidence[at] = tile.occupancy, tile.evidence
            layer.floor_seen[at] = tile.floor_seen
            layer.z_low_m[at], layer.z_high_m[at] = tile.z_low_m, tile.z_high_m
            self.search.add(tile.searched, box)
            everything = everything.union(box)
        if not everything.empty:
            nothing = np.full((everything.rows, everything.columns), UNKNOWN, np.int8)
            self.ground.update(layer.occupancy, nothing, everything)
            self.frontiers.update(layer.occupancy, self.search.explored, TileMask.of(tiles))
            self._note_known(everything)
        for name, values in layers.items():
            self.values.restore(name, values.values())
        self.known = self.known.union(self.values.box)

    def fill_unknown(
        self, stored: LayerStack, T_here_there: Transform2
    ) -> list[tuple[Tile, bool, bool]]:
        """Fill unknown cells with the known cells of another map; known cells stay.

        T_here_there: place of the other map. Each cell takes the content of the cell that its
        centre falls on. The filled cells do not count as searched. Returns the changed tiles with
        their flags, as `fuse` does. Raises InvalidInput if the grid would exceed the rules' limit.
        """
        if stored.known.empty:
            return []
        low, high = _bounds(stored, T_here_there)
        corner, end = (np.floor(at / self.grid.cell_m).astype(int) for at in (low, high))
        extent = Box(int(corner[1]), int(end[1]) + 1, int(corner[0]), int(end[0]) + 1)
        self.make_room(extent)
        box = self.grid.to_local(extent.tiled)
        before = self.occupancy.occupancy[box.slices].copy()
        searched = self.search.explored[box.slices].copy()
        row, column = np.nonzero(before == UNKNOWN)
        there, known = _cells_there(self.grid, stored, box, row, column, T_here_there)
        row, column = row[known] + box.row_lo, column[known] + box.column_lo
        mine, theirs = self.occupancy, stored.occupancy
        for name in ("occupancy", "evidence", "floor_seen", "z_low_m", "z_high_m"):
            getattr(mine, name)[row, column] = getattr(theirs, name)[there]
        came_of_it = np.zeros((box.rows, box.columns), np.uint8)
        came_of_it[row - box.row_lo, column - box.column_lo] = HEIGHTS
        self.ground.update(mine.occupancy, before, box)
        return self._settled(box, before, searched, came_of_it)

    def values_changed(self, changed: Box) -> None:
        """Note that value layers have changed within a box of world cells."""
        self.known = self.known.union(changed)
        self.frontiers.values_changed(changed)

    def find_frontiers(
        self, robot_m: tuple[float, float], *, ground_changed: bool
    ) -> tuple[Frontier, ...]:
        """Present frontiers. ground_changed: False if only values have changed."""
        values = {name: layer.value for name, layer in self.values.layers.items()}
        if not ground_changed:
            return self.frontiers.revalued(values)
        return self.frontiers.find(self.occupancy.occupancy, self.ground, robot_m, values)

    def known_grid(self, robot_m: tuple[float, float]) -> GridSpec:
        """Grid of the known cells; of the robot's cell while none is known."""
        known = self.known
        if known.empty:
            row, column = self.grid.cell_of(*robot_m)
            known = self.grid.to_world(Box(row, row + 1, column, column + 1))
        return GridSpec.over(known, self.grid.cell_m)

    def _around(self, row: int, column: int) -> Box:
        """Cells around the robot that a frame may change without seeing them."""
        near_m = max(self._footprint_radius_m, self.rules.frontiers.blind_radius_m)
        near_m = max(near_m, self._exploring.reach_m(self.rules.max_depth_m))
        margin = int(near_m / self.rules.cell_m) + 2
        return Box(row, row + 1, column, column + 1).grown(margin)

    def _settled(
        self,
        box: Box,
        before: NDArray[np.int8],
        searched: NDArray[np.uint8],
        came_of_it: NDArray[np.uint8],
    ) -> list[tuple[Tile, bool, bool]]:
        """Update known box and frontiers after a change within `box` (whole tiles of the grid).

        Returns the changed tiles with their flags, as `fuse` does.
        """
        changed = np.zeros((box.rows // TILE, box.columns // TILE), np.uint8)
        border = np.zeros((box.rows // TILE + 2, box.columns // TILE + 2), np.uint8)
        extent = change_kernels.note_changes(
            before,
            searched,
            self.occupancy.occupancy,
            self.search.explored,
            (box.row_lo, box.column_lo),
            came_of_it,
            changed,
            border,
            TILE,
        )
        other = Box(*extent)
        if not other.empty:  # cells that become known are among the changed cells
            self.known = self.known.union(
                self.grid.to_world(other.moved(box.row_lo, box.column_lo))
            )
        world = self.grid.to_world(box)
        row, column = world.row_lo // TILE, world.column_lo // TILE
        edges = TileMask(border, (row - 1, column - 1))
        self.frontiers.update(self.occupancy.occupancy, self.search.explored, edges)
        return [
            ((r + row, c + column), bool(flags & (SEEN_NOW | HEIGHTS)), bool(flags & HEIGHTS))
            for r, line in enumerate(changed.tolist())
            for c, flags in enumerate(line)
            if flags
        ]

    def _note_known(self, box: Box) -> None:
        if self.known.holds(self.grid.to_world(box)):
            return
        at = box.slices
        extent = change_kernels.known_extent(self.occupancy.occupancy[at], self.search.explored[at])
        found = Box(*(int(v) for v in extent))
        if not found.empty:
            found = found.moved(box.row_lo, box.column_lo)
            self.known = self.known.union(self.grid.to_world(found))


def _bounds(
    stored: LayerStack, T_here_there: Transform2
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest x, y (m) of the known box of another map in this frame."""
    known, cell_m = stored.known, stored.grid.cell_m
    corners = [
        (c, r) for r in (known.row_lo, known.row_hi) for c in (known.column_lo, known.column_hi)
    ]
    moved = T_here_there.of(np.array(corners, np.float64) * cell_m)
    return moved.min(axis=0), moved.max(axis=0)


def _cells_there(
    grid: GridSpec,
    stored: LayerStack,
    box: Box,
    row: NDArray[np.intp],
    column: NDArray[np.intp],
    T_here_there: Transform2,
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], NDArray[np.bool_]]:
    """Row and column in another map of the cells [n] of a box that it knows, and which those are
    [n]."""
    corner = np.array([grid.corner[1] + box.column_lo, grid.corner[0] + box.row_lo])
    cells = np.stack([column, row], 1).astype(np.float64) + corner
    centres_m = (cells + 0.5) * grid.cell_m
    at = np.floor(T_here_there.inverse.of(centres_m) / stored.grid.cell_m).astype(np.intp)
    r, c = at[:, 1] - stored.grid.corner[0], at[:, 0] - stored.grid.corner[1]
    rows, columns = stored.grid.shape
    known = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
    known[known] = stored.occupancy.occupancy[r[known], c[known]] != UNKNOWN
    return (r[known], c[known]), known
