"""Response models of the checks of a robot's set-up."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


class RobotCheck(BaseModel):
    """Result of one check of the robot's set-up."""

    name: str = Field(examples=["pitch"])
    verdict: Literal["ok", "wrong", "not measured"] = Field(
        description="ok: within the limit; wrong: surely beyond it"
    )
    value: float | None = Field(description="measured value, in `unit`; null: not measured")
    error: float | None = Field(description="standard error of the value; null: not measured")
    limit: float = Field(description="largest size of the value that is right, in `unit`")
    unit: str = Field(examples=["deg"])
    words: str = Field(
        description="one sentence: what is wrong and by how much, or why nothing was measured",
        examples=["the camera looks 1.6 deg further down than its pose says"],
    )


class RobotChecks(BaseModel):
    """Results of all checks of the robot's set-up so far."""

    checks: list[RobotCheck] = Field(description="one result per check")
    images: int = Field(description="number of images at rest behind the results")
    free_ahead_m: float = Field(
        description="free distance in front of the robot in the newest of these images, metres; 0: "
        "not known"
    )
