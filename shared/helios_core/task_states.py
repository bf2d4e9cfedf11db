"""Names of the task states on the bus, over HTTP and on the command line."""

from __future__ import annotations

from typing import Literal, TypeGuard, get_args

TaskState = Literal["queued", "running", "paused", "succeeded", "failed", "cancelled"]
TASK_STATES: tuple[TaskState, ...] = get_args(TaskState)
ENDED: frozenset[TaskState] = frozenset({"succeeded", "failed", "cancelled"})
HOLDS_ROBOT: frozenset[TaskState] = frozenset({"running", "paused"})  # started and not ended


def is_task_state(text: str) -> TypeGuard[TaskState]:
    """True if the text is one of the six states."""
    return text in TASK_STATES
