"""HomeRobot's heuristic agent: objects on start receptacles, receptacles before frontiers."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from helios_core.robot import Pick
from helios_planner.agents import AGENTS
from helios_planner.decisions.decision import DecisionRule, Do, FrontierOption
from helios_planner.decisions.global_search import nearest
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.detections import Sighting, sighting_of
from helios_planner.search.heuristic_search import CLOSE_M, HeuristicSearch, parts_of
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.mission import Mission
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_things import Box, Thing
from planner_world import FakeWorld

AGENT = "homerobot-heuristic"
EYE_M = np.array([1.5, 1.5, 1.3])


def mug_on_counter() -> Thing:
    return mug(x=2.9, y=6.5, z=0.95)


def search_in(world: FakeWorld, reported: list[Sighting], text: str = MOVE) -> HeuristicSearch:
    """The object search of the agent; `reported` is all that its detector reports."""
    world.sightings = lambda: list(reported)
    mission = Mission(world, parse(text), Settings(agent=AGENT))
    mission.tools.base.look_around()
    start = "coffee table" if "coffee table" in text else None
    search = mission.agent.seek_object(mission.tools, "mug", start)
    assert isinstance(search, HeuristicSearch)
    return search


def seen(name: str, x: float, y: float, size_m: float = 0.1, z: float = 0.4) -> Sighting:
    half = size_m / 2
    corners = [
        (x + a, y + b, z + c) for a in (-half, half) for b in (-half, half) for c in (0, 0.1)
    ]
    return sighting_of(name, 0.6, np.array(corners), EYE_M, False)


def run(world: FakeWorld, text: str = MOVE, agent: str = AGENT) -> None:
    Mission(world, parse(text), Settings(agent=agent, rounds=1)).run()


# --- the object ----------------------------------------------------------------------------------
def test_an_object_that_lies_on_no_start_receptacle_is_never_picked() -> None:
    """The trusting agent picks it."""
    world = flat([coffee_table(), counter(), mug_on_counter()])
    with pytest.raises(TaskFailed) as failure:
        run(world)
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert not any(isinstance(a, Pick) for a in world.log)
    trusted = flat([coffee_table(), counter(), mug_on_counter()])
    run(trusted, "Move the mug from the coffee table to the counter", "trusting")
    assert any(isinstance(a, Pick) for a in trusted.log)


def test_without_a_named_start_receptacle_an_object_counts_anywhere() -> None:
    world = flat([coffee_table(), counter(), mug_on_counter()])
    run(world, "Move the mug to the coffee table")
    assert world.released is world.things[3]


@pytest.mark.parametrize(
    ("mug_x", "counts"), [(3.0, True), (3.6, True), (3.8, False)], ids=["on", "at its rim", "off"]
)
def test_an_object_counts_on_a_detected_start_receptacle_or_at_its_rim(
    mug_x: float, counts: bool
) -> None:
    reported = [seen("mug", mug_x, 1.0)]
    search = search_in(flat(), reported)
    assert search.decide().do is Do.SEARCH_ON
    reported.append(seen("coffee table", 3.0, 1.0, 1.0))
    assert (search.decide().do is Do.ACT) is counts


# --- start receptacles ---------------------------------------------------------------------------
def test_a_detected_start_receptacle_is_visited_before_any_frontier() -> None:
    world = flat(start=Pose2(1.0, 1.5, 0.0))
    reported = [seen("coffee table", 3.5, 1.5, 0.4)]
    search = search_in(world, reported)
    assert search.explore()
    first = world.decisions[-1]
    assert (first.rule, first.do) == (DecisionRule.NEAREST_RECEPTACLE, Do.SEARCH_RECEPTACLE)
    assert first.why.startswith("look at the coffee table")
    assert math.dist(world.pose().xy, first.chosen.position_m[:2]) <= CLOSE_M
    for _ in range(20):
        search.explore()
        if world.decisions[-1].do is Do.GO_TO_FRONTIER:
            break
    assert world.decisions[-1].do is Do.GO_TO_FRONTIER
    assert not search._parts()


def test_all_parts_of_a_long_receptacle_are_visited() -> None:
    """A counter of 3 m: its ends are out of sight of each other's surroundings."""
    world = flat(start=Pose2(1.0, 1.5, 0.0))
    table = seen("coffee table", 2.0, 3.0, 3.0)
    search = search_in(world, [table])
    places = [world.pose().xy]
    while search._nearest_part(search._parts()) is not None:
        assert search.explore()
        places.append(world.pose().xy)
        assert len(places) < 40
    (thing,) = search.belief.known("coffee table")
    reached = [
        xy for xy in parts_of(thing) if min(math.dist(xy, p) for p in search._been) > CLOSE_M
    ]
    assert not reached


