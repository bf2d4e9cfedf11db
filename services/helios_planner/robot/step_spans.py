"""Spans of one task's steps: its actions, and the time between two of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from helios_core import tracing
from helios_core.robot import Action

BETWEEN = "planning"  # becomes `decision` if a decision is made in it
DECISION = "decision"


class StepSpans:
    """For the task's worker alone. `end` closes the last span."""

    def __init__(self) -> None:
        self._between = ExitStack()

    @contextmanager
    def action(self, action: Action, task_id: str) -> Iterator[None]:
        """Span of an action until the maps hold its keyframe; the time after it belongs to the
        planner until the next action."""
        self._between.close()
        try:
            with tracing.span("action", task=task_id, action=type(action).__name__.lower()):
                yield
        finally:
            self._between.enter_context(tracing.span(BETWEEN, task=task_id))

    def end(self) -> None:
        self._between.close()


def note_decision(index: int, rule: str, do: str) -> None:
    """Name the present span after the decision that was made in it."""
    span = tracing.present_span()
    span.rename(DECISION)
    span.set("helios.decision", index)
    span.set("rule", rule)
    span.set("do", do)
