"""The life of a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from helios_core.agent_presets import DEFAULT_AGENT
from helios_core.task_states import ENDED, HOLDS_ROBOT

from helios_planner.instruction.parser import Instruction

HELD = "paused; resume or cancel it"  # what a task says that is on hold


class State(StrEnum):
    """Where a task stands in its life: as `helios_core.task_states` spells it."""

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
        """Begun, and not ended."""
        return self.value in HOLDS_ROBOT


class Phase(StrEnum):
    """What a running task is at: find, pick, find, place (paper, figure 3); or it only moves."""

    FIND_OBJECT = "find_object"
    PICK = "pick"
    FIND_RECEPTACLE = "find_receptacle"
    PLACE = "place"
    GO = "go"
    EXPLORE = "explore"


class Cause(StrEnum):
    """Why a task failed; the closed list that reports count by."""

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
    """Ends a task with a cause of the closed list and a sentence."""

    def __init__(self, cause: Cause, message: str) -> None:
        super().__init__(message)
        self.cause, self.message = cause, message


class TimeIsUp(TaskFailed):
    """The task's own time limit is over. An exploration ends so, and has not failed."""

    def __init__(self, message: str) -> None:
        super().__init__(Cause.STEP_BUDGET, message)


class TaskCancelled(Exception):
    """Ends a task that somebody cancelled."""


@dataclass(frozen=True)
class Task:
    """One task; times in seconds since 1970, 0 while unknown."""

    id: str
    text: str
    instruction: Instruction
    state: State
    max_steps: int
    created_s: float
    time_limit_s: float = 0.0  # from its start; 0: none
    phase: Phase | None = None
    cause: Cause | None = None
    message: str = ""
    seeking: str = ""
    steps: int = 0
    picks: int = 0
    started_s: float = 0.0
    ended_s: float = 0.0
    progress: float = 0.0  # never falls
    eta_s: tuple[float, float] | None = None  # it may end in so many seconds: at least, at most
    context_id: str = ""
    agent: str = DEFAULT_AGENT
    priority: int = 0  # a higher one is begun first
    settings: Mapping[str, str] = field(default_factory=dict)  # of the planner, for it alone
    seen_at_goal: bool | None = None  # after it was placed; None: it was not, or nobody knows
    on_hold: bool = False  # somebody paused it, and nobody has resumed it yet

    def with_(self, **changes: Any) -> Task:
        """A copy with some fields changed."""
        return replace(self, **changes)
