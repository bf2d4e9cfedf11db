"""The check after placing: observed objects count, not the robot's report."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
import pytest
from helios_core.errors import Unavailable
from helios_core.robot import Action, ActionResult, Place
from helios_core.types import ObjectInstance
from helios_planner.instruction.parser import parse
from helios_planner.manipulation import PlacementCheck, seen_after
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed, TimeIsUp
from helios_planner.tasks.mission import Mission
from planner_flat import MOVE, coffee_table, counter, flat, mug


def instance(
    name: str,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    class_score: float = 0.57,
) -> ObjectInstance:
    return ObjectInstance(
        id=1, class_name=name, center_m=np.array(center), size_m=np.array(size), score=0.4,
        class_score=class_score, uncertainty=0.17, views=1, gaussians=50, probabilities={},
        top_m=center[2] + size[2] / 2, outline_m=np.empty((0, 2)),
    )  # fmt: skip


COUNTER = instance("counter", (2.0, 2.0, 0.85), (2.0, 0.6, 0.1))
SIZE = (0.08, 0.08, 0.1)
ON, BESIDE, FAR = (2.5, 2.1, 0.95), (2.5, 1.5, 0.05), (7.0, 7.0, 0.05)
HIGH_BESIDE = (2.0, 3.2, 0.95)


@pytest.mark.parametrize(
    ("before", "now", "seen"),
    [
        ([], [ON], PlacementCheck.ON_IT),
        ([], [BESIDE], PlacementCheck.BESIDE_IT),
        ([], [BESIDE, ON], PlacementCheck.ON_IT),  # another one lies there
        ([], [HIGH_BESIDE], PlacementCheck.NOWHERE),  # the counter may be longer than is known
        ([], [FAR], PlacementCheck.NOWHERE),
        ([], [], PlacementCheck.NOWHERE),
        ([BESIDE], [BESIDE], PlacementCheck.NOWHERE),  # it was there before
        ([ON], [ON], PlacementCheck.NOWHERE),
    ],
)
def test_only_an_object_that_was_not_there_before_counts_as_placed(
    before: list[tuple[float, float, float]],
    now: list[tuple[float, float, float]],
    seen: PlacementCheck,
) -> None:
    was, is_now = ([instance("mug", p, SIZE) for p in points] for points in (before, now))
    got, found = seen_after(COUNTER, was, is_now, 0.3, COUNTER.top_m)
    assert got is seen
    assert (found is None) == (seen is PlacementCheck.NOWHERE)


def test_an_instance_of_low_class_score_does_not_count_as_placed() -> None:
    doubtful = [instance("mug", BESIDE, SIZE, class_score=0.2)]
    assert seen_after(COUNTER, [], doubtful, 0.3, COUNTER.top_m) == (PlacementCheck.NOWHERE, None)


def mission(rolls: bool = False, blind: bool = False) -> Mission:
    """Make a mission whose mug rolls off, or is not seen, once it is placed."""
    world = flat([coffee_table(), counter(), mug()])
    place = world._do

    def roll(action: Action) -> ActionResult:
        result = place(action)
        if blind and isinstance(action, Place):
            objects = world.objects
            world.objects = lambda class_name: [] if class_name == "mug" else objects(class_name)
        if rolls and isinstance(action, Place):
            assert world.released is not None
            at = world.pose()
            ahead = 0.45 * np.array([np.cos(at.yaw_rad), np.sin(at.yaw_rad)])
            world.released.center_m = np.array([*(ahead + at.xy), 0.05])
        return result

    world._do = roll
    text = "Move the mug from the coffee table to the counter"
    return Mission(world, parse(text), Settings())


def test_an_object_that_is_seen_on_the_goal_is_reported() -> None:
    whole = mission()
    assert whole.seen_at_goal is None
    assert whole.run() == "put the mug on the counter; it is seen there"
    assert whole.seen_at_goal is True


def test_an_object_that_is_not_seen_after_placing_is_reported_as_such() -> None:
    whole = mission(blind=True)
    assert whole.run() == "put the mug on the counter; it was not seen there yet"
    assert whole.seen_at_goal is False


def test_a_task_that_fails_before_the_check_still_records_that_it_placed_the_object(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def away(*_: object) -> NoReturn:
        raise Unavailable("the object map is away")

    whole = mission()
    monkeypatch.setattr("helios_planner.tasks.mission.look_after", away)
    with pytest.raises(Unavailable):
        whole.run()
    assert whole.seen_at_goal is False


@pytest.mark.parametrize("query", ["pose", "objects"])
def test_a_time_limit_that_passes_after_the_placing_does_not_fail_the_task(query: str) -> None:
    """`pose` is the first query after the placing, `objects` that of the check."""
    world = flat([coffee_table(), counter(), mug()])
    answer = getattr(world, query)

    def until_placed(*names: str) -> object:
        if world.released is not None:
            raise TimeIsUp("the task's 60 s are used up")
        return answer(*names)

    setattr(world, query, until_placed)
    whole = Mission(world, parse(MOVE), Settings())
    assert whole.run() == "put the mug on the counter; it was not seen there yet"
    assert whole.seen_at_goal is False


def test_a_time_limit_that_passes_before_the_placing_fails_the_task() -> None:
    world = flat([coffee_table(), counter(), mug()])
    act = world.act

    def until_held(action: Action) -> ActionResult:
        if world.held():
            raise TimeIsUp("the task's 60 s are used up")
        return act(action)

    world.act = until_held
    with pytest.raises(TimeIsUp):
        Mission(world, parse(MOVE), Settings()).run()


def test_an_object_that_rolled_off_is_a_failure_though_the_robot_reports_success() -> None:
    whole = mission(rolls=True)
    with pytest.raises(TaskFailed) as failure:
        whole.run()
    assert whole.seen_at_goal is False
    assert failure.value.cause is Cause.ROLLED_OFF
    assert "is seen beside it" in failure.value.message
