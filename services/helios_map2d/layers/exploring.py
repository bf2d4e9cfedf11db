"""Which ground a view counts as explored: the one place where our way and VLFM's part.

Ours (`ByDepth`) believes only what depth measured, which `occupancy` has marked already. VLFM's
(`reveal.ByCone`) takes the whole cone of view up to known obstacles.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import Box
from helios_map2d.layers.explored import SearchArea
from helios_map2d.layers.occupancy import OccupancyLayer
from helios_map2d.layers.value import Cone, cone_of
from helios_map2d.view import View


class Exploring(Protocol):
    """A way to count ground as explored."""

    def reach_m(self, max_depth_m: float) -> float:
        """How far from the robot it may change what the view's window does not hold."""
        ...

    def cone(self, view: View) -> Cone:
        """What a score of the view is spread over."""
        ...

    def mark(
        self,
        view: View,
        layer: OccupancyLayer,
        came_of_it: NDArray[np.uint8],
        box: Box,
    ) -> None:
        """Say in `came_of_it` (flags over `box`) what was seen, once occupancy is folded in."""
        ...

    def tidy(
        self, layer: OccupancyLayer, search: SearchArea, cell: tuple[int, int], box: Box
    ) -> None:
        """Correct what was searched, once all of a frame is folded in; `cell` is the robot's."""
        ...


class ByDepth:
    """What depth measured, and nothing else."""

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
        self, layer: OccupancyLayer, search: SearchArea, cell: tuple[int, int], box: Box
    ) -> None:
        pass