def test_a_start_receptacle_detected_on_the_way_to_a_frontier_ends_that_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reported: list[Sighting] = []
    search = search_in(flat(), reported)
    stops: list[bool] = []

    def visit(_: object, found: Callable[[], bool]) -> None:
        stops.append(found())
        reported.append(seen("coffee table", 3.5, 1.0, 0.4))
        stops.append(found())

    monkeypatch.setattr(search, "visit_frontier", visit)
    assert search.explore()
    assert stops == [False, True]


def test_an_unreachable_start_receptacle_does_not_keep_the_agent_from_frontiers() -> None:
    walls = [Box(2.5, 2.6, 2.6, 6.0, 2.5), Box(2.5, 2.6, 4.4, 2.7, 2.5), Box(2.5, 5.9, 4.4, 6, 2.5)]
    world = flat(extra=walls)
    search = search_in(world, [seen("coffee table", 3.6, 4.3, 0.3)])
    for _ in range(6):
        search.explore()
    assert any(d.do is Do.GO_TO_FRONTIER for d in world.decisions)


def test_visited_parts_outlive_a_restart_and_count_again_in_the_next_round() -> None:
    world = flat(start=Pose2(1.0, 1.5, 0.0))
    reported = [seen("coffee table", 3.5, 1.5, 0.4)]
    search = search_in(world, reported)
    search.explore()
    assert not search._parts()
    again = search_in(world, reported)
    again.restore(json.loads(json.dumps(search.checkpoint())))
    assert again._been[: len(search._been)] == search._been
    away = Pose2(1.0, 1.5, 0.0)
    search.robot.pose = lambda: away
    search._been.clear()
    assert search._parts()


# --- frontiers and goals -------------------------------------------------------------------------
def test_the_nearest_frontier_is_the_one_with_the_shortest_path() -> None:
    behind_a_wall = FrontierOption(1, (1.0, 0.0), 0.9, 1.0, way_m=6.0)
    ahead = FrontierOption(2, (3.0, 0.0), 0.1, 3.0, way_m=3.1)
    got = nearest([behind_a_wall, ahead], "pick", np.random.default_rng(0))
    assert got.chosen.id == 2
    assert got.chosen.terms["way_m"] == 3.1


def test_frontiers_are_offered_with_the_length_of_their_path() -> None:
    search = search_in(flat(start=Pose2(1.5, 1.5, 0.3)), [])
    options = search.frontier_options("pick")
    assert options
    assert all(o.way_m is not None and o.way_m > 0.9 * o.distance_m for o in options)


@pytest.mark.parametrize("setting", [True, False])
@pytest.mark.parametrize(("agent", "remembers"), [(AGENT, True), ("trusting", None)])
def test_a_goal_detected_before_the_pick_counts_whatever_the_setting_of_the_trusting_agent(
    agent: str, remembers: bool | None, setting: bool
) -> None:
    world = flat()
    world.sightings = lambda: [seen("counter", 4.0, 1.0)]
    tools = Mission(world, parse(MOVE), Settings(goal_seen_before_pick=setting), agent).tools
    tools.belief.known("counter")  # while the object was sought
    search = AGENTS[agent].seek_receptacle(tools, "counter", None)
    assert (search.decide().do is Do.ACT) is (setting if remembers is None else remembers)
