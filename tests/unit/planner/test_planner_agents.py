"""Differences between the agents, in a fake world of plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import pytest
from helios_core.agent_presets import AGENT_NAMES, AgentName
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix
from helios_core.robot import Observe, Pick
from helios_planner.agents import AGENTS, agent_named
from helios_planner.decisions.decision import DecisionRule, Do
from helios_planner.instruction.parser import parse
from helios_planner.manipulation import SkillOutcome
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.detections import Sighting
from helios_planner.robot.interface import WhatIf
from helios_planner.search.object_search import ObjectSearch
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.mission import Mission
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_things import Thing
from planner_world import FakeWorld

DETECTOR_AGENTS = ("trusting", "random-frontier", "homerobot-heuristic")


class NoObjectMap(FakeWorld):
    """A world in which any call to the object map fails the test."""

    def objects(self, class_name: str) -> NoReturn:
        raise AssertionError(f"the object map was asked for every {class_name}")

    def what_if(
        self,
        id: int,
        class_name: str,
        T_world_cam: Sequence[Matrix],
        joint: bool,
        other_share: float | None = None,
    ) -> WhatIf:
        raise AssertionError("the object map was asked what a view would bring")

    def retire(self, id: int, point_m: object, reason: str) -> None:
        raise AssertionError("the object map was told to forget something")


def without_map(world: FakeWorld) -> FakeWorld:
    world.__class__ = NoObjectMap
    return world


def run(world: FakeWorld, agent: AgentName, text: str = MOVE, **settings: Any) -> str:
    chosen = Settings(agent=agent, **settings)
    return Mission(world, parse(text), chosen).run()


def false_mug() -> Thing:
    """Make a false mug on the counter: the detector reports it, and no pick of it succeeds."""
    wrong = mug(4, 2.9, 6.5, 0.95)
    wrong.graspable = False
    return wrong


# --- the table -----------------------------------------------------------------------------------
def test_the_table_of_agents_has_exactly_the_known_names() -> None:
    assert tuple(AGENTS) == AGENT_NAMES


def test_an_unknown_agent_is_refused_with_the_known_names() -> None:
    with pytest.raises(InvalidInput, match=r"choose one of helios, helios-paper, .*trusting"):
        agent_named("clever")


@pytest.mark.parametrize("agent", [name for name in AGENTS if "vlfm" not in name])
def test_every_agent_brings_a_mug_that_is_always_detected(agent: AgentName) -> None:
    """Agents that trust the detector do so without the object map."""
    world = flat([coffee_table(), counter(), mug()])
    run(without_map(world) if agent in DETECTOR_AGENTS else world, agent)
    assert world.released is world.things[3]
    assert world.contacts == 0


# --- trusting ------------------------------------------------------------------------------------
@pytest.mark.parametrize("agent", DETECTOR_AGENTS)
@pytest.mark.parametrize("text", ["find the mug", "go to the counter"])
def test_agents_that_trust_the_detector_never_call_the_object_map(
    agent: AgentName, text: str
) -> None:
    run(without_map(flat([coffee_table(), counter(), mug()])), agent, text)


def test_the_trusting_agent_picks_the_first_reported_mug_even_if_it_is_false() -> None:
    """A false mug on the counter is seen from the start; HELIOS has not found the coffee table yet
    and does not pick it."""

    def first_pick(agent: AgentName) -> float:
        world = flat([coffee_table(), counter(), mug(), false_mug()], Pose2(1.5, 1.5, 1.2))
        run(world, agent)
        return next(a.point_world_m[0] for a in world.log if isinstance(a, Pick))

    assert first_pick("trusting") == pytest.approx(2.9, abs=0.05)
    assert first_pick("helios-paper") == pytest.approx(7.2, abs=0.05)


def test_a_failed_pick_excludes_its_place_and_the_search_continues() -> None:
    world = flat([coffee_table(), counter(), mug(), false_mug()])
    run(world, "trusting")
    at_false = [a for a in world.log if isinstance(a, Pick) and a.point_world_m[0] < 4]
    assert len(at_false) == 1
    assert world.picks == 2
    assert world.released is world.things[3]


def test_helios_refuses_an_object_that_it_could_not_pick_and_takes_another() -> None:
    """The object map keeps the object; its place is refused for the rest of the task."""
    stuck = mug(4, 6.8, 5.6)
    stuck.graspable = False
    world = flat([coffee_table(), counter(), mug(), stuck], Pose2(7.0, 4.6, 1.57))
    mission = Mission(world, parse(MOVE), Settings())
    mission.tools.base.look_around()
    search = mission.agent.seek_object(mission.tools, "mug", "coffee table")
    wrong = next(o for o in world.objects("mug") if o.id == stuck.id)
    assert mission.skills.pick(wrong, "mug") is SkillOutcome.FAILED
    assert world.picks == Settings().picks_per_object
    search.reject_or_postpone(wrong, out_of_reach=False)
    assert isinstance(search, ObjectSearch)
    assert [o.id for o in search.candidates()] == [3]
    search.next_round()
    again = mission.agent.seek_object(mission.tools, "mug", "coffee table")
    again.restore(search.checkpoint())
    for later in (search, again):
        assert not later.open(wrong)
        assert later.open(next(o for o in world.objects("mug") if o.id == 3))


def test_the_pick_limit_holds_for_the_trusting_agent() -> None:
    world = flat([coffee_table(), counter(), mug(), false_mug()])
    with pytest.raises(TaskFailed) as failure:
        run(world, "trusting", max_picks=1)
    assert failure.value.cause is Cause.PICK_FAILED


def test_an_object_that_is_no_longer_detected_from_near_is_still_picked() -> None:
    """The mug is reported once, from afar; the robot goes there and grasps at that place."""
    world = flat([coffee_table(), counter(), mug()])
    everything = world.sightings

    def forgetful() -> list[Sighting]:
        mugs = [k for k, s in enumerate(everything()) if s.class_name == "mug"]
        return [s for k, s in enumerate(everything()) if k not in mugs[1:]]

    world.sightings = forgetful
    run(world, "trusting")
    assert world.released is world.things[3]


# --- frontiers -----------------------------------------------------------------------------------
def walk(agent: AgentName, seed: int) -> list[tuple[float, float]]:
    world = flat([coffee_table(), counter()])
    world.max_steps = 90
    with pytest.raises(TaskFailed):
        run(world, agent, agent_seed=seed)
    return [d.chosen.position_m[:2] for d in world.decisions if d.do is Do.GO_TO_FRONTIER]


def test_random_walks_are_equal_for_one_seed_and_differ_between_seeds() -> None:
    first = walk("random-frontier", 3)
    assert walk("random-frontier", 3) == first
    assert any(walk("random-frontier", seed) != first for seed in range(3))


# --- without the objective -----------------------------------------------------------------------
@pytest.mark.parametrize("agent", ["no-global-objective", "nearest-frontier"])
def test_without_the_objective_no_frontier_is_chosen_while_a_receptacle_is_left(
    agent: AgentName,
) -> None:
    world = flat([coffee_table(), counter()])
    with pytest.raises(TaskFailed):
        run(world, agent, rounds=1)
    searched = [d for d in world.decisions if d.do is Do.SEARCH_RECEPTACLE]
    assert searched
    for d in world.decisions:
        if d.do is Do.GO_TO_FRONTIER:
            assert all(c.kind == "frontier" for c in d.candidates)


def test_the_nearest_frontier_has_the_shortest_way_before_and_after_the_pick() -> None:
    world = flat([coffee_table(), counter(), mug(3)])
    with pytest.raises(TaskFailed) as failure:
        run(world, "nearest-frontier", "Move the mug from the coffee table to the sofa", rounds=1)
    assert failure.value.cause is Cause.RECEPTACLE_NOT_FOUND
    walks = [d for d in world.decisions if d.do is Do.GO_TO_FRONTIER]
    assert {d.rule for d in walks} == {DecisionRule.NEAREST_FRONTIER}
    for d in walks:
        assert d.chosen.terms["way_m"] == min(c.terms["way_m"] for c in d.candidates)


# --- the start receptacle ------------------------------------------------------------------------
@pytest.mark.parametrize("agent", ["helios-paper", "no-global-objective"])
def test_a_mug_elsewhere_is_picked_only_when_everything_was_searched(agent: AgentName) -> None:
    """By our rule. The only mug is on the counter, and the instruction names the coffee table."""
    world = flat([coffee_table(), counter(), mug(x=2.9, y=6.5, z=0.95)])
    with pytest.raises(TaskFailed) as failure:
        run(world, agent, "Move the mug from the coffee table to the sofa", rounds=1)
    assert failure.value.cause is Cause.RECEPTACLE_NOT_FOUND  # it holds the mug
    assert world.held() == "mug"
    kinds = [d.do for d in world.decisions]
    first_act = kinds.index(Do.ACT)
    assert Do.NOTHING_LEFT in kinds[:first_act]
    assert any("remembered" in d.why for d in world.decisions[:first_act])
    assert Do.SEARCH_RECEPTACLE in kinds[:first_act]


def test_the_first_accepted_mug_is_picked_if_no_start_receptacle_is_given() -> None:
    world = flat([coffee_table(), counter(), mug(x=2.9, y=6.5, z=0.95)])
    with pytest.raises(TaskFailed):
        run(world, "helios-paper", "Move the mug to the sofa", rounds=1)
    kinds = [d.do for d in world.decisions]
    assert Do.NOTHING_LEFT not in kinds[: kinds.index(Do.ACT)]


# --- out of reach --------------------------------------------------------------------------------
def test_an_unreachable_object_is_tried_again_only_once_more_ground_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = flat([coffee_table(), counter(), mug(x=2.9, y=6.5, z=0.95)], Pose2(1.5, 1.5, 1.2))
    mission = Mission(world, parse(MOVE), Settings(agent="trusting"))
    monkeypatch.setattr(mission.tools.base, "clear_way", lambda target, within_m: False)
    search = mission.agent.seek_object(mission.tools, "mug", None)
    found = search.find()
    for _ in range(50):  # retries count for nothing while the robot does not move
        search.reject_or_postpone(found, out_of_reach=True)
        assert not search.open(found)
        assert not search.end_waiting()
        assert search.open(found)
    search.reject_or_postpone(found, out_of_reach=True)
    world.act(Observe())
    assert search.end_waiting()
    assert search.open(found)


def test_an_object_behind_unknown_ground_is_looked_at_immediately(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = flat([coffee_table(), counter(), mug(x=2.9, y=6.5, z=0.95)], Pose2(1.5, 1.5, 1.2))
    mission = Mission(world, parse(MOVE), Settings(agent="trusting"))
    looked: list[tuple[float, float]] = []

    def clear_way(target: tuple[float, float], within_m: float) -> bool:
        looked.append(target)
        return True

    monkeypatch.setattr(mission.tools.base, "clear_way", clear_way)
    search = mission.agent.seek_object(mission.tools, "mug", None)
    found = search.find()
    search.reject_or_postpone(found, out_of_reach=True)
    assert looked == [pytest.approx((2.9, 6.5), abs=0.05)]
    assert search.open(found)
