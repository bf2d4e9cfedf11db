"""Failure cause of an episode: one of a closed list, derived from ground-truth events.

The agent's own report is used only for facts that the ground truth lacks: the agent was stuck, ran
out of steps, or failed internally. The first matching row gives the cause:

 1. success                                                    no cause
 2. a candidate rests on a goal receptacle                     collision
 3. the agent reports it, or did not end with steps left       system error
 4. the last object that was grasped and not put back is no    wrong object believed
    candidate
 5. a released candidate touched a goal receptacle             object rolled off
 6. a candidate was released elsewhere, or the release was     place missed; receptacle not found
    refused                                                    if no goal receptacle was reached
 7. no such object, but a pick failed at a candidate           pick failed
 8. no such object, and the episode ended at a failed pick     wrong object believed
 9. the agent reports it                                       stuck
10. the object or receptacle sought last had been found,       step budget
    and the steps are used up
11. the robot holds a candidate                                receptacle not found
12. otherwise                                                  object not found

A collision is the cause only if nothing else went wrong; collisions are counted in every episode.
An agent that uses up its steps while searching did not find its target. The cause is the step
budget only if the target had been found.

A task whose object is absent from the home (`absent_cause`) has other rows:

1. an object was grasped and does not lie where it was         wrong object believed
2. the agent reports that it found no object                   no cause: this is the success;
                                                               collision if there was one
3. the agent reports it, or did not end with steps left        system error
4. the agent reports success or a failed pick, or the          wrong object believed
   episode ended at a failed pick, also with all steps used
5. the agent reports another cause                             that cause
6. the steps are used up                                       step budget
7. otherwise                                                   system error
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
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
_ENDED_THERE_M = 1.0  # an episode that ended at a pick drove less than this after it


class AgentReport(NamedTuple):
    """Final task state, as the agent reports it."""

    state: str  # succeeded, failed or cancelled; any other value: the task did not end
    cause: str = ""
    message: str = ""


def failure_cause(
    progress: Progress,
    events: Iterable[Event],
    said: AgentReport,
    max_steps: int,
    put_back: Collection[str] = (),
) -> str:
    """Failure cause of a move task, one of CAUSES; empty on success. See the module.

    put_back: names of the grasped objects that lie where they were.
    """
    if progress.success:
        return ""
    if progress.placed:
        return COLLISION
    if _broke(said, progress.steps, max_steps):
        return SYSTEM_ERROR
    spent = progress.steps >= max_steps or said.cause == STEP_BUDGET
    happened = tuple(events)
    picks = [e for e in happened if isinstance(e, PickTried) and e.name not in put_back]
    grasp = next((pick for pick in reversed(picks) if pick.name), None)
    if grasp is not None:
        return _after_grasp(progress, grasp, happened, said, spent)
    if any(pick.at_candidate for pick in picks):
        return PICK_FAILED
    if _ended_at(picks, progress):
        return WRONG_OBJECT
    if said.cause == STUCK:
        return STUCK
    return STEP_BUDGET if progress.find_object and spent else OBJECT_NOT_FOUND


def absent_cause(
    progress: Progress,
    events: Iterable[Event],
    said: AgentReport,
    max_steps: int,
    all_put_back: bool = False,
) -> str:
    """Failure cause of a move task whose object is absent, one of CAUSES; empty on success.

    The success is the report "object not found". all_put_back: every object that was grasped lies
    where it was. See the module.
    """
    picks = [event for event in events if isinstance(event, PickTried)]
    if any(pick.name for pick in picks) and not all_put_back:
        return WRONG_OBJECT
    if said.state == "failed" and said.cause == OBJECT_NOT_FOUND:
        return COLLISION if progress.collisions else ""
    if _broke(said, progress.steps, max_steps):
        return SYSTEM_ERROR
    if said.state == "succeeded" or said.cause == PICK_FAILED or _ended_at(picks, progress):
        return WRONG_OBJECT
    if said.cause in CAUSES and said.cause != OBJECT_NOT_FOUND:
        return said.cause
    return STEP_BUDGET if progress.steps >= max_steps else SYSTEM_ERROR


def objectnav_cause(success: bool, steps: int, said: AgentReport, max_steps: int) -> str:
    """Failure cause of an object-navigation task; empty on success.

    An agent that reports success away from the object gets the cause WRONG_OBJECT.
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


def _ended_at(picks: Sequence[PickTried], progress: Progress) -> bool:
    """True if the robot drove less than 1 m after its last pick attempt."""
    return bool(picks) and progress.path_m - picks[-1].path_m < _ENDED_THERE_M


def _broke(said: AgentReport, steps: int, max_steps: int) -> bool:
    return said.cause == SYSTEM_ERROR or (said.state not in ENDED and steps < max_steps)
