"""Time limits of a client that polls a task."""

from __future__ import annotations

import time

from helios_core.errors import DeadlineExceeded

from helios_client.answer_types import Task


class TaskWaitTimer:
    """Timer of one wait for a task, started at construction: deadline and silence of the
    gateway."""

    def __init__(self, id: str, timeout_s: float, silence_s: float) -> None:
        self._id, self._timeout_s, self._silence_s = id, timeout_s, silence_s
        self._heard_s = time.monotonic()
        self._deadline_s = self._heard_s + timeout_s
        self._last: Task | None = None

    def is_new(self, task: Task) -> bool:
        """True if the task has changed since its last response. Restarts the silence timer."""
        self._heard_s = time.monotonic()
        changed, self._last = task != self._last, task
        return changed

    def gives_up(self) -> bool:
        """True if the gateway has been silent for too long, or the deadline has passed."""
        return time.monotonic() > min(self._heard_s + self._silence_s, self._deadline_s)

    def check(self, task: Task) -> None:
        """Raise DeadlineExceeded if the deadline has passed."""
        if time.monotonic() > self._deadline_s:
            raise DeadlineExceeded(
                f"task {self._id} is still {task.state} after {self._timeout_s:g} s; wait longer, "
                "or cancel it"
            )
