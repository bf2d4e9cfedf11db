"""Models of teleoperation over HTTP and the WebSocket."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from helios_gateway.api_models import RobotPose

MOST_M, MOST_RAD = 0.5, 0.6  # limits of one requested move; a longer path needs a task

StateName = Literal["standing", "driving", "blocked", "refused"]


class TeleopCommand(BaseModel):
    """Current drive command. It expires after 0.3 s: repeat it while the robot shall move."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    forward: float = Field(
        default=0.0, ge=-1, le=1, description="share of the speed limit; below 0: back"
    )
    turn: float = Field(
        default=0.0, ge=-1, le=1, description="share of the limit of turning; above 0: left"
    )


class TeleopState(BaseModel):
    """State of the teleoperation; sent after each change."""

    state: StateName = Field(
        description="refused: the robot does not move; release the command, then send it again"
    )
    reason: str = Field(default="", description="why it is blocked or refused, in one sentence")
    kind: str = Field(
        default="",
        description="of a refusal: `invalid` for a wrong command, `conflict` where the robot is "
        "not to be driven now, or another last word of a problem's type",
    )
    pose: RobotPose | None = Field(default=None, description="after the newest move")


class DriveRequest(BaseModel):
    """One short move: ahead, back, or a turn on the spot."""

    model_config = ConfigDict(
        extra="forbid", allow_inf_nan=False, json_schema_extra={"example": {"forward_m": 0.3}}
    )

    forward_m: float = Field(
        default=0.0, ge=-MOST_M, le=MOST_M, description="metres ahead; below 0: back"
    )
    turn_rad: float = Field(
        default=0.0, ge=-MOST_RAD, le=MOST_RAD, description="radians; above 0: left"
    )

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if bool(self.forward_m) is bool(self.turn_rad):
            raise ValueError(
                f"forward_m is {self.forward_m:g} and turn_rad is {self.turn_rad:g}; send one of "
                "them, not 0"
            )
        return self


class DriveResult(BaseModel):
    """Result of one move, as the robot measured it."""

    succeeded: bool = Field(description="the move was finished")
    reason: str = Field(description="one sentence when it failed; else empty")
    moved_m: float | None = Field(description="length of the way, ahead or back")
    turned_rad: float | None = Field(description="above 0: left")
    collided: bool = Field(description="the robot touched something")
    pose: RobotPose | None = Field(description="where the robot stands now")
