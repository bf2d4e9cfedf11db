"""Record of a task, its states, phases and failure causes, and the exceptions that end it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from helios_core.agent_presets import DEFAULT_AGENT
from helios_core.task_states import ENDED, HOLDS_ROBOT

from helios_planner.instruction.parser import Instruction

HELD = "paused; resume or cancel it"  # message of a paused task


class State(StrEnum):
    """State of a task, spelled as in `helios_core.task_states`."""

    QUEUED = "queued"
    RUNNING = "running"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        return self.value in ENDED

    @property
    def under_way(self) -> bool:
        """True if the task has begun and not ended."""
        return self.value in HOLDS_ROBOT


class Phase(StrEnum):
    """Phase of a running task: find, pick, find, place (paper, Figure 3), or a pure motion."""

    FIND_OBJECT = "find_object"
    PICK = "pick"
    FIND_RECEPTACLE = "find_receptacle"
    PLACE = "place"
    GO = "go"
    EXPLORE = "explore"


class Cause(StrEnum):
    """Cause of a failed task; the closed list that reports count by."""

    OBJECT_NOT_FOUND = "object not found"
    RECEPTACLE_NOT_FOUND = "receptacle not found"
    WRONG_OBJECT = "wrong object believed"
    PICK_FAILED = "pick failed"
    COLLISION = "collision"
    PLACE_MISSED = "place missed"
    ROLLED_OFF = "object rolled off"
    STUCK = "stuck"
    UNREACHABLE = "goal unreachable"
    STEP_BUDGET = "step budget"
    SYSTEM_ERROR = "system error"


class TaskFailed(Exception):
    """Raised to end a task with a cause of the closed list and a message."""

    def __init__(self, cause: Cause, message: str) -> None:
        super().__init__(message)
        self.cause, self.message = cause, message


class ObjectAbsent(TaskFailed):
    """Raised to end a task whose object is probably not there."""

    def __init__(self, message: str) -> None:
        super().__init__(Cause.OBJECT_NOT_FOUND, message)


class TimeIsUp(TaskFailed):
    """Raised when the task's time limit is over. An exploration then ends without failure."""

    def __init__(self, message: str) -> None:
        super().__init__(Cause.STEP_BUDGET, message)


class TaskCancelled(Exception):
    """Raised to end a cancelled task."""


@dataclass(frozen=True)
class Task:
    """One task. Times in seconds since 1970, 0 while unknown."""

    id: str
    text: str
    instruction: Instruction
    state: State
    max_steps: int
    created_s: float
    time_limit_s: float = 0.0  # from its start; 0: no limit
    phase: Phase | None = None
    cause: Cause | None = None
    message: str = ""
    seeking: str = ""
    steps: int = 0
    picks: int = 0
    started_s: float = 0.0
    ended_s: float = 0.0
    progress: float = 0.0  # share done; never falls
    eta_s: tuple[float, float] | None = None  # seconds until its end: at least, at most
    context_id: str = ""
    agent: str = DEFAULT_AGENT
    priority: int = 0  # a higher one starts first
    settings: Mapping[str, str] = field(default_factory=dict)  # planner settings of this task alone
    seen_at_goal: bool | None = None  # after placing; None: not placed, or unknown
    on_hold: bool = False  # True while a client has paused it
    traceparent: str = ""  # span of its submission; empty if that was not traced

    def with_(self, **changes: Any) -> Task:
        """A copy with some fields changed."""
        return replace(self, **changes)
