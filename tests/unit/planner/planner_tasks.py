"""Tasks for tests."""

from __future__ import annotations

from helios_planner.instruction.parser import parse
from helios_planner.task import Phase, State, Task


def a_task(text: str = "move the mug to the sofa", state: State = State.RUNNING) -> Task:
    return Task(
        id="t",
        text=text,
        instruction=parse(text),
        state=state,
        max_steps=100,
        created_s=1.0,
        phase=Phase.FIND_OBJECT,
        context_id="c",
    )
