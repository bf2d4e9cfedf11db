"""Settings of the object map service."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from helios_core.agent_presets import DEFAULT_AGENT, AgentSetting
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field, ValidationInfo, field_validator


class ObjectMapSettings(ServiceSettings):
    """Settings of the object map. Defaults are those of Table 3 where it has one."""

    model_config = service_config("objectmap")

    agent: AgentSetting = Field(
        default=DEFAULT_AGENT,
        description="agent whose preset replaces the defaults of this table",
    )
    stride_px: int = Field(
        default=2, ge=1, le=8, description="pixel step of the mapping, in both directions"
    )
    min_depth_m: float = Field(
        default=0.25,
        ge=0,
        description="nearer depth is ignored: the robot's own body, or what it holds",
    )
    max_depth_m: float = Field(
        default=8.0, gt=0, validate_default=True, description="farther depth is ignored"
    )

    prior_concentration: float = Field(
        default=1.0,
        gt=0,
        description="prior concentration of each class (eq. 2); a larger one needs more views",
    )
    prior_classes: int = Field(
        default=4,
        ge=2,
        description="least number of classes that share the prior, `other` included; a search for "
        "fewer classes keeps them, so that its scores rise no faster",
    )
    detector_trust: Literal["full", "class", "class-distance"] = Field(
        default="full",
        description="weight of a detection in a score: full, or the learnt precision of its "
        "class, or of its class at its distance",
    )
    size_agreement: Literal["off", "large", "on"] = Field(
        default="off",
        description="weight evidence by how well an object's size matches its class: on, off, or "
        "large (only for objects that are too large)",
    )
    floor_m: float | None = Field(
        default=0.0,
        description="height of the floor in the world frame, for the sizes of objects that "
        "stand on it; none: unknown",
    )
    furniture_above_m: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="height above the floor below which no pixel belongs to furniture; 0: every "
        "pixel of a mask does, as in the paper",
    )
    alpha_cpa: float = Field(
        default=3.0,
        gt=0,
        description="factor of an observation's evidence in eq. 3 (α_cpa, Table 3)",
    )
    alpha_cs: float = Field(
        default=1.0, ge=0, description="weight of the uncertainty in a score (α_cs, eq. 7)"
    )
    evidence: Literal["views", "sides", "hindsight"] = Field(
        default="views",
        description="unit of evidence: views (eq. 3), sides (viewing sectors of an object, "
        "however often seen), or hindsight (sectors, and past views of the same place)",
    )
    side_views: float = Field(
        default=6.0,
        gt=0,
        le=100,
        description="views from one viewing sector until it counts in full; with sides and "
        "hindsight",
    )
    alpha_side: float = Field(
        default=6.0,
        gt=0,
        description="weight of a viewing sector that counts in full; with sides and hindsight",
    )
    named_from: float = Field(
        default=0.5,
        gt=0,
        lt=1,
        description="share of the evidence from which a Gaussian belongs to a class",
    )
    core_from: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of the evidence from which a Gaussian belongs to the core of an "
        "instance. Gaussians with less form instances of their own. The map does not report such "
        "an instance where it touches a core of its class. A value up to that of `named_from` puts "
        "all Gaussians into cores",
    )
    joined_by: Literal["distance", "detections"] = Field(
        default="distance",
        description="Gaussians of a class that touch are one instance: always, as in the paper, or "
        "only where most detections that show one part show the other part too",
    )
    look_alikes: Literal["ignored", "compared", "sized"] = Field(
        default="ignored",
        description="detections under other names at an instance: ignored, compared with those "
        "under its own name, or sized (compared, and a name that its measured size does not fit "
        "counts less)",
    )
    image_text: Literal["ignored", "compared"] = Field(
        default="ignored",
        description="image-text scores of the views that show an instance: ignored, as in the "
        "paper, or compared with those of all views; only scorers that look at the image give them",
    )
    error_model: str = Field(
        default="",
        description="error model of the detector for that comparison: a file of helios calibrate, "
        "or the name of a shipped one; empty: a broad prior",
    )

    equal_masks: Literal["by-name", "by-score"] = Field(
        default="by-name",
        description="class of a pixel in several masks of one size: the alphabetically last name, "
        "or that of the highest detector score",
    )

    renderer: Literal["cpu", "cuda"] = Field(
        default="cpu",
        description="cpu, or cuda: gsplat on a GPU (extra `cuda`)",
    )

    assumption: Literal["optimistic", "50-50"] = Field(
        default="optimistic",
        description="predicted detection of an expected view: optimistic (the class), or 50-50 "
        "(half the class, half another)",
    )

    expected_label: Literal["one-hot", "rendered"] = Field(
        default="one-hot",
        description="predicted label Y* of a pixel (eq. 12): one-hot (the class, in full), or "
        "rendered (the class in proportion to the rendered coverage, as in the paper)",
    )
    full_scene: bool = Field(
        default=False,
        description="map every pixel, not only detections: the comparison of Figure 4",
    )
    creation_rule: Literal["noise-scaled", "paper"] = Field(
        default="noise-scaled",
        description="create Gaussians where the depth differs by more than its noise "
        "(noise-scaled), or by more than 1 mm (paper)",
    )
    carving: bool = Field(
        default=True,
        description="remove Gaussians that views see through; false: they stay, as in the paper",
    )
    view_weights: Literal["by-difference", "full"] = Field(
        default="by-difference",
        description="weight of a view: by its difference from earlier views, or full for each one, "
        "as in the paper",
    )

    object_voxel_m: float = Field(
        default=0.07,
        gt=0,
        description="edge of the voxels that join Gaussians of small objects into instances",
    )
    receptacle_voxel_m: float = Field(
        default=0.5,
        gt=0,
        description="edge of the voxels that join Gaussians of receptacles, and of furniture in "
        "any role, into instances",
    )

    max_gaussians: int = Field(
        default=1_000_000,
        ge=1000,
        description="most Gaussians; beyond, those of no class go first, then the longest unseen",
    )
    max_classes: int = Field(
        default=32,
        ge=1,
        description="most classes; beyond, the class that was not searched for the longest goes "
        "first",
    )
    state_dir: Path | None = Field(
        default=None, description="folder in which the map survives a restart; none: it does not"
    )
    save_every_s: float = Field(
        default=3.0, gt=0, le=86400, description="time between two saves of a changed map"
    )

    @field_validator("max_depth_m")
    @classmethod
    def _leaves_depth(cls, max_depth_m: float, others: ValidationInfo) -> float:
        min_depth_m = others.data.get("min_depth_m", 0.0)  # absent if it is wrong itself
        if not max_depth_m > min_depth_m:
            raise ValueError(
                f"max_depth_m is {max_depth_m:g} and min_depth_m is {min_depth_m:g}, so all depth "
                "would be ignored; give a max_depth_m above min_depth_m"
            )
        return max_depth_m

    @property
    def furniture_from_m(self) -> float | None:
        """Height, world, from which pixels belong to furniture; None: from anywhere."""
        if self.floor_m is None or self.furniture_above_m == 0:
            return None
        return self.floor_m + self.furniture_above_m

    @property
    def by_sides(self) -> bool:
        """Whether votes are kept for each side."""
        return self.evidence != "views"
