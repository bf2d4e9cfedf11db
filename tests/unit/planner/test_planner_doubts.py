"""Candidates that score well from afar and badly from near are neither picked nor placed on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from helios_core.robot import Place
from helios_core.types import ObjectInstance
from helios_planner.decisions.acceptance import paper
from helios_planner.decisions.decision import DecisionRule
from helios_planner.manipulation import Manipulation, SkillOutcome
from helios_planner.match_radii import RECEPTACLE_SHIFT_M
from helios_planner.search.base import MOST_DOUBTS
from helios_planner.search.candidate_beliefs import MapBelief
from helios_planner.search.scored_search import ReceptacleSearch
from helios_planner.settings import Settings
from helios_planner.task import TaskFailed
from planner_flat import coffee_table, counter, flat, mug
from planner_rig import Looks, Rig, instance
from planner_things import Thing
from planner_trouble import bring
from planner_world import FakeWorld


@dataclass
class LookAlike(Thing):
    """An object that loses class score with every view from near."""

    near_m: float = 1.3

    def near_views(self) -> int:
        x, y, _ = self.center_m
        return sum(math.dist(v[:2], (x, y)) < self.near_m for v in self.views)

    def score_at(self, views: int) -> tuple[float, float, float]:
        s = max(0.4, 0.8 - 0.4 * self.near_views())
        return s - 0.05, s, 0.05


def test_nothing_is_placed_on_a_receptacle_that_is_doubted_from_near() -> None:
    """From afar the bed is classified as a counter."""
    bed = LookAlike(
        4,
        "counter",
        np.array([7.8, 1.0, 0.45]),
        np.array([2.0, 1.8, 0.1]),
        graspable=False,
        near_m=2.4,
    )
    world = flat([coffee_table(), counter(), mug(), bed])
    bring(world)
    assert bed.near_views()
    (placed,) = [a.point_world_m for a in world.log if isinstance(a, Place)]
    assert math.dist(placed[:2], world.things[2].center_m[:2]) < 1.0


def test_an_object_that_is_doubted_from_near_is_not_picked() -> None:
    lamp = LookAlike(4, "mug", np.array([6.8, 5.6, 0.5]), np.array([0.08, 0.08, 0.1]))
    world = flat([coffee_table(), counter(), mug(), lamp])
    bring(world)
    assert lamp.near_views()
    assert world.picks == 1
    assert world.released is world.things[3]


def given_up(world: FakeWorld) -> list[str]:
    """Return why candidates were given up; check that messages repeat it until the next action."""
    kept = [d.why for d in world.decisions if d.rule == DecisionRule.GIVEN_UP]
    for why in kept:
        (step, *_), *after = [(s, m) for s, m in world.said if m.startswith(why)]
        assert after, "what comes next says it, too"
        assert {m.startswith(f"{why}; ") for s, m in after if s == step} == {True}
        assert any(s > step and not m.startswith(why) for s, m in world.said)
    return kept


def test_the_reason_for_giving_up_a_pick_is_recorded_and_reported() -> None:
    lamp = LookAlike(4, "mug", np.array([6.8, 5.6, 0.5]), np.array([0.08, 0.08, 0.1]))
    world = flat([coffee_table(), counter(), mug(), lamp])
    bring(world)
    assert given_up(world) == ["give up picking the mug: from near its score is 0.35 < 0.45"]


def test_a_failed_pick_is_given_up_for_the_reason_that_the_robot_gave() -> None:
    world = flat([coffee_table(), counter(), replace(mug(), slippery=99)])
    with pytest.raises(TaskFailed):
        bring(world, rounds=1)
    assert given_up(world) == ["give up picking the mug: it slipped"]


def test_the_reason_for_giving_up_a_receptacle_is_recorded_and_reported() -> None:
    bed = LookAlike(
        4,
        "counter",
        np.array([7.8, 1.0, 0.45]),
        np.array([2.0, 1.8, 0.1]),
        graspable=False,
        near_m=2.4,
    )
    world = flat([coffee_table(), counter(), mug(), bed])
    bring(world)
    assert given_up(world)[0].startswith("give up placing on the counter: from near its score is")


@pytest.mark.parametrize("skill", ["pick", "place"])
def test_a_candidate_that_is_doubted_too_often_is_given_up(
    skill: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def doubting(_: Manipulation, thing: ObjectInstance, *__: object) -> SkillOutcome:
        asked.append(thing.id)
        return SkillOutcome.DOUBTED

    monkeypatch.setattr(Manipulation, skill, doubting)
    with pytest.raises(TaskFailed):
        bring(flat([coffee_table(), counter(), mug()]), rounds=1)
    assert asked == [3 if skill == "pick" else 2] * MOST_DOUBTS


def test_a_rejected_candidate_is_not_confirmed() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.9)]
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    (thing,) = rig.known
    assert search.confirmed(thing)
    search.reject_or_postpone(thing, out_of_reach=False)
    assert not search.confirmed(thing)


def test_a_vanished_instance_is_not_matched_to_another_one_beside_it() -> None:
    world = flat([counter(2), counter(5)])
    world.things[5].center_m = np.array([2.7, 6.62, 0.85])
    world.things[5].views.append((2.2, 5.5, 1.6))
    gone = replace(world.objects("counter")[0], id=9, center_m=np.array([2.1, 6.62, 0.85]))
    assert MapBelief(world, Settings()).from_near(gone, "counter", RECEPTACLE_SHIFT_M) is None


def test_a_receptacle_that_is_seen_more_fully_from_near_stays_the_same_instance() -> None:
    """From afar only its left end is known; from near it is whole, and a second one is there."""
    world = flat([coffee_table(), counter(), counter(5), mug()])
    belief = MapBelief(world, Settings())
    world.things[5].center_m = np.array([2.0, 6.62, 0.85])
    for id in (2, 5):
        world.things[id].views.append((2.2, 5.5, 1.6))
    left_end = replace(world.objects("counter")[0], center_m=np.array([1.5, 6.6, 0.85]))
    whole = belief.from_near(left_end, "counter", RECEPTACLE_SHIFT_M)
    assert whole is not None
    assert whole.id == left_end.id == 2
    assert belief.from_near(left_end, "counter", 0.3) is None


def test_from_near_a_score_may_be_below_the_threshold_by_tau_inc() -> None:
    rig = Rig(Looks([]))
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    least = search.threshold - rig.settings.tau_inc
    for score, holds in ((least + 0.01, True), (least - 0.01, False)):
        rig.known = [instance(counter(), score=score)]
        assert search.confirmed(rig.known[0]) is holds
