"""HTTP models of a task's trace."""

from __future__ import annotations

from pydantic import BaseModel, Field


class TraceSpan(BaseModel):
    """One piece of work of one service."""

    service: str = Field(examples=["detector"])
    id: str = Field(description="identifier of the span, 16 hexadecimal digits")
    parent_id: str = Field(description="span that it belongs to; empty: none")
    name: str = Field(examples=["detection"])
    start_s: float = Field(description="seconds since 1970, by the clock of its machine")
    end_s: float = Field(description="seconds since 1970, by the clock of its machine")
    attributes: dict[str, str] = Field(examples=[{"helios.keyframe": "a1b2c3/0/17"}])
    error: str = Field(description="why it failed; empty if it did not")


class TraceSource(BaseModel):
    """Contribution of one service to a trace."""

    service: str = Field(examples=["map2d"])
    spans: int = Field(description="number of its spans in the trace")
    note: str = Field(description="why spans are missing; empty if none is known to be")


class Trace(BaseModel):
    """Spans of one task that the running services still have in memory."""

    task_id: str = Field(description="identifier of the task")
    trace_id: str = Field(description="identifier of the trace, 32 hexadecimal digits")
    spans: list[TraceSpan] = Field(description="spans that have ended, by start time")
    sources: list[TraceSource] = Field(description="one entry per live service")
