"""Searches in a home whose stored map is in use, and thresholds without image-text scores."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helios_core.agent_presets import AgentName
from helios_core.robot import Turn
from helios_planner.decisions.acceptance import UNRATED, paper, patient
from helios_planner.decisions.decision import ANY_SCORE, Do
from helios_planner.instruction.parser import parse
from helios_planner.search.scored_search import ReceptacleSearch
from helios_planner.settings import Settings
from helios_planner.tasks.mission import Mission
from planner_flat import counter, flat, flat_with_mug, mug
from planner_rig import Looks, Rig, instance

LOOKS = [(0.0, 0.0, 0.0)] * 20  # views of the stored map


@pytest.mark.parametrize(
    ("rate", "remembered", "agent", "text", "goes_at_once"),
    [
        (1.0, True, "helios", "find the mug", True),
        (0.0, True, "helios", "find the mug", False),
        (1.0, False, "helios", "find the mug", False),
        (1.0, True, "helios-paper", "find the mug", False),
        (1.0, True, "helios", "find the mug on the coffee table", False),
        (1.0, True, "helios", "go to the counter", True),
    ],
)
def test_the_robot_looks_around_only_until_a_stored_map_has_what_it_seeks(
    rate: float, remembered: bool, agent: AgentName, text: str, goes_at_once: bool
) -> None:
    things = [counter(), mug(rate=rate)]
    for thing in things:
        thing.views, thing.remembered = list(LOOKS), remembered
    world = flat(things)
    mission = Mission(world, parse(text), Settings(agent=agent, rounds=1))
    looked = len(world.log)
    mission.tools.base.look_around(mission._remembers_it)
    turns = [a for a in world.log[looked:] if isinstance(a, Turn)]
    assert (sum(a.angle_rad for a in turns) < 1.0) is goes_at_once


def test_agents_without_an_object_map_look_around_completely() -> None:
    world = flat_with_mug()
    mission = Mission(world, parse("find the mug"), Settings(agent="trusting"))
    mission.tools.base.look_around(mission._remembers_it)
    assert sum(a.angle_rad for a in world.log if isinstance(a, Turn)) == pytest.approx(6.283, 0.01)


def test_a_candidate_of_a_stored_map_needs_no_surplus_over_the_threshold() -> None:
    # tau_b is 0.5, and 1.4 tau_b is 0.7
    for score, relocalised, wanted in (
        (0.55, False, Do.SEARCH_ON),
        (0.55, True, Do.ACT),
        (0.45, True, Do.SEARCH_ON),
    ):
        rig = Rig(Looks([]))
        rig.known = [replace(instance(counter(), score=score), relocalised=relocalised)]
        search = ReceptacleSearch(rig.tools, "counter", None, patient)
        assert search.decide().do is wanted


def test_a_faint_candidate_of_a_stored_map_lowers_no_threshold_and_a_good_one_for_itself() -> None:
    rig = Rig(Looks([]))
    faint = replace(instance(counter(), id=8, score=0.01), relocalised=True)
    rig.known = [faint, instance(counter(), score=0.55)]
    search = ReceptacleSearch(rig.tools, "counter", None, patient)
    assert search.decide().do is Do.SEARCH_ON
    rig.known.append(replace(instance(counter(), id=9, score=0.6), relocalised=True))
    assert search.decide().chosen.id == 9
    rig.known.pop()
    assert search.decide().do is Do.SEARCH_ON


def test_a_restart_keeps_whether_the_scorer_rates_the_class() -> None:
    rig = Rig(Looks([]))
    rig.known = [replace(instance(counter(), score=0.1), image_text_nats=None)]
    search = ReceptacleSearch(rig.tools, "counter", None, patient)
    search.decide()
    again = ReceptacleSearch(rig.tools, "counter", None, patient)
    again.restore(search.checkpoint())
    assert again.threshold == search.threshold < 0.7


def test_thresholds_are_lower_for_a_class_that_the_scorer_does_not_rate() -> None:
    known = instance(counter(), score=0.6)  # between 0.8 * 0.7 and 0.7
    for nats, wanted in ((0.0, Do.SEARCH_ON), (None, Do.ACT)):
        rig = Rig(Looks([]))
        rig.known = [replace(known, image_text_nats=nats)]
        search = ReceptacleSearch(rig.tools, "counter", None, patient)
        decision = search.decide()
        assert decision.do is wanted
        share = 1.0 if nats is not None else UNRATED
        assert decision.settings["threshold"] == pytest.approx(0.7 * share)


def test_the_threshold_of_the_paper_and_the_last_resort_are_never_scaled() -> None:
    for rated in (True, False):
        assert paper(0.5, False).step(0, rated).score == 0.5
        within = replace(patient(0.5, False), at_last=0.9)
        last = replace(within.steps[-1], score=ANY_SCORE)
        assert replace(within, steps=(*within.steps, last)).step(-1, rated).score == ANY_SCORE
