"""Tests the causes of failures case by case."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helios_sim import failure_causes
from helios_sim.episode_events import Collided, Event, PickTried, PlaceTried
from helios_sim.failure_causes import (
    CAUSES,
    AgentReport,
    absent_cause,
    failure_cause,
    objectnav_cause,
)
from helios_sim.ovmm_metrics import Progress
from hypothesis import given
from hypothesis import strategies as st

MAX = 1250
GAVE_UP = AgentReport("failed", "object not found", "nothing left to explore")
DONE = AgentReport("succeeded")
STUCK = AgentReport("failed", failure_causes.STUCK)
SPENT = AgentReport("failed", failure_causes.STEP_BUDGET)
BROKEN = AgentReport("failed", failure_causes.SYSTEM_ERROR)
GONE = AgentReport("running")

NOTHING = Progress(steps=80, path_m=20.0)
FOUND = replace(NOTHING, find_object=True)
PICKED = replace(FOUND, pick=True)
AT_GOAL = replace(PICKED, find_receptacle=True)
PLACED = replace(AT_GOAL, place=True, placed=True)
BUMPED = replace(PLACED, collisions=1, collided_with=("walls",))

GRASP = PickTried(40, 10.0, "mug", at_candidate=True, name="mug_0", candidate=True)
WRONG = replace(GRASP, at_candidate=False, name="vase_0", candidate=False)
VAIN = replace(GRASP, name="", candidate=False, reason="out of reach")
VAIN_AT_NOTHING = replace(VAIN, at_candidate=False, reason="nothing to grasp")
VAIN_AT_THE_END = replace(VAIN_AT_NOTHING, path_m=19.5)
ROLLED = PlaceTried(70, 19.0, "mug_0", "mug", True, released=True, met_goal=True, on_floor=True)
BESIDE = replace(ROLLED, met_goal=False)
REFUSED = replace(BESIDE, released=False, reason="no room")
BUMP = Collided(5, ("walls",))


@pytest.mark.parametrize(
    ("progress", "events", "said", "cause"),
    [
        (PLACED, [GRASP], DONE, ""),
        (PLACED, [GRASP], BROKEN, ""),
        (PLACED, [GRASP], STUCK, ""),
        # A collision is the cause if everything else succeeded, whatever the agent reports.
        (BUMPED, [BUMP, GRASP], DONE, failure_causes.COLLISION),
        (BUMPED, [BUMP, GRASP], BROKEN, failure_causes.COLLISION),
        (replace(FOUND, collisions=3), [BUMP], GAVE_UP, failure_causes.OBJECT_NOT_FOUND),
        # System error: the agent reports it, or never ends.
        (NOTHING, [], BROKEN, failure_causes.SYSTEM_ERROR),
        (AT_GOAL, [GRASP, ROLLED], BROKEN, failure_causes.SYSTEM_ERROR),
        (PICKED, [GRASP], GONE, failure_causes.SYSTEM_ERROR),
        (replace(NOTHING, steps=MAX), [], GONE, failure_causes.OBJECT_NOT_FOUND),
        # The wrong object, held, carried or placed.
        (NOTHING, [WRONG], DONE, failure_causes.WRONG_OBJECT),
        (FOUND, [WRONG, replace(ROLLED, candidate=False)], DONE, failure_causes.WRONG_OBJECT),
        (FOUND, [WRONG], STUCK, failure_causes.WRONG_OBJECT),
        (PICKED, [GRASP, BESIDE, replace(WRONG, step=75)], DONE, failure_causes.WRONG_OBJECT),
        # The right object, released.
        (AT_GOAL, [GRASP, ROLLED], DONE, failure_causes.ROLLED_OFF),
        (PICKED, [GRASP, ROLLED], DONE, failure_causes.ROLLED_OFF),
        (AT_GOAL, [WRONG, replace(GRASP, step=60), BESIDE], DONE, failure_causes.PLACE_MISSED),
        (AT_GOAL, [GRASP, REFUSED], SPENT, failure_causes.PLACE_MISSED),
        (PICKED, [GRASP, BESIDE], DONE, failure_causes.RECEPTACLE_NOT_FOUND),
        (AT_GOAL, [GRASP, ROLLED, replace(VAIN, step=75)], GAVE_UP, failure_causes.ROLLED_OFF),
        (AT_GOAL, [GRASP, ROLLED, replace(REFUSED, step=75)], GAVE_UP, failure_causes.ROLLED_OFF),
        # An object that was released and grasped again is held: earlier events no longer count.
        (AT_GOAL, [GRASP, ROLLED, replace(GRASP, step=75)], SPENT, failure_causes.STEP_BUDGET),
        # Nothing was grasped.
        (FOUND, [VAIN], GAVE_UP, failure_causes.PICK_FAILED),
        (FOUND, [VAIN, VAIN_AT_THE_END], SPENT, failure_causes.PICK_FAILED),
        (NOTHING, [VAIN_AT_THE_END], GAVE_UP, failure_causes.WRONG_OBJECT),
        (NOTHING, [VAIN_AT_NOTHING], GAVE_UP, failure_causes.OBJECT_NOT_FOUND),
        (NOTHING, [], GAVE_UP, failure_causes.OBJECT_NOT_FOUND),
        (FOUND, [], GAVE_UP, failure_causes.OBJECT_NOT_FOUND),
        # Stuck, or out of steps.
        (NOTHING, [], STUCK, failure_causes.STUCK),
        (PICKED, [GRASP], STUCK, failure_causes.STUCK),
        (NOTHING, [], SPENT, failure_causes.OBJECT_NOT_FOUND),
        (FOUND, [], SPENT, failure_causes.STEP_BUDGET),
        (replace(FOUND, steps=MAX), [], AgentReport("cancelled"), failure_causes.STEP_BUDGET),
        (PICKED, [GRASP], SPENT, failure_causes.RECEPTACLE_NOT_FOUND),
        (AT_GOAL, [GRASP], SPENT, failure_causes.STEP_BUDGET),
        (AT_GOAL, [GRASP], GAVE_UP, failure_causes.RECEPTACLE_NOT_FOUND),
    ],
)
def test_the_failure_cause_matches_the_case(
    progress: Progress, events: list[Event], said: AgentReport, cause: str
):
    assert failure_cause(progress, events, said, MAX) == cause


EVENTS = st.lists(st.sampled_from([GRASP, WRONG, VAIN, VAIN_AT_THE_END, ROLLED, BESIDE, BUMP]))


@given(
    st.sampled_from([NOTHING, FOUND, PICKED, AT_GOAL, BUMPED, PLACED]),
    EVENTS,
    st.sampled_from([GAVE_UP, DONE, STUCK, SPENT, BROKEN, GONE, AgentReport("", "", "")]),
)
def test_every_failure_has_one_cause_from_the_closed_list(
    progress: Progress, events: list[Event], said: AgentReport
):
    cause = failure_cause(progress, events, said, MAX)
    assert (cause in CAUSES) != progress.success


@given(st.sampled_from([NOTHING, FOUND, PICKED, AT_GOAL, BUMPED]), EVENTS, st.text())
def test_other_causes_reported_by_the_agent_do_not_change_the_cause(
    progress: Progress, events: list[Event], word: str
):
    others = [
        c
        for c in CAUSES
        if c not in (failure_causes.STUCK, failure_causes.STEP_BUDGET, failure_causes.SYSTEM_ERROR)
    ]
    causes = {failure_cause(progress, events, AgentReport("failed", c, word), MAX) for c in others}
    assert len(causes) == 1


@pytest.mark.parametrize(
    ("success", "steps", "said", "cause"),
    [
        (True, 100, DONE, ""),
        (False, 100, DONE, failure_causes.WRONG_OBJECT),
        (False, 100, STUCK, failure_causes.STUCK),
        (False, 100, GAVE_UP, failure_causes.OBJECT_NOT_FOUND),
        (False, 500, SPENT, failure_causes.OBJECT_NOT_FOUND),
        (False, 500, GONE, failure_causes.OBJECT_NOT_FOUND),
        (False, 100, GONE, failure_causes.SYSTEM_ERROR),
        (False, 100, BROKEN, failure_causes.SYSTEM_ERROR),
    ],
)
def test_the_cause_of_a_failed_object_navigation_matches_the_case(
    success: bool, steps: int, said: AgentReport, cause: str
):
    assert objectnav_cause(success, steps, said, 500) == cause


@pytest.mark.parametrize(
    ("progress", "events", "said", "cause"),
    [
        (NOTHING, [], GAVE_UP, ""),
        (NOTHING, [VAIN_AT_NOTHING], GAVE_UP, ""),
        (NOTHING, [VAIN_AT_THE_END], GAVE_UP, ""),
        (replace(NOTHING, steps=MAX), [], GAVE_UP, ""),
        # An object was moved, whatever the agent reports.
        (NOTHING, [WRONG], GAVE_UP, failure_causes.WRONG_OBJECT),
        (NOTHING, [WRONG], BROKEN, failure_causes.WRONG_OBJECT),
        (NOTHING, [WRONG], SPENT, failure_causes.WRONG_OBJECT),
        (NOTHING, [WRONG, VAIN_AT_NOTHING], GAVE_UP, failure_causes.WRONG_OBJECT),
        # Nothing was moved, but the agent believed in an object.
        (NOTHING, [], DONE, failure_causes.WRONG_OBJECT),
        (NOTHING, [VAIN_AT_THE_END], STUCK, failure_causes.WRONG_OBJECT),
        (
            NOTHING,
            [VAIN_AT_NOTHING],
            AgentReport("failed", failure_causes.PICK_FAILED),
            failure_causes.WRONG_OBJECT,
        ),
        # Used-up steps are no answer.
        (replace(NOTHING, steps=MAX), [], SPENT, failure_causes.STEP_BUDGET),
        (replace(NOTHING, steps=MAX), [], GONE, failure_causes.STEP_BUDGET),
        (NOTHING, [], SPENT, failure_causes.STEP_BUDGET),
        (NOTHING, [], STUCK, failure_causes.STUCK),
        (NOTHING, [], BROKEN, failure_causes.SYSTEM_ERROR),
        (NOTHING, [], GONE, failure_causes.SYSTEM_ERROR),
        (
            NOTHING,
            [],
            AgentReport("cancelled", failure_causes.OBJECT_NOT_FOUND),
            failure_causes.SYSTEM_ERROR,
        ),
    ],
)
def test_with_an_absent_object_only_the_report_not_found_without_a_pick_is_no_failure(
    progress: Progress, events: list[Event], said: AgentReport, cause: str
) -> None:
    assert absent_cause(progress, events, said, MAX) == cause


def test_with_an_absent_object_a_collision_is_a_failure() -> None:
    hit = replace(NOTHING, collisions=1)
    assert absent_cause(hit, [], GAVE_UP, MAX) == failure_causes.COLLISION
    assert absent_cause(hit, [WRONG], GAVE_UP, MAX) == failure_causes.WRONG_OBJECT


def test_with_an_absent_object_a_pick_for_a_look_is_no_failure_once_it_is_undone() -> None:
    assert absent_cause(NOTHING, [WRONG], GAVE_UP, MAX, all_put_back=True) == ""
    spent = replace(NOTHING, steps=MAX)
    assert absent_cause(spent, [WRONG], SPENT, MAX, all_put_back=True) == failure_causes.STEP_BUDGET


def test_an_object_that_was_put_back_is_not_the_cause() -> None:
    """Neither a wrong one nor a right one; the cause is what came of the search afterwards."""
    for grasp in (WRONG, GRASP):
        back = {grasp.name}
        cause = failure_cause(FOUND, [grasp], GAVE_UP, MAX, back)
        assert cause == failure_causes.OBJECT_NOT_FOUND
        assert failure_cause(FOUND, [grasp], SPENT, MAX, back) == failure_causes.STEP_BUDGET
    last = failure_cause(FOUND, [WRONG, GRASP], GAVE_UP, MAX, {WRONG.name})
    assert last == failure_causes.RECEPTACLE_NOT_FOUND
