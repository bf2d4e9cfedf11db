"""Missions that only move the robot: go to a point, explore, return to the start."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from helios_core.robot import Action, ActionResult, Forward
from helios_planner.decisions.decision import DecisionRule, Do
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.unknown_borders import borders_of
from helios_planner.navigation.point_goal import padded_to_point, state_of, walled
from helios_planner.settings import Settings
from helios_planner.task import Cause, Phase, TaskCancelled, TaskFailed, TimeIsUp
from helios_planner.tasks.move_mission import MoveMission
from helios_planner.tasks.run_control import LastAction
from hypothesis import given
from hypothesis import strategies as st
from planner_flat import flat
from planner_things import Box
from planner_world import FakeWorld


def mission(world: FakeWorld, text: str) -> MoveMission:
    return MoveMission(world, parse(text), Settings())


def failure_of(world: FakeWorld, text: str) -> TaskFailed:
    with pytest.raises(TaskFailed) as failure:
        mission(world, text).run()
    return failure.value


# --- to a point ---------------------------------------------------------------------------------
def test_the_robot_ends_at_the_point_with_the_wanted_heading() -> None:
    world = flat()
    said = mission(world, "go to 3.5, 5 facing -90 degrees").run()
    assert world.pose().distance_m((3.5, 5.0)) < 0.12
    assert abs(world.pose().yaw_rad + math.pi / 2) < math.radians(10)
    assert said.startswith("stands at (3.")
    assert said.endswith(" m from the goal")
    assert "facing -9" in said or "facing -8" in said
    assert world.contacts == 0
    assert world.phases == [Phase.GO]


def test_a_point_in_another_room_is_reached_over_unseen_ground() -> None:
    world = flat()
    mission(world, "go to 8.3, 6.3").run()
    assert world.pose().distance_m((8.3, 6.3)) < 0.12
    assert world.contacts == 0
    why = [d.why for d in world.decisions]
    assert why
    assert all("where the known ground ends" in one for one in why)


def test_known_ground_needs_no_decision() -> None:
    world = flat()
    mission(world, "go to 8.3, 6.3").run()
    world.decisions.clear()
    mission(world, "go to 3, 2").run()
    assert world.decisions == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("go to 2.2, 6.6", "(2.20, 6.60) m is inside an obstacle"),
        ("go to 20, 3", "(20.00, 3.00) m is unknown ground, and no way to it was found"),
        ("go to 500, 3", "the robot is sent 100 m at most"),
    ],
)
def test_a_point_out_of_reach_is_reported_with_the_nearest_place(text: str, says: str) -> None:
    world = flat()
    failure = failure_of(world, text)
    assert failure.cause is Cause.UNREACHABLE
    assert says in failure.message
    assert "500" in text or "the nearest place that can be reached is (" in failure.message
    assert world.contacts == 0


def test_a_point_too_near_to_a_wall_is_replaced_by_a_place_beside_it() -> None:
    world = flat()
    said = mission(world, "go to 0.2, 3").run()
    assert 0.1 < world.pose().distance_m((0.2, 3.0)) < 0.37
    assert "m from the goal" in said
    failure = failure_of(world, "go to 0.05, 3")
    assert "is inside an obstacle" in failure.message or "from an obstacle" in failure.message


def test_a_point_behind_a_gap_that_is_too_narrow_is_out_of_reach() -> None:
    closed = Box(4.4, 2.5, 4.5, 3.1, 2.5)  # leaves 0.4 m of the door
    world = flat(extra=[closed])
    mission(world, "explore").run()
    failure = failure_of(world, "go to 7.5, 3")
    assert failure.cause is Cause.UNREACHABLE
    assert world.contacts == 0


def test_a_point_in_a_closed_room_is_given_up_within_a_few_looks() -> None:
    """A box closes the only door of the third room."""
    world = flat(start=Pose2(5.5, 3.0, 0.0), extra=[Box(6.5, 4.0, 7.5, 4.1, 2.5)])
    failure = failure_of(world, "go to 6.0, 6.0")
    assert failure.cause is Cause.UNREACHABLE
    assert world.contacts == 0
    assert world.steps < 400


# --- home ---------------------------------------------------------------------------------------
def test_the_robot_returns_to_its_start() -> None:
    world = flat()
    mission(world, "go to 8, 3").run()
    said = mission(world, "come back").run()
    assert world.pose().distance_m((1.5, 1.5)) < 0.12
    assert said.endswith("m from where it started")


def test_an_unknown_start_is_reported() -> None:
    world = flat()
    world.started_at = None
    failure = failure_of(world, "go home")
    assert failure.cause is Cause.UNREACHABLE
    assert "does not know yet where the robot started" in failure.message


# --- exploring ----------------------------------------------------------------------------------
def test_exploring_covers_all_reachable_floor_and_gives_a_reason_for_each_frontier() -> None:
    world = flat()
    said = mission(world, "explore the home").run()
    assert "m² of floor are known" in said
    free = (world.truth_top == 0).sum() * 0.025**2
    known = (world.ground().occupancy == 0).sum() * 0.025**2
    assert known > 0.97 * free
    assert world.contacts == 0
    went = [d for d in world.decisions if d.do is Do.GO_TO_FRONTIER]
    assert went
    assert {d.rule for d in went} == {DecisionRule.NEAREST_BY_WAY}
    for decision in went:
        ways = [c.terms["way_m"] for c in decision.candidates]
        assert decision.chosen.terms["way_m"] == min(ways)
        assert f"its way is {min(ways):.1f} m" in decision.why
    assert world.phases == [Phase.EXPLORE]


def test_a_home_that_is_known_is_not_explored_again() -> None:
    world = flat()
    while borders_of(world.ground(), 0.4, 0.015):  # borders that the first run could not see past
        before = world.steps
        mission(world, "explore").run()
        assert world.steps - before < 400
    before = world.steps
    said = mission(world, "explore").run()
    assert world.steps == before
    assert "0.0 m² of them new; nothing reachable is unknown" in said


def test_a_map_that_shrank_is_reported_as_nothing_new() -> None:
    exploration = mission(flat(), "explore").exploration
    exploration.restore({"borders_given_up": [], "borders": [], "before_m2": 1e3})
    exploration.run()
    assert ", 0.0 m² of them new" in exploration.said()


def test_a_border_that_the_robot_cannot_see_past_is_reported() -> None:
    world = flat()
    explored = mission(world, "explore")
    ground = world.ground

    def never_seen() -> GroundMap:
        seen = ground()
        seen.occupancy[40:70, 40:70] = -1  # a rug that the camera cannot make out
        return seen

    world.ground = never_seen
    said = explored.run()
    assert "could not see past (1." in said


def test_an_exploration_that_runs_out_of_time_succeeds() -> None:
    world = flat()
    act = world.act

    def until(action: Action) -> ActionResult:
        if world.steps >= 60:
            raise TimeIsUp("the task's 5 s are used up")
        return act(action)

    world.act = until
    said = mission(world, "explore").run()
    assert "the task's 5 s are used up" in said
    assert "left to look at" in said


def test_an_exploration_that_runs_out_of_steps_reports_the_known_floor() -> None:
    world = flat()
    world.max_steps = 60
    failure = failure_of(world, "explore")
    assert failure.cause is Cause.STEP_BUDGET
    assert "m² of floor are known" in failure.message


# --- over a restart -----------------------------------------------------------------------------
@pytest.mark.parametrize("text", ["go to 8.3, 6.3 facing 45 degrees", "explore", "come back"])
def test_an_interrupted_mission_resumes_where_it_was_cut_off(text: str) -> None:
    world = flat()
    mission(world, "go to 3, 5").run()
    first = mission(world, text)
    world.cancel_after = world.steps + 8
    with pytest.raises(TaskCancelled):
        first.run()
    world.cancel_after = None
    checkpoint = json.loads(json.dumps(first.checkpoint()))
    again = mission(world, text)
    again.restore(checkpoint, LastAction(Forward(0.5), True, "", ""))
    again.run()
    assert json.loads(json.dumps(again.checkpoint())).keys() == checkpoint.keys()
    assert world.contacts == 0


# --- pure ---------------------------------------------------------------------------------------
@given(
    st.integers(1, 30),
    st.integers(1, 30),
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), max_size=4),
)
def test_a_padded_map_covers_the_point_and_keeps_the_known_cells(
    rows: int, columns: int, x_m: float, y_m: float, walls: list[tuple[float, float]]
) -> None:
    occupancy = np.zeros((rows, columns), np.int8)
    ground = GroundMap(occupancy, np.zeros((rows, columns), np.float32), 0.1, (0.05, -0.3))
    more = walled(padded_to_point(ground, (x_m, y_m)), walls)
    assert more.inside(more.cells_of(np.array([[x_m, y_m]])))[0]
    known = ground.centres_of(np.argwhere(occupancy == 0))
    cells = more.cells_of(known)
    assert (more.occupancy[cells[:, 0], cells[:, 1]] == 0).all()
    assert set(np.unique(more.occupancy)) <= {-1, 0, 100}
    assert state_of(more, (x_m, y_m), 0.3).startswith("is ")
