"""Contract tests of the robot's description."""

from __future__ import annotations

import math

import pytest
from helios_core.codec import description_from_proto, description_to_proto
from helios_core.errors import Unavailable

from helios_contract.rig import Rig


class DescriptionClaims:
    """Contract tests of `describe`."""

    def test_the_description_stays_the_same(self, rig: Rig) -> None:
        assert rig.driver.describe() == rig.driver.describe()

    def test_the_description_crosses_the_wire_unchanged(self, rig: Rig) -> None:
        assert description_from_proto(description_to_proto(rig.robot)) == rig.robot

    def test_the_robot_has_a_name(self, rig: Rig) -> None:
        assert rig.robot.name.strip()

    def test_lengths_are_metres(self, rig: Rig) -> None:
        robot = rig.robot
        assert 0.05 <= robot.footprint_radius_m <= 1.5
        assert 0.1 <= robot.height_m <= 3.0
        assert 0.05 <= robot.camera_height_m <= 3.0
        assert abs(robot.camera_forward_m) <= 1.5
        assert 0.5 <= robot.max_depth_m <= 50.0
        assert 0.0 <= robot.reach_m <= 2.0

    def test_angles_are_radians(self, rig: Rig) -> None:
        robot = rig.robot
        assert 0.0 < robot.min_turn_rad <= robot.max_turn_rad <= math.pi
        low, high = robot.tilt_range_rad
        assert -math.pi / 2 <= low <= high <= math.pi / 2

    def test_the_least_drive_is_no_longer_than_the_longest(self, rig: Rig) -> None:
        assert 0.0 < rig.robot.min_forward_m <= rig.robot.max_forward_m <= 10.0

    def test_a_robot_that_can_move_back_can_do_so_by_the_least_drive(self, rig: Rig) -> None:
        back_m = rig.robot.max_back_m
        assert back_m == 0.0 or rig.robot.min_forward_m <= back_m <= 2.0

    def test_a_robot_that_can_pick_can_reach(self, rig: Rig) -> None:
        robot = rig.robot
        assert robot.reach_m > 0.0 or not (robot.can_pick or robot.can_place)

    def test_a_held_object_is_shown_where_the_camera_can_see_it(self, rig: Rig) -> None:
        robot = rig.robot
        if robot.show_base_m is None:
            return
        assert robot.can_pick
        x, y, z = robot.show_base_m
        ahead_m, down_m = x - robot.camera_forward_m, robot.camera_height_m - z
        assert 0.1 <= ahead_m <= 2.0
        assert abs(math.atan2(y, ahead_m)) < robot.camera.hfov_rad / 2
        low, high = robot.tilt_range_rad
        half = robot.camera.vfov_rad / 2
        assert low - half < math.atan2(down_m, ahead_m) < high + half

    def test_the_camera_sees_between_20_and_150_degrees(self, rig: Rig) -> None:
        camera = rig.robot.camera
        assert 20.0 <= math.degrees(camera.hfov_rad) <= 150.0
        assert 15.0 <= math.degrees(camera.vfov_rad) <= 150.0
        assert 0.25 <= camera.cx / camera.width <= 0.75
        assert 0.25 <= camera.cy / camera.height <= 0.75

    def test_a_robot_out_of_reach_is_unavailable_and_comes_back(self, rig: Rig) -> None:
        if rig.away is None:
            pytest.skip("this robot lives within its driver")
        with rig.away():
            for ask in (rig.driver.state, rig.driver.capture):
                with pytest.raises(Unavailable):
                    ask()
        assert rig.when_back().color.size
