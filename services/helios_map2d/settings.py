"""Settings of the 2D maps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from helios_core.settings import ServiceSettings, service_config
from pydantic import Field

from helios_map2d.layers.frontiers import FrontierRules
from helios_map2d.layers.occupancy import OccupancyRules
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.value_layers import ValueRules


class Settings(ServiceSettings):
    """Flags of `python -m helios_map2d`."""

    model_config = service_config("map2d")

    preset: str = Field(
        "default",
        pattern="^(default|vlfm-compatible)$",
        description="vlfm-compatible: every pixel in the band is an obstacle for good, and the "
        "cone of view is explored; to compare with VLFM",
    )
    cell_m: float = Field(0.025, gt=0.002, le=1.0, description="edge of a cell")
    size_cells: int = Field(
        2000, ge=64, le=16000, description="cells along each side of the map at its start"
    )
    most_cells: int = Field(
        16000, ge=64, le=100_000, description="cells along a side to which the map may grow"
    )
    min_depth_m: float = Field(0.10, ge=0, description="depth below this is not believed")
    max_depth_m: float = Field(
        5.0, gt=0, description="depth above this is not believed; the robot's own limit if less"
    )
    rays_per_cell: float = Field(
        1.0,
        ge=0,
        description="so many pixels of a depth image are looked at that this many rays "
        "fall across a cell at the largest depth; 0: all pixels",
    )
    band_lo_m: float = Field(0.10, gt=0, description="obstacles begin at this height")
    band_hi_m: float = Field(1.50, gt=0, description="what is higher is no obstacle")
    band_rise_per_m: float = Field(
        0.006, ge=0, description="the band's lower edge rises by this times depth squared (1/m)"
    )
    floor_tolerance_m: float = Field(0.08, gt=0, description="this near to z = 0 is floor")
    occupied_evidence: int = Field(2, ge=1, le=100, description="evidence that makes an obstacle")
    most_evidence: int = Field(5, ge=1, le=200, description="evidence never grows beyond this")
    hit_gain: int = Field(2, ge=1, le=100, description="evidence of one clear hit; a weak one: 1")
    miss_loss: int = Field(2, ge=1, le=100, description="evidence lost when a cell is seen through")
    min_frontier_m: float = Field(0.40, ge=0, description="shorter frontiers are dropped")
    frontier_value_radius_m: float = Field(
        0.50, gt=0, description="a frontier's value is the median of the values this near to it"
    )
    blind_radius_m: float = Field(
        1.00, ge=0, description="ground this near to the robot, which its camera cannot see"
    )
    most_leap_m: float = Field(
        50.0, gt=0, description="a pose farther than this from the last one is not believed"
    )
    held_reach_m: float = Field(
        0.30, ge=0, description="while something is held, what is this near to the body is not seen"
    )
    value_fusion: str = Field(
        "weighted",
        pattern="^(weighted|maximum)$",
        description="weighted: by confidence; maximum: the more confident view decides",
    )
    most_views: int = Field(
        512, ge=0, le=100_000, description="views that are kept to be asked about later"
    )
    state_dir: Path | None = Field(
        default=None, description="where the map is kept from crashes; without it, it is not"
    )
    keep_period_s: float = Field(
        3.0, gt=0, description="the kept map is at most this old, and as long as writing takes"
    )
    integrate_stream: bool = Field(
        False, description="fold stream frames into the occupancy too, not keyframes alone"
    )

    def rules(self, robot_max_depth_m: float, robot_radius_m: float) -> MapRules:
        """The rules of the maps for a robot."""
        rules = self._rules(robot_max_depth_m, robot_radius_m)
        return vlfm_compatible(rules) if self.preset == "vlfm-compatible" else rules

    def _rules(self, robot_max_depth_m: float, robot_radius_m: float) -> MapRules:
        return MapRules(
            cell_m=self.cell_m,
            size_cells=self.size_cells,
            most_cells=self.most_cells,
            min_depth_m=self.min_depth_m,
            max_depth_m=min(self.max_depth_m, robot_max_depth_m),
            occupancy=OccupancyRules(
                band_lo_m=self.band_lo_m,
                band_hi_m=self.band_hi_m,
                band_rise_per_m=self.band_rise_per_m,
                floor_tolerance_m=self.floor_tolerance_m,
                occupied_evidence=self.occupied_evidence,
                most_evidence=self.most_evidence,
                hit_gain=self.hit_gain,
                miss_loss=self.miss_loss,
            ),
            rays_per_cell=self.rays_per_cell,
            most_leap_m=self.most_leap_m,
            held_reach_m=self.held_reach_m,
            most_views=self.most_views,
            values=ValueRules(fusion=self.value_fusion),
            frontiers=FrontierRules(
                min_size_m=self.min_frontier_m,
                value_radius_m=self.frontier_value_radius_m,
                robot_radius_m=robot_radius_m,
                blind_radius_m=self.blind_radius_m,
            ),
        )


def vlfm_compatible(rules: MapRules) -> MapRules:
    """The rules by which the maps agree with VLFM's on the same frames.

    All pixels count, no noise is filtered, nothing is freed again, the band's edge does not rise
    with depth, and the cone of view counts as explored up to known obstacles, measured or not.
    """
    occupancy = replace(
        rules.occupancy, band_rise_per_m=0.0, weak_pixels=1, strong_pixels=1, tail_ratio=10**6,
        occupied_evidence=1, hit_gain=1, miss_loss=0, veil_jump_m=1e6,
    )  # fmt: skip
    return replace(rules, occupancy=occupancy, explored_by_cone=True, rays_per_cell=0.0)
