"""Find missions: how near the robot stops, and what it does if no path leads near the object."""

from __future__ import annotations

import math

import pytest
from helios_core.agent_presets import AgentName
from helios_core.types import ObjectInstance
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.base_placement import GazePoint
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import BaseController
from helios_planner.search.view_selection import ViewPlanner
from helios_planner.settings import Settings
from helios_planner.task import TaskFailed
from helios_planner.tasks.mission import Mission
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box
from planner_world import FakeWorld

NEAR_M = 1.0  # from the box, within which object navigation counts


def run(world: FakeWorld, text: str, agent: AgentName = "helios-paper") -> str:
    return Mission(world, parse(text), Settings(agent=agent)).run()


def distance_to_box_m(world: FakeWorld, id: int) -> float:
    """Return the distance on the ground from the base to the box of an object."""
    thing = world.things[id]
    beyond = abs(thing.center_m[:2] - world.pose().xy) - thing.size_m[:2] / 2
    return math.hypot(*beyond.clip(0))


@pytest.mark.parametrize("agent", ["helios-paper", "trusting"])
@pytest.mark.parametrize(("id", "name"), [(1, "coffee table"), (2, "counter"), (3, "mug")])
def test_the_robot_stops_near_enough_for_object_navigation(
    agent: AgentName, id: int, name: str
) -> None:
    world = flat([coffee_table(), counter(), mug()])
    assert f"found the {name}" in run(world, f"find the {name}", agent)
    assert distance_to_box_m(world, id) <= NEAR_M
    assert world.contacts == 0


@pytest.mark.parametrize("agent", ["helios-paper", "trusting"])
def test_an_object_that_no_path_leads_near_to_is_shown_from_as_near_as_possible(
    agent: AgentName, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mug in the middle of a wide table. Unknown ground on the path is looked at first; while
    there is any, the path is planned again."""
    wide = Box(1.0, 3.9, 4.2, 6.9, 0.5)
    world = flat([mug(4, x=2.6, y=5.4, z=0.55)], Pose2(1.5, 1.5, 1.2), [wide])
    stops_at, clear_way = ViewPlanner.stops_at, BaseController.clear_way
    sought, asked = list[int](), list[tuple[float, float]]()

    def seek(looking: ViewPlanner, thing: ObjectInstance) -> list[GazePoint]:
        sought.append(thing.id)
        return stops_at(looking, thing)

    def watched(base: BaseController, target: tuple[float, float], within_m: float) -> bool:
        asked.append(target)
        was_unknown = clear_way(base, target, within_m)
        return was_unknown or (math.dist(target, (2.6, 5.4)) < 0.05 and len(sought) == 1)

    monkeypatch.setattr(ViewPlanner, "stops_at", seek)
    monkeypatch.setattr(BaseController, "clear_way", watched)
    assert "found the mug at (2.60, 5.40" in run(world, "find the mug", agent)
    assert asked[-1] == pytest.approx((2.6, 5.4), abs=0.05)
    assert len(sought) >= 2
    assert NEAR_M < distance_to_box_m(world, 4) < 2.2


@pytest.mark.parametrize(("agent", "shown"), [("helios-paper", False), ("helios", True)])
def test_only_the_patient_agent_shows_a_doubtful_candidate(agent: AgentName, shown: bool) -> None:
    """The only candidate is detected as a mug in half of its views."""
    world = flat([counter(), mug(4, 2.9, 6.5, 0.95, rate=0.5)], Pose2(1.5, 4.0, 1.2))
    if shown:
        assert "found the mug" in run(world, "find the mug", agent)
    else:
        with pytest.raises(TaskFailed, match="no mug was found"):
            run(world, "find the mug", agent)
    assert world.steps < world.max_steps / 2
