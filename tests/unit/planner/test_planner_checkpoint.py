"""Each field of a mission is in its checkpoint, or listed here as one that a crash may lose.

A new field fails this test until the `checkpoint` and `restore` of its class hold it, or the list
below names it.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from helios_core.robot import Observe
from helios_planner.agents import AGENTS
from helios_planner.instruction.parser import parse
from helios_planner.manipulation import _Failed
from helios_planner.settings import Settings
from helios_planner.tasks.mission import Mission
from helios_planner.tasks.move_mission import MoveMission
from helios_planner.tasks.run_control import LastAction
from planner_flat import MOVE, flat_with_mug

GIVEN = "robot settings instruction agent tools base belief looking rng attempts rules"
# The lost fields are computed again, come from the store, or hold only between two actions.
SEARCH_KEPT = "refused unreachable _waited_at _doubts _round _first_round _latest_round _patrol"
SEARCH_LOST = "phase name rounds _acted_from _first _left_at"
SCORED_KEPT = f"{SEARCH_KEPT} _step _since _decision_step _past_candidates _rated _set_aside"
SCORED_LOST = f"{SEARCH_LOST} _thresholds _views _from_memory _known_home _chosen_place"
KEPT_AND_LOST = {
    "Mission": (
        "looked_around target_m picked_at_m unsure skills hand search placed",
        "seen_at_goal _fell _restored",
    ),
    "SearchTools": ("given_up rng belief looking base", ""),
    "Manipulation": ("picks falls last_reason _failed", "near surface_m placed_on"),
    "HandCheck": ("put_back returning_m unseen_m unchecked", "cannot_show refuted"),
    "BaseController": ("felt_obstacles blind_zone", "monitor _cached _turns _cleared"),
    "ViewPlanner": ("_looks", "_other_share _views _gains"),
    "ObjectSearch": (
        f"{SCORED_KEPT} seen visited _searched _tried _seen_in_hand",
        f"{SCORED_LOST} start _rule _last_seen _unnamed _most_unnamed _refuted_earlier",
    ),
    "StopSearch": (f"{SCORED_KEPT} _explorer visited", SCORED_LOST),
    "ReceptacleSearch": (
        f"{SCORED_KEPT} _failed _in_last_resort",
        f"{SCORED_LOST} _not_at _explorer",
    ),
    "MoveMission": ("looked_around exploration point_goal", "_restored"),
    "Exploration": (
        "given_up _ids _before_m2",
        "_robot _base _settings _now_m2 _left _cached",
    ),
}


def stateful() -> list[object]:
    """Return one object of each class that has a checkpoint."""
    mission = Mission(flat_with_mug(), parse(MOVE), Settings())
    moves = MoveMission(flat_with_mug(), parse("explore"), Settings())
    tools, agent = mission.tools, mission.agent
    return [
        mission, tools, mission.skills, mission.hand, tools.base, tools.looking,
        agent.seek_object(tools, "mug", None), agent.seek_receptacle(tools, "counter", None),
        moves, moves.exploration, AGENTS["vlfm-helios-stop"].seek_object(tools, "mug", None),
    ]  # fmt: skip


@pytest.mark.parametrize("name", KEPT_AND_LOST)
def test_every_field_is_in_the_checkpoint_or_listed_as_lost(name: str) -> None:
    (found,) = (one for one in stateful() if type(one).__name__ == name)
    kept, lost = (set(text.split()) for text in KEPT_AND_LOST[name])
    unnamed = vars(found).keys() - kept - lost - set(GIVEN.split())
    assert not unnamed, f"add {unnamed} of {name} to its checkpoint and restore, or to this table"
    assert kept | lost <= vars(found).keys(), "the table names what is not there"


def test_a_checkpoint_of_an_earlier_planner_without_the_newer_fields_is_read() -> None:
    checkpoint = Mission(flat_with_mug(), parse(MOVE), Settings()).checkpoint()
    del checkpoint["placed"], checkpoint["unchecked"]
    again = Mission(flat_with_mug(), parse(MOVE), Settings())
    again.restore(checkpoint, LastAction(Observe(), True, "", ""))
    assert (again.placed, again.hand.unchecked) == (False, False)


def test_a_restored_mission_gives_the_same_checkpoint() -> None:
    mission = Mission(flat_with_mug(), parse(MOVE), Settings())
    mission.looked_around = mission.placed = mission.hand.unchecked = True
    mission.skills.picks, mission.skills.last_reason = 2, "it slipped"
    mission.hand.put_back, mission.hand.returning_m = 1, np.array([1.0, 2.0, 0.5])
    mission.tools.base.felt_obstacles.append((1.0, 2.0, 0.08))
    mission.tools.base.blind_zone.discs.append((1.0, 1.0, 0.5))
    mission.tools.given_up.append((3.0, 4.0))
    failed = _Failed([(1.0, 2.0, 0.8)], [(1.0, 1.2)])
    mission.skills._failed.append(((1.1, 2.1), failed))
    checkpoint = json.loads(json.dumps(mission.checkpoint()))
    again = Mission(flat_with_mug(), parse(MOVE), Settings())
    again.restore(checkpoint, LastAction(Observe(), True, "", ""))
    assert again.skills.failed_places == 1
    assert json.loads(json.dumps(again.checkpoint())) == checkpoint
