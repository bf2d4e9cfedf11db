"""Stuck and wedged robots, and localisation jumps: the base recovers, or fails at a limit."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import Action, ActionResult, Forward, Turn
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import BaseController, Outcome
from helios_planner.navigation.motion_monitor import MOST_BLOCKS, MOST_JUMPS, MOST_WEDGED
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from planner_eye import ROBOT
from planner_flat import coffee_table, counter, flat, mug
from planner_things import Box
from planner_trouble import Trouble, bring, legs_in, troubled
from planner_world import FakeWorld


@pytest.mark.parametrize("kind", [Forward, Turn])
def test_a_robot_that_does_not_move_on_command_is_stuck(kind: type[Action]) -> None:
    world = troubled(
        flat([coffee_table(), counter(), mug()]),
        lambda _, action: ActionResult(False, "no") if isinstance(action, kind) else None,
    )
    with pytest.raises(TaskFailed) as failure:
        bring(world)
    assert failure.value.cause is Cause.STUCK
    assert re.search(f"{MOST_BLOCKS + 1} times|wedged", failure.value.message)
    assert sum(isinstance(a, kind) for a in world.log) <= MOST_BLOCKS + 1


def test_a_wedged_robot_looks_around_and_then_fails_the_task() -> None:
    cell = [
        Box(1.0, 1.0, 2.0, 1.15, 1),
        Box(1.0, 1.85, 2.0, 2.0, 1),
        Box(1.0, 1.0, 1.15, 2.0, 1),
        Box(1.85, 1.0, 2.0, 2.0, 1),
    ]
    world = flat(start=Pose2(1.5, 1.5, 0.0), extra=cell)
    base = legs_in(world)
    before = len(world.log)
    with pytest.raises(TaskFailed, match=r"wedged at \(1.50, 1.50\)") as failure:
        base.go_to(Pose2(3.0, 3.0, 0.0), "test")
    assert failure.value.cause is Cause.STUCK
    assert base.monitor.wedged == MOST_WEDGED + 1
    turned = sum(abs(a.angle_rad) for a in world.log[before:] if isinstance(a, Turn))
    assert turned >= MOST_WEDGED * 2 * math.pi - 0.01


def test_felt_obstacles_that_are_gone_do_not_wedge_the_robot_for_ever() -> None:
    base = legs_in(flat(start=Pose2(2.0, 2.0, 0.0)))
    ring = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    for a in ring:
        base.felt_obstacles.append((2.0 + 0.42 * math.cos(a), 2.0 + 0.42 * math.sin(a), 0.08))
    assert base.go_to(Pose2(3.0, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert base.monitor.wedged == 1


def lane(max_back_m: float) -> BaseController:
    """Return the base of a robot in a lane in which it just fits, 0.4 m from the entrance."""
    walls = [Box(1.6, 2.0, 3.2, 2.7, 1.0), Box(1.6, 3.325, 3.2, 4.0, 1.0)]
    world = flat(start=Pose2(2.0, 3.0125, 0.0), extra=walls)
    world.description = replace(ROBOT, max_back_m=max_back_m)
    return legs_in(world)


def test_a_wedged_robot_backs_out_of_a_lane_if_it_can_move_back() -> None:
    base = lane(0.3)
    assert base.go_to(Pose2(0.8, 3.0, 3.1), "test") is Outcome.ARRIVED
    assert isinstance(base.robot, FakeWorld)
    back = [a.distance_m for a in base.robot.log if isinstance(a, Forward) and a.distance_m < 0]
    assert 1 <= len(back) <= MOST_WEDGED
    assert min(back) >= -0.3
    assert base.robot.contacts == 0


def test_a_robot_that_cannot_move_back_gets_no_command_to_do_so() -> None:
    base = lane(0.0)
    with pytest.raises(TaskFailed, match="wedged"):
        base.go_to(Pose2(0.8, 3.0, 3.1), "test")
    assert isinstance(base.robot, FakeWorld)
    assert not any(isinstance(a, Forward) for a in base.robot.log)


@pytest.mark.parametrize(("behind_m", "free_m"), [(0.9, 0.3), (0.52, 0.2), (0.36, 0.0)])
def test_a_backward_move_ends_before_an_obstacle(behind_m: float, free_m: float) -> None:
    """`behind_m`: from the robot's centre to the near edge of a box; its rim is at 0.3 m."""
    box = Box(3.0 - behind_m - 0.5, 2.5, 3.0 - behind_m, 3.5, 1.0)
    base = legs_in(flat(start=Pose2(3.0, 3.0, 0.0), extra=[box]))
    assert base.reach(base.levels[-1]).free_back_m(0.3, base.rules) == pytest.approx(
        free_m, abs=0.03
    )


def jumping(times: int) -> Trouble:
    left = [times]

    def trouble(world: FakeWorld, action: Action) -> None:
        if isinstance(action, Forward) and left[0]:
            left[0] -= 1
            pose = world.pose()
            world._pose = Pose2(pose.x_m, 4.5 - pose.y_m, pose.yaw_rad)

    return trouble


def test_the_robot_looks_around_after_a_localisation_jump_and_continues() -> None:
    world = flat(start=Pose2(1.0, 1.2, 0.0))
    base = legs_in(world)
    troubled(world, jumping(1))
    base.felt_obstacles.append((6.0, 1.0, 0.08))
    before = len(world.log)
    assert base.go_to(Pose2(3.5, 1.5, 0.0), "test") is Outcome.ARRIVED
    assert base.monitor.jumps == 1
    assert not base.monitor.jumped
    assert base.felt_obstacles == []  # their positions are no longer valid
    turned = sum(abs(a.angle_rad) for a in world.log[before:] if isinstance(a, Turn))
    assert turned >= 2 * math.pi - 0.01


def test_a_jump_of_the_heading_alone_is_detected() -> None:
    world = flat(start=Pose2(1.0, 1.2, 0.0))

    def turned(world: FakeWorld, action: Action) -> None:
        if isinstance(action, Forward):
            pose = world.pose()
            world._pose = Pose2(pose.x_m, pose.y_m, pose.yaw_rad + 1.0)

    monitor = BaseController(troubled(world, turned), Settings()).monitor
    monitor.act(Forward(0.2))
    assert monitor.jumped


def test_repeated_localisation_jumps_fail_the_task() -> None:
    world = flat(start=Pose2(1.0, 1.2, 0.0))
    base = legs_in(world)
    troubled(world, jumping(99))
    with pytest.raises(TaskFailed, match="localisation jumped") as failure:
        base.go_to(Pose2(3.5, 1.5, 0.0), "test")
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert base.monitor.jumps == MOST_JUMPS + 1
