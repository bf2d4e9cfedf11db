"""Single steps of a search: what is offered, what is remembered, what is not repeated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from helios_planner.decisions.acceptance import paper
from helios_planner.decisions.decision import Do, FrontierOption
from helios_planner.decisions.global_search import ChosenFrontier
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import Outcome
from helios_planner.robot.interface import Frontier
from helios_planner.search.base import MAX_UNREACHABLE, MAX_UNREACHABLE_PER_CANDIDATE
from helios_planner.search.scored_search import ReceptacleSearch
from planner_flat import coffee_table
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing


def test_a_local_search_looks_from_every_gaze_point_nearest_first_and_only_once() -> None:
    looks = Looks([3.0, 1.0, 2.0])
    rig = Rig(looks)
    rig.known = [instance(coffee_table())]
    assert rig.search.explore()
    assert looks.gone_to == [1.0, 2.0, 3.0]
    looks.left = [1.0]  # a new gaze point
    assert not rig.search.explore()
    assert rig.offered() == []


def test_a_searched_receptacle_is_recognised_by_its_place_when_its_id_changes() -> None:
    rig = Rig(Looks([1.0]))
    rig.known = [instance(coffee_table())]
    rig.search.explore()
    cast(Looks, rig.tools.looking).left = [1.0]
    moved = coffee_table()
    moved.center_m = moved.center_m + np.array([0.3, 0.0, 0.0])
    far = coffee_table()
    far.center_m = far.center_m + np.array([0.8, 0.0, 0.0])
    rig.known = [instance(moved, id=7), instance(far, id=8)]
    rig.search.explore()
    assert rig.offered() == [8]


def test_an_interrupted_local_search_continues_with_the_remaining_gaze_points() -> None:
    looks = Looks([1.0, 2.0, 3.0], interrupted_after=1)
    rig = Rig(looks)
    rig.known = [instance(coffee_table())]
    rig.search.explore()
    assert looks.gone_to == [1.0]
    rig.search.explore()
    assert rig.offered() == [1]
    assert looks.gone_to == [1.0, 2.0, 3.0]


def test_a_mug_that_is_seen_on_the_way_ends_the_local_search() -> None:
    looks = Looks([1.0, 2.0])
    rig = Rig(looks)
    rig.known = [instance(coffee_table())]
    sure = Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.array([0.1, 0.1, 0.1]))
    looks.then = lambda: rig.known.append(instance(sure, score=0.9, class_score=0.95))
    rig.search.explore()
    assert looks.gone_to == [1.0]
    assert rig.search.visited.points == []


def test_in_the_next_round_every_receptacle_is_searched_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(Looks([1.0]))
    monkeypatch.setattr(rig.tools.base, "look_around", lambda: None)
    rig.known = [instance(coffee_table())]
    rig.search.explore()
    rig.search.next_round()
    cast(Looks, rig.tools.looking).left = [1.0]
    assert rig.search.explore()
    assert rig.offered() == [1]


def test_a_frontier_is_remembered_with_its_value_when_it_was_chosen() -> None:
    rig = Rig()
    rig.frontiers = [
        FrontierOption(4, (2.0, 1.0), 0.3, 1.0),
        FrontierOption(5, (1.0, 1.0), 0.2, 1.0),
    ]
    rig.search.explore()
    assert rig.visited == [(2.0, 1.0)]
    assert rig.search.seen.chosen == [ChosenFrontier((2.0, 1.0), 0.3)]
    rig.frontiers = [FrontierOption(4, (2.0, 1.0), 0.1, 1.0)]
    rig.search.explore()
    assert [f.value_when_chosen for f in rig.search.seen.chosen] == [0.1]  # it stands once


def test_a_receptacle_is_remembered_by_its_first_score_and_ranked_by_its_present_one() -> None:
    rig = Rig(Looks([1.0]))
    rig.known = [instance(coffee_table(), class_score=0.4)]
    rig.frontiers = [FrontierOption(4, (2.0, 1.0), 9.0, 1.0)]
    rig.search.explore()
    rig.known = [instance(coffee_table(), class_score=0.8)]
    rig.search.explore()
    assert rig.search.seen.first_seen[1].class_score == 0.4
    assert rig.search.seen.first_seen[1].center_xy_m == TABLE_XY
    (table,) = (c for c in rig.world.decisions[-1].candidates if c.kind == "receptacle")
    assert table.terms["class_score"] == 0.8


@pytest.mark.parametrize(("score", "counts"), [(0.29, False), (0.30, True)])
def test_an_instance_below_the_class_threshold_is_no_candidate(score: float, counts: bool) -> None:
    rig = Rig(Looks([1.0]))
    thing = Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.array([0.1, 0.1, 0.1]))
    rig.known = [instance(coffee_table(), class_score=score), instance(thing, class_score=score)]
    place = ReceptacleSearch(rig.tools, "coffee table", None, paper)
    assert bool(rig.search.candidates()) is counts
    assert bool(place.candidates()) is counts
    assert rig.search.explore() is counts


def test_the_goal_receptacle_is_searched_by_the_place_layer() -> None:
    rig = Rig()
    rig.world.frontiers = lambda: [
        Frontier(1, (2.0, 1.0), 1.0, {"pick": 0.9, "place": 0.1}),
        Frontier(2, (1.0, 1.0), 1.0, {"pick": 0.1, "place": 0.9}),
    ]
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    search.visit_frontier = lambda xy_m, found: rig.visited.append(xy_m)
    search.explore()
    assert rig.visited == [(1.0, 1.0)]


def test_a_goal_receptacle_that_the_map_already_has_is_used_without_a_further_search() -> None:
    """What the object map learned during the object search counts for the goal search too."""
    rig = Rig()
    rig.known = [instance(coffee_table(), score=0.9)]  # mapped while the object was sought
    search = ReceptacleSearch(rig.tools, "coffee table", None, paper)
    search.visit_frontier = lambda xy_m, found: rig.visited.append(xy_m)
    assert search.decide().do is Do.ACT
    assert search.decide().chosen.id == rig.known[0].id
    assert rig.visited == []


def test_an_object_is_not_placed_where_it_was_picked() -> None:
    rig = Rig()
    rig.known = [instance(coffee_table(), score=0.9)]
    assert ReceptacleSearch(rig.tools, "coffee table", None, paper).candidates()
    taken_at = np.array([7.2, 5.35, 0.5])
    assert not ReceptacleSearch(rig.tools, "coffee table", taken_at, paper).candidates()


@pytest.mark.parametrize("way_cleared", [True, False])
@pytest.mark.parametrize(
    ("apart_m", "times"), [(0.0, MAX_UNREACHABLE_PER_CANDIDATE), (2.0, MAX_UNREACHABLE)]
)
def test_a_candidate_that_is_too_often_unreachable_is_refused_for_good(
    apart_m: float, times: int, way_cleared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig()
    monkeypatch.setattr(rig.tools.base, "clear_way", lambda *_: way_cleared)
    thing = instance(coffee_table())
    for k in range(times + 1):
        center_m = thing.center_m + np.array([apart_m, 0.0, 0.0])
        thing = replace(thing, center_m=center_m, id=thing.id + bool(apart_m))
        assert thing not in rig.search.refused
        rig.world._pose = Pose2(1.0 + 0.1 * k, 1.0, 0.0)
        rig.search.reject_or_postpone(thing, out_of_reach=True)
        rig.search._acted_from = rig.world.pose()
        rig.search.unreachable.clear()
        rig.world._pose = replace(rig.world.pose(), yaw_rad=0.1 + k)
    assert thing in rig.search.refused


def test_a_visited_frontier_that_remains_is_given_up_until_the_next_round(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig()
    done: list[str] = []

    def does(name: str) -> Callable[..., Outcome]:
        return lambda *_: (done.append(name), Outcome.ARRIVED)[1]

    for name in ("go_to", "turn_to", "look_down_around", "look_around"):
        monkeypatch.setattr(rig.tools.base, name, does(name))
    rig.world.frontiers = lambda: [Frontier(1, (2.0, 1.5), 1.0, {"pick": 0.5, "place": 0.5})]
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    assert search.explore()
    assert done == ["go_to", "turn_to", "look_down_around"]  # it may lie at the robot's feet
    assert rig.tools.given_up == [(2.0, 1.5)]
    assert not search.explore()
    assert rig.world.decisions[-1].do is Do.NOTHING_LEFT
    search.next_round()
    assert search.explore()
