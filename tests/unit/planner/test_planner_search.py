"""One step of a search at a time: what is offered, what is remembered, what is not done twice.

Nobody drives here: going somewhere is written down instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from helios_core.types import ObjectInstance
from helios_planner import global_search
from helios_planner.body import Frontier, WhatIf
from helios_planner.decide import Do, FrontierOption, ViewOption, act_or_look
from helios_planner.explore import MOST_WAITS
from helios_planner.flow import Mission
from helios_planner.gaze import GazePoint
from helios_planner.grid import Pose2
from helios_planner.instruction import parse
from helios_planner.legs import Outcome
from helios_planner.look import BestView, Looking
from helios_planner.object_search import ObjectSearch
from helios_planner.objective import ChosenFrontier
from helios_planner.receptacle_search import ReceptacleSearch
from helios_planner.settings import Settings
from helios_planner.standards import paper, patient
from planner_flat import coffee_table, counter, flat
from planner_things import Thing
from planner_world import FakeWorld

TABLE_XY = (7.0, 5.5)


def instance(thing: Thing, id: int = 0, class_score: float = 0.6, score: float = 0.4) -> Any:
    return ObjectInstance(
        id or thing.id, thing.class_name, thing.center_m, thing.size_m, score, class_score, 0.1, 3,
        100, {}, 0.5, np.empty((0, 2)), 1.0,
    )  # fmt: skip


class Looks:
    """Gaze points around a receptacle by how far the way is; each is gone to once."""

    def __init__(self, ways: Sequence[float], interrupted_after: int = 99) -> None:
        self.left = sorted(ways)
        self.gone_to: list[float] = []
        self.interrupted_after = interrupted_after
        self.then: Callable[[], None] = lambda: None  # after each look
        self.stop: Callable[[], bool] = lambda: False  # what would end the newest one

    def around(self, _: ObjectInstance) -> list[GazePoint]:
        return [GazePoint(Pose2(0.0, 0.0, 0.0), 0.0, way) for way in self.left]

    def information_gain_nats(self, *_: object) -> float | None:
        return 100.0 if self.left else None

    def go_and_look(
        self, _: ObjectInstance, gaze: GazePoint, purpose: str, stop: Callable[[], bool]
    ) -> Outcome:
        self.stop = stop
        if len(self.gone_to) == self.interrupted_after:
            self.interrupted_after = 99
            return Outcome.INTERRUPTED
        self.gone_to.append(gaze.arrival)
        self.then()
        self.left.remove(gaze.arrival)
        return Outcome.ARRIVED

    def option(
        self, thing: ObjectInstance, *_: object, in_place: bool, **__: object
    ) -> tuple[ViewOption, None]:
        return ViewOption(thing, thing.score, None, 1.0, in_place), None

    def forget(self) -> None:
        return


class Rig:
    """A search for a mug on the coffee table, in a world in which `known` is what is believed."""

    def __init__(self, looks: Looks | None = None, **settings: Any) -> None:
        self.world = flat()
        self.known: list[ObjectInstance] = []
        self.world.objects = lambda class_name: [
            o for o in self.known if o.class_name == class_name
        ]
        self.settings = Settings(**settings)
        self.kit = Mission(self.world, parse("find the mug"), self.settings).kit
        if looks is not None:
            self.kit.looking = cast(Looking, looks)
        self.search = ObjectSearch(
            self.kit, "mug", "coffee table", global_search.by_objective, paper
        )
        self.frontiers: list[FrontierOption] = []
        self.visited: list[tuple[float, float]] = []
        self.search.frontier_options = lambda layer: self.frontiers
        self.search.visit_frontier = lambda xy_m, found: self.visited.append(xy_m)

    def offered(self) -> list[int]:
        """Ids of the receptacles of the newest decision."""
        return [c.id for c in self.world.decisions[-1].candidates if c.kind == "receptacle"]


# --- local search --------------------------------------------------------------------------------
def test_a_local_search_looks_from_every_gaze_point_nearest_first_and_only_once() -> None:
    looks = Looks([3.0, 1.0, 2.0])
    rig = Rig(looks)
    rig.known = [instance(coffee_table())]
    assert rig.search.explore()
    assert looks.gone_to == [1.0, 2.0, 3.0]
    looks.left = [1.0]  # another one would be there
    assert not rig.search.explore()
    assert rig.offered() == []


def test_what_was_searched_is_known_by_its_place_when_its_id_changes() -> None:
    rig = Rig(Looks([1.0]))
    rig.known = [instance(coffee_table())]
    rig.search.explore()
    cast(Looks, rig.kit.looking).left = [1.0]
    moved = coffee_table()
    moved.center_m = moved.center_m + np.array([0.3, 0.0, 0.0])
    far = coffee_table()
    far.center_m = far.center_m + np.array([0.8, 0.0, 0.0])
    rig.known = [instance(moved, id=7), instance(far, id=8)]
    rig.search.explore()
    assert rig.offered() == [8]


def test_a_local_search_that_was_interrupted_goes_on_with_what_is_left() -> None:
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
    monkeypatch.setattr(rig.kit.legs, "look_around", lambda: None)
    rig.known = [instance(coffee_table())]
    rig.search.explore()
    rig.search.next_round()
    cast(Looks, rig.kit.looking).left = [1.0]
    assert rig.search.explore()
    assert rig.offered() == [1]


# --- what eq. 8 and 9 remember -------------------------------------------------------------------
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
    assert [f.value_when_chosen for f in rig.search.seen.chosen] == [0.3, 0.1]


def test_a_receptacle_is_remembered_as_it_was_first_seen_and_weighed_as_it_is() -> None:
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


# --- class scores --------------------------------------------------------------------------------
@pytest.mark.parametrize(("score", "counts"), [(0.29, False), (0.30, True)])
def test_what_is_believed_less_than_a_candidate_is_none(score: float, counts: bool) -> None:
    rig = Rig(Looks([1.0]))
    thing = Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.array([0.1, 0.1, 0.1]))
    rig.known = [instance(coffee_table(), class_score=score), instance(thing, class_score=score)]
    place = ReceptacleSearch(rig.kit, "coffee table", None, paper)
    assert bool(rig.search.candidates()) is counts
    assert bool(place.candidates()) is counts
    assert rig.search.explore() is counts


# --- the goal ------------------------------------------------------------------------------------
def test_the_goal_is_sought_by_the_place_layer() -> None:
    rig = Rig()
    rig.world.frontiers = lambda: [
        Frontier(1, (2.0, 1.0), 1.0, {"pick": 0.9, "place": 0.1}),
        Frontier(2, (1.0, 1.0), 1.0, {"pick": 0.1, "place": 0.9}),
    ]
    search = ReceptacleSearch(rig.kit, "counter", None, paper)
    search.visit_frontier = lambda xy_m, found: rig.visited.append(xy_m)
    search.explore()
    assert rig.visited == [(1.0, 1.0)]


def test_a_thing_is_not_put_back_where_it_was_taken_from() -> None:
    rig = Rig()
    rig.known = [instance(coffee_table(), score=0.9)]
    assert ReceptacleSearch(rig.kit, "coffee table", None, paper).candidates()
    taken_at = np.array([7.2, 5.35, 0.5])
    assert not ReceptacleSearch(rig.kit, "coffee table", taken_at, paper).candidates()


# --- extra views ---------------------------------------------------------------------------------
def seen_counter(**settings: Any) -> tuple[FakeWorld, Looking, ObjectInstance]:
    world = flat([counter()], Pose2(2.2, 5.0, 1.57))
    kit = Mission(world, parse("find the counter"), Settings(**settings)).kit
    kit.legs.look_around()
    (thing,) = world.objects("counter")
    return world, kit.looking, thing


def test_the_extra_view_is_the_one_that_would_raise_the_score_most() -> None:
    world, looking, thing = seen_counter()
    n = len(looking.views_of(thing)[: Settings().gaze_poses])
    scores = tuple(0.3 + 0.1 * (k == 1) for k in range(n))
    world.what_if = lambda *args, **kwargs: WhatIf(scores, ())
    best = looking.best_view(thing, "counter")
    assert best is not None
    assert best.gaze == looking.views_of(thing)[1]
    assert best.score == pytest.approx(0.4)


def test_no_view_is_gone_to_twice_and_so_many_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    _, looking, thing = seen_counter(extra_views=2)
    monkeypatch.setattr(looking.legs, "go_to", lambda *_: Outcome.UNREACHABLE)
    for _ in range(2):
        best = looking.best_view(thing, "counter")
        assert best is not None
        looking.go_and_look(thing, best.gaze, "test")
        apart = [best.gaze.pose.distance_m(g.pose.xy) for g in looking.views_of(thing)]
        assert min(apart) >= 0.6 * Settings().view_spacing_m
    assert looking.views_of(thing)
    assert looking.best_view(thing, "counter") is None


def test_a_sure_mug_elsewhere_ends_no_look_at_the_one_in_its_place() -> None:
    looks = Looks([1.0])
    rig = Rig(looks)
    size = np.array([0.1, 0.1, 0.1])
    here = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), size))
    elsewhere = instance(Thing(4, "mug", np.array([1.0, 1.0, 0.5]), size), score=0.9)
    rig.known = [instance(coffee_table()), here, elsewhere]
    (gaze,) = looks.around(here)
    rig.search._views = {3: BestView(gaze, 0.6)}
    look = act_or_look([ViewOption(here, 0.4, 0.6, 1.0)], 0.5, 0.05, "object", "pick")
    rig.search._look_again(look)
    assert not looks.stop()
    rig.search.settle_for_less()
    assert looks.stop()


# --- limits --------------------------------------------------------------------------------------
def test_what_is_out_of_reach_again_and_again_is_left_for_good(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig()
    monkeypatch.setattr(rig.kit.legs, "clear_way", lambda *_: False)
    thing = instance(coffee_table())
    for k in range(MOST_WAITS + 1):
        assert thing not in rig.search.refused
        rig.world._pose = Pose2(1.0 + 0.1 * k, 1.0, 0.0)
        rig.search.leave(thing, out_of_reach=True)
        rig.search._acted_from = rig.world.pose()
        rig.search.waiting.clear()
        rig.world._pose = replace(rig.world.pose(), yaw_rad=0.1 + k)
    assert thing in rig.search.refused


def test_a_frontier_that_stays_one_is_given_up_until_the_next_round(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig()
    done: list[str] = []

    def does(name: str) -> Callable[..., Outcome]:
        return lambda *_: (done.append(name), Outcome.ARRIVED)[1]

    for name in ("go_to", "turn_to", "look_down_around", "look_around"):
        monkeypatch.setattr(rig.kit.legs, name, does(name))
    rig.world.frontiers = lambda: [Frontier(1, (2.0, 1.5), 1.0, {"pick": 0.5, "place": 0.5})]
    search = ReceptacleSearch(rig.kit, "counter", None, paper)
    assert search.explore()
    assert done == ["go_to", "turn_to", "look_down_around"]  # it may lie at the robot's feet
    assert rig.kit.given_up == [(2.0, 1.5)]
    assert not search.explore()
    assert rig.world.decisions[-1].do is Do.NOTHING_LEFT
    search.next_round()
    assert search.explore()


# --- patience ------------------------------------------------------------------------------------
def test_a_patient_search_goes_on_past_a_doubtful_thing_and_takes_it_when_nothing_is_left() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.4)]
    search = ReceptacleSearch(rig.kit, "counter", None, patient)  # tau_b is 0.5
    assert search.decide().do is Do.SEARCH_ON
    while search.settle_for_less():
        pass
    decision = search.decide()
    assert decision.do is Do.ACT
    assert decision.settings["threshold"] < 0.4
    rig.known.append(instance(counter(), id=9, score=0.45))
    assert search.decide().chosen.id == 9  # the better of two, now that both will do


def test_a_patient_search_settles_for_less_as_its_steps_run_out_also_after_a_restart() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.4)]
    search = ReceptacleSearch(rig.kit, "counter", None, patient)
    rig.world.steps = int(0.5 * rig.world.max_steps)
    assert search.decide().do is Do.ACT
    rig.world.steps = 0
    again = ReceptacleSearch(rig.kit, "counter", None, patient)
    again.recall(search.memory())
    assert again.decide().do is Do.ACT


def test_a_mug_on_the_likely_table_counts_more_than_a_likelier_mug_elsewhere() -> None:
    rig = Rig(Looks([]))
    search = ObjectSearch(rig.kit, "mug", "coffee table", global_search.by_objective, patient)
    size = np.array([0.1, 0.1, 0.1])
    here = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), size), score=0.5)
    elsewhere = instance(Thing(4, "mug", np.array([1.0, 1.0, 0.5]), size), score=0.6)
    rig.known = [instance(coffee_table(), score=0.6), here, elsewhere]
    while search.settle_for_less():
        pass
    decision = search.decide()
    assert decision.chosen.id == 3
    assert search.place_of(here) == 1.0
    assert search.place_of(elsewhere) == pytest.approx(0.2 / 0.8)
    assert decision.candidates[1].terms["total"] == pytest.approx(0.6 * 0.25)
    rig.known = [here, elsewhere]  # no start receptacle is known: a place says nothing
    assert search.decide().chosen.id == 4


def test_the_paper_counts_no_place() -> None:
    rig = Rig(Looks([]))
    thing = Thing(4, "mug", np.array([1.0, 1.0, 0.5]), np.array([0.1, 0.1, 0.1]))
    rig.known = [instance(coffee_table(), score=0.6), instance(thing, score=0.9)]
    rig.search.settle_for_less()
    decision = rig.search.decide()
    assert decision.do is Do.ACT
    assert "place" not in decision.candidates[0].terms
