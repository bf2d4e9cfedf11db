"""When to go on waiting for a task, and when to give up."""

from __future__ import annotations

import time

from helios_core.errors import DeadlineExceeded

from helios_client.answer_types import Task


class WaitedServices:
    """Keeps the time from its making on."""

    def __init__(self, id: str, timeout_s: float, silence_s: float) -> None:
        self._id, self._timeout_s, self._silence_s = id, timeout_s, silence_s
        self._heard_s = time.monotonic()
        self._deadline_s = self._heard_s + timeout_s
        self._last: Task | None = None

    def is_new(self, task: Task) -> bool:
        """Whether the task differs from what it was when it was last heard of."""
        self._heard_s = time.monotonic()
        changed, self._last = task != self._last, task
        return changed

    def gives_up(self) -> bool:
        """Nobody answered: for too long, or past the deadline?"""
        return time.monotonic() > min(self._heard_s + self._silence_s, self._deadline_s)

    def check(self, task: Task) -> None:
        """Raises DeadlineExceeded when the task has been given all its time."""
        if time.monotonic() > self._deadline_s:
            raise DeadlineExceeded(
                f"task {self._id} is still {task.state} after {self._timeout_s:g} s; wait longer, "
                "or cancel it"
            )
