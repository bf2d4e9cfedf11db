"""Revisit search: looking around from place to place once everything was searched."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import Turn
from helios_planner.decisions.acceptance import paper
from helios_planner.instruction.parser import parse
from helios_planner.manipulation import Manipulation
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.path_planner import MotionRules, reach
from helios_planner.navigation.base_controller import BaseController
from helios_planner.search.base import RevisitSearch, next_place
from helios_planner.search.scored_search import ReceptacleSearch
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.mission import Mission
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_rig import Looks, Rig, instance

CELL_M = 0.1


def room(width_m: float, height_m: float) -> GroundMap:
    cells = (round(height_m / CELL_M), round(width_m / CELL_M))
    occupancy = np.zeros(cells, np.int8)
    occupancy[[0, -1]] = occupancy[:, [0, -1]] = 100
    return GroundMap(occupancy, np.zeros(cells, np.float32), CELL_M, (0.0, 0.0), 0)


def rules() -> MotionRules:
    return MotionRules(0.2, 0.05, 0.3, 0.015, 0.1, 1.0, math.radians(5), math.radians(30))


@settings(max_examples=25, deadline=None)
@given(st.floats(2, 8), st.floats(2, 8), st.floats(0.8, 4))
def test_revisit_places_are_apart_and_cover_all_reachable_ground(
    width_m: float, height_m: float, apart_m: float
) -> None:
    reached = reach(room(width_m, height_m), Pose2(1.0, 1.0, 0.0), rules())
    places = [(1.0, 1.0)]
    while (place := next_place(reached, places, apart_m)) is not None:
        places.append(place)
    assert all(math.dist(a, b) >= apart_m for a, b in itertools.combinations(places, 2))
    assert np.isfinite(reached.at(np.array(places))).all()
    xy = reached.ground.centres_of(np.argwhere(np.isfinite(reached.arrival)))
    away_m = np.min([np.hypot(xy[:, 0] - x, xy[:, 1] - y) for x, y in places], axis=0)
    assert away_m.max() < apart_m + 0.3  # 0.3 m: the grid on which places are considered


def test_a_revisit_search_goes_to_the_nearest_place_first_and_looks_all_around() -> None:
    world = flat()
    base = BaseController(world, Settings())
    base.look_around()
    patrol = RevisitSearch(base, 1.5)
    patrol.begin()
    begun = len(world.log)
    place = next_place(base.reach(), patrol.seen_from, 1.5)
    assert place is not None
    assert patrol.step("look", lambda: False)
    assert world.pose().distance_m(place) < 0.3
    assert sum(abs(a.angle_rad) for a in world.log[-12:] if isinstance(a, Turn)) == pytest.approx(
        2 * math.pi
    )
    assert begun < len(world.log) - 12
    assert patrol.seen_from[-1] == place


def test_a_revisit_search_stops_as_soon_as_something_is_found() -> None:
    world = flat()
    base = BaseController(world, Settings())
    base.look_around()
    patrol = RevisitSearch(base, 1.5)
    patrol.begin()
    steps = world.steps
    assert patrol.step("look", lambda: True)
    assert world.steps - steps <= 2
    assert len(patrol.seen_from) == 1  # the place may be visited again


def test_a_robot_that_holds_an_object_searches_for_a_place_in_more_rounds() -> None:
    """No counter is ever detected; a search without a held object gives up after two rounds."""
    unseen = counter()
    unseen.rate = 0.0
    rounds = {}
    for most in (1, 4):
        world = flat([coffee_table(), unseen, mug()])
        with pytest.raises(TaskFailed) as failure:
            Mission(world, parse(MOVE), Settings(rounds_held=most)).run()
        assert failure.value.cause is Cause.RECEPTACLE_NOT_FOUND
        rounds[most] = world.steps
    assert rounds[4] > rounds[1] + 3 * 12


def test_a_counter_that_is_first_seen_in_the_revisit_search_is_found() -> None:
    late = counter()
    late.rate = 0.0
    world = flat([coffee_table(), late, mug()])
    mission = Mission(world, parse(MOVE), Settings())
    begin = RevisitSearch.begin

    def begin_and_show(patrol: RevisitSearch) -> None:
        late.rate = 1.0
        begin(patrol)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RevisitSearch, "begin", begin_and_show)
        mission.run()
    assert world.released is world.things[3]


def test_after_an_attempt_in_a_later_round_the_search_still_looks_from_other_places() -> None:
    rig = Rig(Looks([]), rounds=2)
    assert not rig.search.patrol()  # the first round
    rig.search.explore = rig.search.clear_way = lambda: False
    with pytest.raises(TaskFailed):
        rig.search.find()
    looked = len(rig.search._patrol.seen_from)
    assert looked > 2
    rig.search._round, rig.search._patrol.seen_from = 0, rig.search._patrol.seen_from[:2]
    assert rig.search.patrol()  # as when the search goes on after an attempt


def test_a_thing_beside_an_unreachable_one_stays_a_candidate() -> None:
    rig = Rig(Looks([]))
    thing = instance(mug())
    beside = replace(thing, id=9, center_m=thing.center_m + np.array([0.3, 0.0, 0.0]))
    rig.tools.base.clear_way = lambda target, within_m: False
    rig.search.reject_or_postpone(thing, out_of_reach=True)
    assert not rig.search.open(thing)
    assert rig.search.open(beside)


def test_near_the_end_a_receptacle_is_confirmed_whatever_is_seen_from_near() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.3)]
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    search.accept_any_after_share(0.88)
    assert not search.confirmed(None)
    rig.world.steps = int(0.9 * rig.world.max_steps)
    search.decide()
    assert search.confirmed(None)


def test_an_object_is_placed_where_a_vanished_receptacle_was_if_that_is_accepted() -> None:
    world = flat([coffee_table(), counter(), mug()])
    Mission(world, parse("go to the counter"), Settings()).run()
    base, asked = BaseController(world, Settings()), []
    mission = Mission(world, parse(MOVE), Settings())
    skills = Manipulation(world, base, Settings(), mission.tools.belief, 1)
    thing = next(o for o in world.objects("counter"))
    world._held = world.things[3]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mission.tools.belief, "from_near", lambda *_: None)
        skills.place(thing, "counter", lambda near: asked.append(near) is None)
    assert asked[0] is None
    assert world.released is world.things[3]


def test_the_places_of_a_revisit_search_are_in_the_checkpoint() -> None:
    search = ReceptacleSearch(Rig(Looks([])).tools, "counter", None, paper)
    search._patrol.seen_from = [(1.0, 2.0), (3.5, 1.0)]
    again = ReceptacleSearch(Rig(Looks([])).tools, "counter", None, paper)
    again.restore(search.checkpoint())
    assert again._patrol.seen_from == [(1.0, 2.0), (3.5, 1.0)]
