"""All parameters of the 2D maps; `settings` makes them from the service's settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from helios_map2d.camera_view import RAYS_PER_CELL
from helios_map2d.layers.frontiers import FrontierRules
from helios_map2d.layers.occupancy import OccupancyRules
from helios_map2d.layers.value_layers import ValueRules


@dataclass(frozen=True)
class MapRules:
    """Parameters of the maps. Depth outside (min, max) is no evidence; lengths in metres.

    A map begins with `size_cells` a side and grows up to `most_cells`. A frame more than
    `most_leap_m` from the last one is refused. While the robot holds an object, nothing within
    `held_reach_m` of its body becomes an obstacle. Depth images are subsampled so that
    `rays_per_cell` rays fall across a cell at `max_depth_m` (0: all pixels).
    """

    cell_m: float = 0.025
    size_cells: int = 2000
    most_cells: int = 16000
    min_depth_m: float = 0.10
    max_depth_m: float = 5.0
    rays_per_cell: float = RAYS_PER_CELL
    most_leap_m: float = 50.0
    held_reach_m: float = 0.30
    occupancy: OccupancyRules = field(default_factory=OccupancyRules)
    values: ValueRules = field(default_factory=ValueRules)
    frontiers: FrontierRules = field(default_factory=FrontierRules)
    trajectory_step_m: float = 0.05
    most_views: int = 512
    explored_by_cone: bool = False  # VLFM's explored area, see `ConeVisibility`
