"""Settings of the 2D maps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Self

from helios_core.settings import ServiceSettings, service_config
from pydantic import Field, model_validator

from helios_map2d.layers.frontiers import FrontierRules
from helios_map2d.layers.occupancy import FLOOR_TOLERANCE_M, OccupancyRules
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.value_layers import ValueRules


class Settings(ServiceSettings):
    """Flags of `python -m helios_map2d`."""

    model_config = service_config("map2d")

    preset: str = Field(
        "default",
        pattern="^(default|vlfm-compatible)$",
        description="default, or vlfm-compatible: every pixel in the height band is an obstacle "
        "for good, and the whole field of view counts as explored",
    )
    cell_m: float = Field(0.025, gt=0.002, le=1.0, description="edge of a cell")
    size_cells: int = Field(2000, ge=64, le=16000, description="cells along each side of a new map")
    most_cells: int = Field(
        16000,
        ge=64,
        le=100_000,
        description="about how many cells along each side a map may grow to",
    )
    most_leap_m: float = Field(
        50.0,
        gt=0,
        description="a frame is refused if the robot is farther from where it was at the last one",
    )
    min_depth_m: float = Field(0.10, ge=0, description="nearer depth is ignored")
    max_depth_m: float = Field(
        5.0, gt=0, description="farther depth is ignored; the robot's own limit if that is less"
    )
    rays_per_cell: float = Field(
        1.0,
        ge=0,
        description="density of depth pixels, as rays per cell at the largest depth; 0: all pixels",
    )
    band_lo_m: float = Field(
        0.10,
        gt=FLOOR_TOLERANCE_M,
        description="lower edge of the obstacle band: height above the floor",
    )
    band_hi_m: float = Field(
        1.50, gt=0, description="upper edge of the obstacle band: height above the floor"
    )
    blind_radius_m: float = Field(
        1.00,
        ge=0,
        description="radius around the robot within which unknown floor counts as seen: the "
        "camera cannot see it",
    )
    value_fusion: str = Field(
        "weighted",
        pattern="^(weighted|maximum)$",
        description="fusion of value layers: weighted (by confidence), or maximum (the more "
        "confident view wins)",
    )
    most_views: int = Field(
        512, ge=0, le=100_000, description="most past views kept for later queries"
    )
    state_dir: Path | None = Field(
        default=None, description="folder in which the map survives a crash; none: it does not"
    )
    keep_period_s: float = Field(
        3.0, gt=0, le=86400, description="time between two saves of a changed map"
    )
    integrate_stream: bool = Field(
        False, description="integrate stream frames into the occupancy map too, not only keyframes"
    )

    @model_validator(mode="after")
    def _can_map(self) -> Self:
        """Refuse settings under which nothing would be mapped."""
        if not self.max_depth_m > self.min_depth_m:
            raise ValueError(
                f"max_depth_m is {self.max_depth_m:g} and min_depth_m is {self.min_depth_m:g}, so "
                "all depth would be ignored; give a max_depth_m above min_depth_m"
            )
        if self.size_cells > self.most_cells:
            raise ValueError(
                f"size_cells is {self.size_cells} and most_cells is {self.most_cells}; give a "
                "most_cells of at least size_cells"
            )
        if not self.band_hi_m > self.band_lo_m:
            raise ValueError(
                f"the obstacle band from {self.band_lo_m:g} to {self.band_hi_m:g} m is empty; give "
                "a band_hi_m above band_lo_m"
            )
        return self

    def rules(self, robot_max_depth_m: float, robot_radius_m: float) -> MapRules:
        """The rules of the maps for a robot."""
        rules = self._rules(robot_max_depth_m, robot_radius_m)
        return vlfm_compatible(rules) if self.preset == "vlfm-compatible" else rules

    def _rules(self, robot_max_depth_m: float, robot_radius_m: float) -> MapRules:
        return MapRules(
            cell_m=self.cell_m,
            size_cells=self.size_cells,
            most_cells=self.most_cells,
            most_leap_m=self.most_leap_m,
            min_depth_m=self.min_depth_m,
            max_depth_m=min(self.max_depth_m, robot_max_depth_m),
            occupancy=OccupancyRules(band_lo_m=self.band_lo_m, band_hi_m=self.band_hi_m),
            rays_per_cell=self.rays_per_cell,
            most_views=self.most_views,
            values=ValueRules(fusion=self.value_fusion),
            frontiers=FrontierRules(
                robot_radius_m=robot_radius_m, blind_radius_m=self.blind_radius_m
            ),
        )


def vlfm_compatible(rules: MapRules) -> MapRules:
    """The rules by which the maps agree with VLFM's on the same frames.

    All pixels count, no noise is filtered, nothing is freed again, the band's edge does not rise
    with depth, and the cone of view counts as explored up to known obstacles, measured or not.
    """
    occupancy = replace(
        rules.occupancy,
        band_rise_per_m=0.0,
        weak_pixels=1,
        strong_pixels=1,
        tail_ratio=10**6,
        occupied_evidence=1,
        hit_gain=1,
        miss_loss=0,
        flying_jump_m=1e6,
    )
    return replace(rules, occupancy=occupancy, explored_by_cone=True, rays_per_cell=0.0)
