"""Request models of tasks that only drive. Metres and radians in the world frame."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

MOST_M = 10_000.0
MOST_RAD = 1000.0
DAY_S = 86_400.0


class GoRequest(BaseModel):
    """Goal point on the floor in the world frame, with an optional heading."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"example": {"x_m": 3.2, "y_m": 4.1, "yaw_rad": 1.57}}
    )

    x_m: float = Field(
        description="x coordinate in the world frame, metres",
        ge=-MOST_M,
        le=MOST_M,
        allow_inf_nan=False,
    )
    y_m: float = Field(
        description="y coordinate in the world frame, metres",
        ge=-MOST_M,
        le=MOST_M,
        allow_inf_nan=False,
    )
    yaw_rad: float | None = Field(
        default=None,
        ge=-MOST_RAD,
        le=MOST_RAD,
        allow_inf_nan=False,
        description="heading at the goal, counter-clockwise from the world's x axis; null: "
        "any heading",
    )


class ExploreRequest(BaseModel):
    """Time limit of an exploration."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"example": {"time_limit_s": 120}})

    time_limit_s: float | None = Field(
        default=None,
        gt=0,
        le=DAY_S,
        allow_inf_nan=False,
        description="time limit in seconds from the start, after which the task succeeds; "
        "null: the task runs until no unknown floor is reachable",
    )
