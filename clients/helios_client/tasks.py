"""What the HTTP interface answers, typed. All of it is kept in `raw`; unknown fields only there."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Self

ENDED = ("succeeded", "failed", "cancelled")


@dataclass(frozen=True)
class _FromJson:
    raw: dict[str, Any] = field(default_factory=dict, repr=False, kw_only=True)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """From one JSON object; what it lacks has its default."""
        known = {f.name for f in fields(cls)} - {"raw"}
        values = {k: v for k, v in raw.items() if k in known and v is not None}
        return cls(**values, raw=raw)


@dataclass(frozen=True)
class Task(_FromJson):
    """A task and how far it is. Times are seconds since 1970."""

    id: str = ""
    instruction: str = ""
    state: str = ""  # queued, running, paused, succeeded, failed, cancelled
    phase: str = ""  # find_object, pick, find_receptacle, place
    message: str = ""  # what it does now, or why it ended
    cause: str = ""
    seeking: str = ""
    kind: str = ""  # move, find, go_to
    object: str = ""
    start: str = ""
    goal: str = ""
    steps: int = 0
    max_steps: int = 0
    picks: int = 0
    progress: float = 0.0
    created_s: float = 0.0
    started_s: float = 0.0
    ended_s: float = 0.0

    @property
    def ended(self) -> bool:
        return self.state in ENDED

    @property
    def succeeded(self) -> bool:
        return self.state == "succeeded"


@dataclass(frozen=True)
class Decision(_FromJson):
    """What was decided, by which rule and why."""

    task_id: str = ""
    index: int = 0
    phase: str = ""
    rule: str = ""
    why: str = ""
    candidates: list[dict[str, Any]] = field(default_factory=list)
    settings: dict[str, float] = field(default_factory=dict)
    made_s: float = 0.0


@dataclass(frozen=True)
class FoundObject(_FromJson):
    """One instance of the object map; lengths in metres, world z up."""

    id: int = 0
    class_name: str = ""
    center_m: list[float] = field(default_factory=list)
    size_m: list[float] = field(default_factory=list)
    score: float = 0.0  # Ψ, eq. 7
    class_score: float = 0.0
    uncertainty: float = 0.0
    views: int = 0
    gaussians: int = 0
    probabilities: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Self:
        """The wire says `class`, which is no name in Python."""
        return super().from_json(raw | {"class_name": raw.get("class", "")})


@dataclass(frozen=True)
class Event:
    """One server-sent event."""

    type: str
    data: dict[str, Any]
    id: str = ""
