"""Views of an accepted candidate from new sides, before the robot acts on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import ObjectInstance
from helios_planner.decisions.decision import DecisionRule, Do, ViewOption
from helios_planner.motion_planning.base_placement import GazePoint
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.interface import WhatIf
from helios_planner.search.view_selection import SIDES, BestView, one_per_side
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing
from test_planner_extra_views import seen_counter

MUG = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.full(3, 0.1)))


class NewSides(Looks):
    """Every gaze point shows a new side, until none is left."""

    def view_from_new_side(self, thing: ObjectInstance, _: str) -> BestView | None:
        points = self.remaining_gaze_points(thing)
        return BestView(points[0], thing.score + 0.1) if points else None

    def option(
        self, thing: ObjectInstance, *_: object, in_place: bool, **__: object
    ) -> tuple[ViewOption, None]:
        return ViewOption(thing, thing.score, None, 1.0, in_place), None


def search_of_a_mug(sides: int, check_views: int) -> tuple[Rig, NewSides]:
    looks = NewSides([float(k) for k in range(sides)])
    rig = Rig(looks, check_views=check_views, start_receptacle_first=False)
    rig.known = [replace(MUG, score=0.6)]
    return rig, looks


@pytest.mark.parametrize(("sides", "check_views", "looks_taken"), [(5, 3, 3), (2, 3, 2), (5, 0, 0)])
def test_the_robot_looks_from_new_sides_before_it_acts(
    sides: int, check_views: int, looks_taken: int
) -> None:
    rig, looks = search_of_a_mug(sides, check_views)
    assert rig.search.decide_and_publish().do is Do.ACT
    assert len(looks.gone_to) == looks_taken
    rules = [d.rule for d in rig.world.decisions]
    assert rules == [DecisionRule.CHECK_VIEW] * looks_taken + [DecisionRule.PICK]


def test_a_mug_that_looks_wrong_from_a_new_side_is_not_picked() -> None:
    rig, looks = search_of_a_mug(5, 3)
    looks.then = lambda: rig.known.__setitem__(0, replace(MUG, score=0.2))
    assert rig.search.decide_and_publish().do is Do.SEARCH_ON
    assert len(looks.gone_to) == 1


def test_a_restart_does_not_repeat_the_checks() -> None:
    rig, looks = search_of_a_mug(5, 3)
    rig.search.decide_and_publish()
    again, more = search_of_a_mug(5, 3)
    again.search.restore(rig.search.checkpoint())
    again.search.decide_and_publish()
    assert (len(looks.gone_to), len(more.gone_to)) == (3, 0)


def test_the_last_candidate_is_acted_on_without_a_check() -> None:
    rig, looks = search_of_a_mug(5, 3)
    rig.search.accept_any_after_share(0.0)
    assert rig.search.decide_and_publish().do is Do.ACT
    assert looks.gone_to == []


def test_the_nearest_view_that_could_raise_the_score_enough_is_taken() -> None:
    world, looking, thing = seen_counter(check_gain=0.1)
    points = one_per_side(looking.views_of(thing), thing.center_m[:2])
    assert len(points) >= 3
    gains = [0.05, 0.2, 0.3, *[0.0] * len(points)][: len(points)]
    world.what_if = lambda *args, **kwargs: WhatIf(tuple(thing.score + g for g in gains), ())
    view = looking.view_from_new_side(thing, "counter")
    assert view is not None
    assert view.gaze == points[1]
    world.what_if = lambda *args, **kwargs: WhatIf((thing.score + 0.09,) * len(points), ())
    assert looking.view_from_new_side(thing, "counter") is None


def test_one_view_is_taken_of_each_side() -> None:
    middle = np.array([2.0, -1.0])
    angles = np.linspace(0, math.tau, 7 * SIDES, endpoint=False) + 1e-3
    points = [
        GazePoint(Pose2(middle[0] + math.cos(a), middle[1] + math.sin(a), 0.0), 0.0, float(k))
        for k, a in enumerate(angles)
    ]
    assert [g.arrival for g in one_per_side(points, middle)] == [7.0 * k for k in range(SIDES)]
