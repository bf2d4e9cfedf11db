"""Value layers by name: image-text score of each cell for a prompt (paper 3.1.2, after VLFM).

Each view yields one score per layer. The score is spread over the cone of view with a confidence
that decreases towards the sides, c(θ) = 0.25 + 0.75 cos²(θ / (fov / 2) · π / 2), up to the measured
depth in each direction, and averaged by confidence with the former value.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_map2d.camera_view import View
from helios_map2d.grid import EMPTY, Box, GridSpec, Tile, copy_to_larger_grid
from helios_map2d.kernels import value_fusion as value_kernels
from helios_map2d.layers.occupancy import intrinsics_of

WEIGHTED, MAXIMUM = "weighted", "maximum"


@dataclass(frozen=True)
class ValueRules:
    """VLFM's constants: the confidence at the side of the cone, and the confidence below which a
    view is dropped if the known one is higher. `fusion`: "weighted" averages by confidence; with
    "maximum" the more confident view decides."""

    least_confidence: float = 0.25
    drop_below: float = 0.35
    fusion: str = WEIGHTED

    def __post_init__(self) -> None:
        if self.fusion not in (WEIGHTED, MAXIMUM):
            raise InvalidInput(
                f"no value fusion is called {self.fusion!r}; wanted {WEIGHTED} or {MAXIMUM}"
            )


@dataclass(frozen=True)
class ValueLayer:
    """One layer over the grid: `value`, `confidence` float32 [rows, columns], 0 in unseen cells."""

    value: NDArray[np.float32]
    confidence: NDArray[np.float32]


class Piece(Protocol):
    """Part of a layer over one tile."""

    @property
    def place(self) -> Tile: ...
    @property
    def value(self) -> NDArray[np.float32]: ...
    @property
    def confidence(self) -> NDArray[np.float32]: ...


@dataclass(frozen=True)
class Cone:
    """Ground area of a view, in a form small enough to store; sufficient to fuse a score.

    `reach_m` float32 [bins] is the farthest measured range by azimuth (see `camera_view`), 0 in
    bins outside the image. `heading` is the unit direction of view.
    """

    x_m: float
    y_m: float
    heading: tuple[float, float]
    half_fov_rad: float
    reach_m: NDArray[np.float32]

    def box(self, cell_m: float) -> Box:
        """Box of world cells around the covered ground; empty if nothing was measured."""
        seen = np.flatnonzero(self.reach_m)
        if not len(seen):
            return EMPTY
        forward, left = bin_directions(len(self.reach_m))[:, seen]
        c, s = self.heading
        far = self.reach_m[seen] * 1.01  # includes the corners of a bin
        x = self.x_m + np.append((c * forward - s * left) * far, 0.0)
        y = self.y_m + np.append((s * forward + c * left) * far, 0.0)
        lo_x, hi_x, lo_y, hi_y = (
            math.floor(v / cell_m) for v in (x.min(), x.max(), y.min(), y.max())
        )
        return Box(lo_y - 1, hi_y + 2, lo_x - 1, hi_x + 2)


@functools.lru_cache(8)
def bin_directions(bins: int) -> NDArray[np.float64]:
    """Unit directions [2, bins] (forward, left) at the middles of the azimuth bins."""
    a = (np.arange(bins) + 0.5) * 4 / bins - 2
    forward, left = 1 - np.abs(a), np.where(np.abs(a) <= 1, a, np.sign(a) * (2 - np.abs(a)))
    return np.stack([forward, left]) / np.hypot(forward, left)


def spread_over(
    box: Box, cone: Cone, cell_m: float, least_confidence: float
) -> tuple[NDArray[np.float32], tuple[int, int, int, int]]:
    """Confidence of a view in each cell of a box of world cells, float32 [rows, columns], 0 in
    unseen cells; and the extent of seen cells: row_lo, row_hi, column_lo, column_hi in the box."""
    out = np.empty((box.rows, box.columns), np.float32)
    camera_cells = np.array(
        [cone.x_m / cell_m - box.column_lo, cone.y_m / cell_m - box.row_lo], np.float32
    )
    seen = value_kernels.spread(
        out,
        camera_cells,
        np.array(cone.heading, np.float32),
        np.float32(cell_m),
        np.float32(cone.half_fov_rad),
        np.float32(least_confidence),
        cone.reach_m,
    )
    return out, seen


def cone_of(view: View) -> Cone:
    """Cone of a view, from its measured depth."""
    reach = np.empty(view.azimuth_bins, np.float32)
    value_kernels.farthest_by_azimuth(
        view.depth_m,
        view.pixel_step,
        intrinsics_of(view),
        np.ascontiguousarray(view.T_world_cam[:2, :3], np.float32),
        np.array(view.heading, np.float32),
        np.float32(view.min_depth_m),
        np.float32(view.max_depth_m),
        reach,
    )
    x_m, y_m = view.T_world_cam[:2, 3]
    return Cone(float(x_m), float(y_m), view.heading, view.half_fov_rad, reach)


class ValueLayers:
    """Any number of value layers by name over one grid."""

    def __init__(self, grid: GridSpec, rules: ValueRules) -> None:
        self.grid = grid
        self.rules = rules
        self.layers: dict[str, ValueLayer] = {}
        self.box = EMPTY  # world cells that hold all values

    def grow(self, grid: GridSpec) -> None:
        """Continue on a larger grid."""
        self.layers = {
            name: ValueLayer(
                copy_to_larger_grid(layer.value, self.grid, grid, self.box),
                copy_to_larger_grid(layer.confidence, self.grid, grid, self.box),
            )
            for name, layer in self.layers.items()
        }
        self.grid = grid

    def reset(self, names: tuple[str, ...] = ()) -> None:
        """Remove all layers and create empty ones with the given names."""
        self.layers = {name: self._empty() for name in names}
        self.box = EMPTY

    def touch(self, name: str) -> None:
        """Create an empty layer if there is none of this name."""
        if name not in self.layers:
            self.layers[name] = self._empty()

    def restore(self, name: str, tiles: Iterable[Piece]) -> None:
        """Fill a layer with tiles, which must lie within the grid."""
        self.touch(name)
        layer = self.layers[name]
        for tile in tiles:
            box = Box.of_tile(tile.place)
            at = self.grid.to_local(box).slices
            layer.value[at], layer.confidence[at] = tile.value, tile.confidence
            rows, columns = np.nonzero(tile.confidence)
            if len(rows):
                seen = Box(
                    int(rows.min()), int(rows.max()) + 1, int(columns.min()), int(columns.max()) + 1
                )
                self.box = self.box.union(seen.moved(box.row_lo, box.column_lo))

    def integrate(self, cone: Cone, scores: Mapping[str, float]) -> Box:
        """Fuse a view's scores and return the box of world cells that may have changed.

        The part of the cone beyond the grid is ignored. Raises InvalidInput, and changes nothing,
        if a score is not finite.
        """
        for name, score in scores.items():
            if not math.isfinite(score):
                raise InvalidInput(
                    f"the score of layer {name!r} is {score}, wanted a finite number: "
                    "look at the detector's scorer"
                )
        for name in scores:
            self.touch(name)
        cell_m = self.grid.cell_m
        box = cone.box(cell_m).intersection(self.grid.to_world(self.grid.whole))
        if box.empty or not scores:
            return EMPTY
        spread, seen = spread_over(box, cone, cell_m, self.rules.least_confidence)
        changed = Box(*seen).moved(box.row_lo, box.column_lo)
        if changed.empty:
            return EMPTY
        local = self.grid.to_local(box)
        corner = local.row_lo, local.column_lo
        weighted = self.rules.fusion == WEIGHTED
        fuse = value_kernels.fuse_average if weighted else value_kernels.fuse_maximum
        for name, score in scores.items():
            layer = self.layers[name]
            fuse(
                layer.value,
                layer.confidence,
                corner,
                spread,
                seen,
                np.float32(score),
                np.float32(self.rules.drop_below),
            )
        self.box = self.box.union(changed)
        return changed

    def _empty(self) -> ValueLayer:
        shape = self.grid.shape
        return ValueLayer(np.zeros(shape, np.float32), np.zeros(shape, np.float32))


def values_near(
    value: NDArray[np.float32], cells: NDArray[np.int32], radius_cells: float
) -> NDArray[np.float64]:
    """VLFM's value of frontiers at cells [n, 2] (row, column): median of the non-zero cells within
    a radius; 0 if there are none."""
    out = np.empty(len(cells), np.float64)
    value_kernels.median_near(value, cells, radius_cells, out)
    return out
