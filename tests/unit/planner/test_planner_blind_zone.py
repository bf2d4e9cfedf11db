"""The near blind zone: the robot drives over floor that its camera cannot see, up to a limit."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from helios_core.types import RobotDescription
from helios_planner.motion_planning.costmap import SEEN_M, BlindZone, Pose2, blind_m
from helios_planner.navigation.base_controller import BaseController, Outcome, base_controller_for
from helios_planner.navigation.motion_monitor import MOST_WEDGED
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from planner_eye import ROBOT
from planner_flat import flat
from planner_things import Box
from planner_world import FakeWorld
from test_planner_lattice import BoxWorld

START = Pose2(2.0, 3.0, 0.0)
LEVEL = replace(ROBOT, camera_height_m=0.5, tilt_range_rad=(0.0, 0.0))  # blind for 1.15 m
TALL = replace(LEVEL, camera_height_m=1.3)  # blind for 3.0 m


def blind_base(world: FakeWorld, robot: RobotDescription = LEVEL) -> BaseController:
    world.description = robot
    world._known[:] = False  # forget what was seen while the camera could tilt
    world.look()
    base = base_controller_for(world, Settings())
    base.look_around()
    return base


def test_a_robot_that_does_not_see_the_floor_at_its_feet_drives() -> None:
    world = flat(start=START)
    base = blind_base(world)
    assert base.go_to(Pose2(3.9, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert world.contacts == 0
    assert base.monitor.wedged == 0


def test_a_box_shaped_robot_drives_over_its_blind_zone_too() -> None:
    world = BoxWorld((7, 4), [], [], Pose2(2.5, 2.0, 0.4))
    box = replace(BoxWorld.description, camera_height_m=0.6, tilt_range_rad=(0.0, 0.0))
    base = blind_base(world, box)
    assert base.go_to(Pose2(4.5, 2.0, 0.0), "test") is Outcome.ARRIVED
    assert world.contacts == 0
    assert base.blind_zone.discs == [(2.5, 2.0, pytest.approx(blind_m(box) + SEEN_M))]


def test_an_obstacle_seen_in_the_blind_zone_blocks_the_path() -> None:
    wall = Box(2.6, 2.0, 2.8, 4.0, 0.8)
    world = flat(start=START, extra=[wall])
    base = blind_base(world)
    world._known[80:160, 104:112] = True  # the wall is higher than the line of sight
    assert base.go_to(Pose2(3.9, 3.0, 0.0), "test") is Outcome.ARRIVED  # around it
    assert world.contacts == 0


def test_an_obstacle_felt_in_the_blind_zone_blocks_the_path() -> None:
    low = Box(2.6, 2.7, 2.8, 3.3, 0.1, hidden=True)
    world = flat(start=START, extra=[low])
    base = blind_base(world)
    assert base.go_to(Pose2(3.9, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert 1 <= world.contacts <= 4
    assert base.felt_obstacles


def test_a_blind_zone_wider_than_allowed_fails_the_task_with_the_reason() -> None:
    world = flat(start=START)
    base = blind_base(world, TALL)
    with pytest.raises(TaskFailed, match=r"sees the floor only from 3\.0 m on.*BLIND_M") as failure:
        base.go_to(Pose2(3.9, 3.0, 0.0), "test")
    assert failure.value.cause is Cause.STUCK
    assert base.monitor.wedged == MOST_WEDGED + 1
    assert world.pose().xy == START.xy
    assert base.blind_zone.discs == []


def test_a_robot_without_a_blind_zone_trusts_no_unknown_ground() -> None:
    base = BaseController(flat(start=START), Settings())
    assert base.blind_zone.width_m == 0
    assert not base.blind_zone.trust(START)
    assert base.blind_zone.too_wide() == ""


def test_overlapping_blind_zones_open_no_path_through_unknown_ground() -> None:
    ring = BlindZone(LEVEL, 0.3, 1.5)
    radius_m = blind_m(LEVEL) + SEEN_M
    assert ring.trust(Pose2(0.0, 0.0, 0.0))
    assert not ring.trust(Pose2(radius_m - 0.01, 0.0, 0.0))
    assert ring.trust(Pose2(radius_m + 0.01, 0.0, 0.0))
    assert len(ring.discs) == 2


@pytest.mark.parametrize(
    ("height_m", "tilt_rad", "forward_m", "wanted_m"),
    [
        (1.0, math.pi / 4 - LEVEL.camera.vfov_rad / 2, 0.0, 1.0),
        (1.0, math.pi / 4 - LEVEL.camera.vfov_rad / 2, 0.2, 1.2),
        (1.0, math.pi / 2, 0.0, 0.0),
        (1.0, -1.0, 0.0, math.inf),
    ],
)
def test_the_camera_is_blind_up_to_where_the_images_lower_edge_meets_the_floor(
    height_m: float, tilt_rad: float, forward_m: float, wanted_m: float
) -> None:
    robot = replace(
        ROBOT, camera_height_m=height_m, tilt_range_rad=(-1.5, tilt_rad), camera_forward_m=forward_m
    )
    assert blind_m(robot) == pytest.approx(wanted_m)
