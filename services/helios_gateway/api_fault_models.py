"""HTTP models of faults and their recordings."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


class Fault(BaseModel):
    """A fault of a service, of the robot or of a task."""

    id: str = Field(examples=["detector-degraded"])
    source: str = Field(description="service, `robot` or `task`", examples=["detector"])
    kind: str = Field(
        description="degraded, silent, down or restarted; stopped; or the cause of a failed task",
        examples=["degraded"],
    )
    severity: Literal["warning", "error"] = Field(description="how bad it is")
    state: Literal["raised", "confirmed", "cleared"] = Field(
        description="raised: it is new; confirmed: it lasts, came again or is an event; cleared"
    )
    message: str = Field(description="its newest occurrence in one sentence")
    count: int = Field(description="number of occurrences since the first")
    first_s: float | None = Field(description="first occurrence, seconds since 1970")
    last_s: float | None = Field(description="newest time at which it was present")
    raised_s: float | None = Field(description="time at which it was last raised")
    confirmed_s: float | None = Field(description="time of its confirmation; null: not confirmed")
    cleared_s: float | None = Field(description="time at which it was cleared; null: not cleared")
    recordings: list[str] = Field(description="names of the recordings around it, oldest first")


class FaultRecording(BaseModel):
    """Recording of the time around one or more faults, an MCAP file."""

    name: str = Field(description="name for `/v1/faults/recordings/{recording}`")
    made_s: float = Field(description="time of the fault, seconds since 1970")
    faults: list[str] = Field(description="ids of the faults that it shows")
    tasks: list[str] = Field(description="failed tasks that it shows")
    bytes: int | None = Field(description="size of the file; null: it is still being made")


class FaultList(BaseModel):
    faults: list[Fault] = Field(description="faults: confirmed, raised, then cleared ones")
    recordings: list[FaultRecording] = Field(description="recordings, newest first")
    folder: str | None = Field(
        description="folder of the recordings on the gateway's machine; null: none are made"
    )
