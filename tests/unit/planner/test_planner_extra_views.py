"""Extra views of one candidate: which view is taken, how many are, and what ends a look."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_core.types import ObjectInstance
from helios_planner.decisions.acceptance import act_or_look
from helios_planner.decisions.decision import Act, ViewOption
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import Outcome
from helios_planner.robot.interface import WhatIf
from helios_planner.search.view_selection import MOST_GAZE_POINTS, VIEW_RULES, BestView, ViewPlanner
from helios_planner.settings import Settings
from helios_planner.tasks.mission import Mission
from planner_flat import coffee_table, counter, flat
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing
from planner_world import FakeWorld


def seen_counter(**settings: Any) -> tuple[FakeWorld, ViewPlanner, ObjectInstance]:
    world = flat([counter()], Pose2(2.2, 5.0, 1.57))
    tools = Mission(world, parse("find the counter"), Settings(**settings)).tools
    tools.base.look_around()
    (thing,) = world.objects("counter")
    return world, tools.looking, thing


def test_the_extra_view_is_the_one_that_would_raise_the_score_most() -> None:
    world, looking, thing = seen_counter()
    n = len(looking.views_of(thing)[:MOST_GAZE_POINTS])
    scores = tuple(0.3 + 0.1 * (k == 1) for k in range(n))
    world.what_if = lambda *args, **kwargs: WhatIf(scores, ())
    best = looking.best_view(thing, "counter")
    assert best is not None
    assert best.gaze == looking.views_of(thing)[1]
    assert best.score == pytest.approx(0.4)


def test_the_gain_of_a_local_search_is_that_of_its_remaining_views(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The last case has as many views as before, at other places."""
    world, looking, thing = seen_counter()
    here = looking.remaining_gaze_points(thing)[:3]
    there = [replace(g, pose=replace(g.pose, x_m=g.pose.x_m + 0.5)) for g in here]
    gains = iter([1.0, 2.0])
    world.what_if = lambda *args, **kwargs: WhatIf((), (next(gains),))
    for points, gain in ((here, 1.0), (here, 1.0), (there, 2.0)):
        monkeypatch.setattr(looking, "remaining_gaze_points", lambda _, points=points: points)
        assert looking.information_gain_nats(thing, "counter") == gain


def test_the_gain_of_a_local_search_counts_the_ten_nearest_views(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world, looking, thing = seen_counter()
    first = looking.remaining_gaze_points(thing)[0]
    many = [replace(first, pose=replace(first.pose, x_m=float(k)), arrival=k) for k in range(14)]
    monkeypatch.setattr(looking, "remaining_gaze_points", lambda _: many)
    asked: list[Any] = []

    def what_if(*args: Any, **kwargs: Any) -> WhatIf:
        asked.extend(args[2])
        assert kwargs["joint"]
        return WhatIf((), (1.0,))

    world.what_if = what_if
    assert looking.information_gain_nats(thing, "counter")
    assert len(asked) == 10
    for T_world_cam, gaze in zip(asked, many, strict=False):
        assert np.allclose(T_world_cam, gaze.T_world_cam(world.description))


def test_no_view_is_visited_twice_and_their_number_is_limited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, looking, thing = seen_counter(extra_views=2)
    monkeypatch.setattr(looking.base, "go_to", lambda *_: Outcome.UNREACHABLE)
    for _ in range(2):
        best = looking.best_view(thing, "counter")
        assert best is not None
        looking.go_and_look(thing, best.gaze, "test")
        apart = [best.gaze.pose.distance_m(g.pose.xy) for g in looking.views_of(thing)]
        assert min(apart) >= 0.6 * VIEW_RULES.spacing_m
    assert looking.views_of(thing)
    assert looking.best_view(thing, "counter") is None


def test_an_accepted_mug_elsewhere_does_not_end_a_look_at_a_mug_in_place() -> None:
    looks = Looks([1.0])
    rig = Rig(looks)
    size = np.array([0.1, 0.1, 0.1])
    here = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), size))
    elsewhere = instance(Thing(4, "mug", np.array([1.0, 1.0, 0.5]), size), score=0.9)
    rig.known = [instance(coffee_table()), here, elsewhere]
    (gaze,) = looks.remaining_gaze_points(here)
    rig.search._views = {3: BestView(gaze, 0.6)}
    look = act_or_look([ViewOption(here, 0.4, 0.6, 1.0)], 0.5, 0.05, "object", Act.PICK)
    rig.search._look_again(look)
    assert not looks.stop()
    rig.search.relax()
    assert looks.stop()
