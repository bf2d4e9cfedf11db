"""Why an episode failed: one cause of a closed list, by what really happened.

The truth decides. What the agent said is used only for what the truth cannot know: that it saw
itself stuck, out of steps, or broken. The first line that holds gives the cause:

 1. success                                                    no cause
 2. a candidate rests on a goal receptacle                     collision
 3. the agent said so, or did not end though steps were left   system error
 4. what it grasped last is no candidate                       wrong object believed
 5. it let a candidate go, which met a goal receptacle         object rolled off
 6. it let a candidate go elsewhere, or was refused to         place missed; receptacle not found
                                                               if it never got to a goal receptacle
 7. it grasped nothing, but tried where a candidate is         pick failed
 8. it grasped nothing, and ended where it tried in vain       wrong object believed
 9. the agent said so                                          stuck
10. what it looked for last had been found, steps were spent   step budget
11. it holds a candidate                                       receptacle not found
12. otherwise                                                  object not found

So a collision is the cause where nothing else went wrong; it is counted for every episode anyway.
An agent that spends its steps searching did not find what it looked for: the step budget is to
blame only where the thing had been found and nothing was done about it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from helios_core.task_states import ENDED

from helios_sim.episode_events import Event, PickTried, PlaceTried
from helios_sim.ovmm_metrics import Progress

OBJECT_NOT_FOUND = "object not found"
RECEPTACLE_NOT_FOUND = "receptacle not found"
WRONG_OBJECT = "wrong object believed"
PICK_FAILED = "pick failed"
COLLISION = "collision"
PLACE_MISSED = "place missed"
ROLLED_OFF = "object rolled off"
STUCK = "stuck"
STEP_BUDGET = "step budget"
SYSTEM_ERROR = "system error"
CAUSES = (
    OBJECT_NOT_FOUND,
    RECEPTACLE_NOT_FOUND,
    WRONG_OBJECT,
    PICK_FAILED,
    COLLISION,
    PLACE_MISSED,
    ROLLED_OFF,
    STUCK,
    STEP_BUDGET,
    SYSTEM_ERROR,
)
_ENDED_THERE_M = 1.0  # who drives no farther after a try has ended where it tried


class AgentReport(NamedTuple):
    """What the agent said of its task in the end."""

    state: str  # succeeded, failed or cancelled; anything else: it did not end
    cause: str = ""
    message: str = ""


def failure_cause(
    progress: Progress,
    events: Iterable[Event],
    said: AgentReport,
    max_steps: int,
) -> str:
    """The cause of a move task's failure, one of CAUSES; empty on success. See the module."""
    if progress.success:
        return ""
    if progress.placed:
        return COLLISION
    if _broke(said, progress.steps, max_steps):
        return SYSTEM_ERROR
    spent = progress.steps >= max_steps or said.cause == STEP_BUDGET
    happened = tuple(events)
    picks = [event for event in happened if isinstance(event, PickTried)]
    grasp = next((pick for pick in reversed(picks) if pick.name), None)
    if grasp is not None:
        return _after_grasp(progress, grasp, happened, said, spent)
    if any(pick.at_candidate for pick in picks):
        return PICK_FAILED
    if picks and progress.path_m - picks[-1].path_m < _ENDED_THERE_M:
        return WRONG_OBJECT
    if said.cause == STUCK:
        return STUCK
    return STEP_BUDGET if progress.find_object and spent else OBJECT_NOT_FOUND


def objectnav_cause(success: bool, steps: int, said: AgentReport, max_steps: int) -> str:
    """The cause of an object navigation's failure; empty on success.

    An agent that said it had arrived, and had not, believed in a wrong object.
    """
    if success:
        return ""
    if said.state == "succeeded":
        return WRONG_OBJECT
    if _broke(said, steps, max_steps):
        return SYSTEM_ERROR
    return STUCK if said.cause == STUCK else OBJECT_NOT_FOUND


def _after_grasp(
    progress: Progress,
    grasp: PickTried,
    happened: tuple[Event, ...],
    said: AgentReport,
    spent: bool,
) -> str:
    if not grasp.candidate:
        return WRONG_OBJECT
    tries = [e for e in happened if isinstance(e, PlaceTried) and e.step > grasp.step]
    let_go = next((place for place in reversed(tries) if place.released), None)
    if let_go is not None and let_go.rolled_off:
        return ROLLED_OFF
    if tries:
        return PLACE_MISSED if progress.find_receptacle else RECEPTACLE_NOT_FOUND
    if said.cause == STUCK:
        return STUCK
    return STEP_BUDGET if progress.find_receptacle and spent else RECEPTACLE_NOT_FOUND


def _broke(said: AgentReport, steps: int, max_steps: int) -> bool:
    return said.cause == SYSTEM_ERROR or (said.state not in ENDED and steps < max_steps)
