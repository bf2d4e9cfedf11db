"""Value layers by name: how promising each cell looks for a prompt (paper 3.1.2, after VLFM).

One view gives each layer one score. It is spread over the cone of view with a confidence that
falls off towards the cone's sides, c(θ) = 0.25 + 0.75 cos²(θ / (fov / 2) · π / 2), and only as far
as depth was measured in each direction; what is there already is averaged by confidence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_map2d import value_kernels
from helios_map2d.grid import Box, GridSpec
from helios_map2d.occupancy import camera_in_window, intrinsics_of
from helios_map2d.view import View


@dataclass(frozen=True)
class ValueRules:
    """VLFM's constants: the confidence at the cone's side, and the one below which a weaker view
    than what is known is dropped."""

    least_confidence: float = 0.25
    drop_below: float = 0.35


@dataclass(frozen=True)
class ValueLayer:
    """One layer over the grid: `value` and `confidence` float32 [rows, columns], 0 where unseen."""

    value: NDArray[np.float32]
    confidence: NDArray[np.float32]


class ValueLayers:
    """Any number of value layers by name over one grid."""

    def __init__(self, grid: GridSpec, rules: ValueRules) -> None:
        self.grid = grid
        self.rules = rules
        self.layers: dict[str, ValueLayer] = {}

    def reset(self, names: tuple[str, ...] = ()) -> None:
        """Forget every value; keep empty layers under the given names."""
        self.layers = {name: self._empty() for name in names}

    def integrate(self, view: View, scores: Mapping[str, float]) -> Box:
        """Fold a view's scores in; return the window that may have changed.

        Raises InvalidInput when a score is not finite; nothing is changed then.
        """
        for name, score in scores.items():
            if not math.isfinite(score):
                raise InvalidInput(
                    f"the score of layer {name!r} is {score}, wanted a finite number: "
                    "look at the detector's scorer"
                )
        intrinsics = intrinsics_of(view)
        heading = np.array(view.heading, np.float32)
        camera_cells = camera_in_window(view)
        reach = np.empty(view.azimuth_bins, np.float32)
        rotation = np.ascontiguousarray(view.T_world_cam[:2, :3], np.float32)
        value_kernels.farthest_by_azimuth(
            view.depth_m, intrinsics, rotation, heading,
            np.float32(view.min_depth_m), np.float32(view.max_depth_m), reach,
        )  # fmt: skip
        box = view.window.slices
        for name, score in scores.items():
            layer = self.layers.setdefault(name, self._empty())
            value_kernels.fuse_value(
                layer.value[box], layer.confidence[box], np.float32(score), camera_cells, heading,
                np.float32(self.grid.cell_m), np.float32(view.half_fov_rad),
                np.float32(self.rules.least_confidence), np.float32(self.rules.drop_below), reach,
            )  # fmt: skip
        return view.window

    def _empty(self) -> ValueLayer:
        shape = self.grid.shape
        return ValueLayer(np.zeros(shape, np.float32), np.zeros(shape, np.float32))


def value_near(value: NDArray[np.float32], row: int, column: int, radius_cells: float) -> float:
    """VLFM's value of a frontier: the median of the non-zero cells within a radius; 0 if none."""
    reach = int(radius_cells)
    rows, columns = value.shape
    row_lo, row_hi = max(0, row - reach), min(rows, row + reach + 1)
    column_lo, column_hi = max(0, column - reach), min(columns, column + reach + 1)
    patch = value[row_lo:row_hi, column_lo:column_hi]
    down = np.arange(row_lo, row_hi)[:, None] - row
    across = np.arange(column_lo, column_hi) - column
    inside = patch[(down**2 + across**2 <= radius_cells**2) & (patch != 0)]
    return float(np.median(inside)) if inside.size else 0.0
