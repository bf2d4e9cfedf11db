"""Settings of the object map service."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from helios_core.agent_presets import DEFAULT_AGENT, AgentSetting
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field


class ObjectMapSettings(ServiceSettings):
    """Defaults are those of Table 3 and of the reading notes; `creation_rule` has the paper's."""

    model_config = service_config("objectmap")

    agent: AgentSetting = Field(
        default=DEFAULT_AGENT,
        description="Agent whose settings replace the defaults of this table (agent_presets).",
    )
    stride_px: int = Field(
        default=2, ge=1, le=8, description="Every n-th pixel is mapped, both ways."
    )
    min_depth_m: float = Field(
        default=0.25, ge=0, description="Nearer depth is the robot's own body or what it holds."
    )
    max_depth_m: float = Field(default=8.0, gt=0, description="Farther depth is ignored.")
    held_object_m: float = Field(
        default=1.0,
        ge=0,
        description="While something is held, objects detected nearer than this are it.",
    )

    prior_concentration: float = Field(
        default=1.0,
        gt=0,
        description="Concentration of each class before any view; more needs more views.",
    )
    prior_classes: int = Field(
        default=2,
        ge=2,
        description="The prior has at least so many classes, `other` included; the paper has 4.",
    )
    detector_trust: Literal["full", "class", "class-distance"] = Field(
        default="full",
        description="What a detection counts in scores: all, or the learnt share of true ones of "
        "its class, or of its class at its distance.",
    )
    size_agreement: Literal["off", "large", "on"] = Field(
        default="off",
        description="on: the less a thing measures what its class usually does, the less of its "
        "evidence counts in scores; large: never for being seen to be small.",
    )
    floor_m: float | None = Field(
        default=0.0,
        description="Height of the floor in the world, metres, for the sizes of what stands on it; "
        "none: unknown.",
    )
    alpha_cpa: float = Field(
        default=3.0, gt=0, description="How often each observation counts (eq. 3)."
    )
    alpha_cs: float = Field(
        default=1.0, ge=0, description="Weight of the uncertainty in a score (eq. 7)."
    )
    evidence: Literal["views", "sides", "hindsight"] = Field(
        default="views",
        description="What counts: each view (eq. 3), or each side of a thing, however often seen; "
        "hindsight: by sides, and what earlier views said of a place where something is found.",
    )
    side_views: float = Field(
        default=6.0,
        gt=0,
        le=100,
        description="With evidence by sides: views from a side until it counts in full.",
    )
    alpha_side: float = Field(
        default=6.0,
        gt=0,
        description="With evidence by sides: how often a side that counts in full counts.",
    )
    named_from: float = Field(
        default=0.5,
        gt=0,
        lt=1,
        description="A Gaussian is of a class when more than this share of the evidence says so.",
    )
    past_views: int = Field(
        default=1024, ge=1, description="So many views are kept for hindsight, 58 kB each."
    )

    renderer: Literal["cpu", "cuda"] = Field(
        default="cpu",
        description="What renders: the CPU, or gsplat on a GPU (the extra `cuda`).",
    )

    assumption: Literal["optimistic", "50-50"] = Field(
        default="optimistic",
        description="What a what-if expects of a view: the class, or half of it something else.",
    )

    full_scene: bool = Field(
        default=False,
        description="Model every pixel, not only what was detected: to compare (Figure 4).",
    )
    creation_rule: Literal["noise-scaled", "paper"] = Field(
        default="noise-scaled",
        description="noise-scaled creates and carves by depth noise; paper: literal",
    )
    opacity: float = Field(default=0.99, gt=0, lt=1, description="Opacity of a new Gaussian.")
    radius_px: float = Field(
        default=1.0, gt=0, description="Standard deviation of a new Gaussian, pixels."
    )
    create_front_m: float = Field(
        default=0.05, gt=0, description="A surface this far in front of the model is new."
    )
    carve_front_m: float = Field(
        default=0.10,
        gt=0,
        description="A Gaussian this far in front of what is measured is seen through.",
    )
    carve_views: float = Field(
        default=2.0, gt=0, description="Distinct views that see through a Gaussian to remove it."
    )
    reobserve_agreement_m: float = Field(
        default=0.5, gt=0, description="Depth difference up to which a pixel is seen again."
    )
    closing_px: int = Field(
        default=5, ge=1, description="Holes this small in what is seen again close."
    )

    # The paper has one observation a step, and its smallest step is 0.1 m or 5 degrees: just below.
    viewpoint_moved_m: float = Field(
        default=0.08, gt=0, description="A view counts in full when the camera moved this far, m."
    )
    viewpoint_turned_rad: float = Field(
        default=math.radians(4),
        gt=0,
        description="A view counts in full when the camera turned this much.",
    )

    object_voxel_m: float = Field(
        default=0.07,
        gt=0,
        description="Voxel that joins Gaussians of objects into instances, metres.",
    )
    receptacle_voxel_m: float = Field(
        default=0.5,
        gt=0,
        description="Voxel that joins Gaussians of receptacles into instances, metres.",
    )
    min_gaussians: int = Field(default=5, ge=1, description="Smaller instances are not reported.")

    max_gaussians: int = Field(
        default=1_000_000,
        ge=1000,
        description="Beyond this, those of no class asked for go, then those unseen the longest.",
    )
    max_classes: int = Field(
        default=32,
        ge=1,
        description="Beyond this, what is known of the class not asked for the longest goes.",
    )
    state_dir: Path | None = Field(
        default=None, description="Folder in which the map survives a restart; none: it does not."
    )
    save_every_s: float = Field(
        default=3.0, gt=0, description="A changed map is written this often, seconds."
    )

    @property
    def by_sides(self) -> bool:
        """Whether votes are kept for each side."""
        return self.evidence != "views"
