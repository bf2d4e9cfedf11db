"""Extra views of one candidate: which view is taken, how many are, and what ends a look."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from helios_core.types import ObjectInstance
from helios_planner.decisions.acceptance import act_or_look
from helios_planner.decisions.decision import Act, ViewOption
from helios_planner.decisions.gain import Gain
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import Outcome
from helios_planner.robot.interface import WhatIf
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.view_selection import VIEW_RULES, BestView, ViewPlanner
from helios_planner.settings import GainNorm, Settings
from helios_planner.task import Cause, TaskFailed
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


def searched_counter(norm: GainNorm) -> tuple[Mission, ObjectInstance]:
    """A mission that seeks a mug on a counter that it has seen."""
    world = flat([counter()], Pose2(2.2, 5.0, 1.57))
    text = "Move the mug from the counter to the sofa"
    mission = Mission(world, parse(text), Settings(gain_norm=norm, cs_a=0.0))
    mission.tools.base.look_around()
    (thing,) = world.objects("counter")
    return mission, thing


def test_the_extra_view_is_the_one_that_would_raise_the_score_most() -> None:
    world, looking, thing = seen_counter()
    n = min(len(looking.views_of(thing)), Settings().most_gaze_points)
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
        found = looking.information_gain(thing, "counter")
        assert found is not None
        assert found.nats == gain


def test_the_best_view_is_asked_for_again_when_other_views_are_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As many views as before, at other places."""
    world, looking, thing = seen_counter()
    here = looking.views_of(thing)[:1]
    there = [replace(here[0], pose=replace(here[0].pose, x_m=here[0].pose.x_m + 0.5))]
    scores = iter([0.3, 0.6])
    world.what_if = lambda *args, **kwargs: WhatIf((next(scores),), ())
    for points, score in ((here, 0.3), (here, 0.3), (there, 0.6)):
        monkeypatch.setattr(looking, "views_of", lambda _, points=points: points)
        best = looking.best_view(thing, "counter")
        assert best is not None
        assert (best.gaze, best.score) == (points[0], score)


@pytest.mark.parametrize(
    ("norm", "expected"),
    [("sum", 60.0), ("per_gaussian", 0.3), ("per_area", 120.0), ("per_pixel", 0.2)],
)
def test_the_objective_gets_the_gain_by_its_norm_and_keeps_what_it_was_computed_from(
    norm: GainNorm, expected: float
) -> None:
    mission, thing = searched_counter(norm)
    world = cast(FakeWorld, mission.tools.robot)
    world.what_if = lambda *args, **kwargs: WhatIf((), (60.0,), (300.0,), 0.5)
    search = cast(ObjectSearch, mission.agent.seek_object(mission.tools, "mug", "counter"))
    (option,) = search._receptacle_options()
    assert option.information_gain == pytest.approx(expected)
    assert option.gain == Gain(60.0, thing.gaussians, 0.5, 300.0)
    assert search.seen.first_seen[thing.id].gain == option.gain
    assert search.seen.first_seen[thing.id].information_gain == pytest.approx(expected)


def test_a_task_that_needs_the_area_fails_with_an_object_map_that_does_not_report_it() -> None:
    mission, _ = searched_counter("per_area")
    world = cast(FakeWorld, mission.tools.robot)
    world.what_if = lambda *args, **kwargs: WhatIf((), (60.0,))
    search = cast(ObjectSearch, mission.agent.seek_object(mission.tools, "mug", "counter"))
    with pytest.raises(TaskFailed, match="without its area") as failure:
        search._receptacle_options()
    assert failure.value.cause is Cause.SYSTEM_ERROR


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
    assert looking.information_gain(thing, "counter")
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
