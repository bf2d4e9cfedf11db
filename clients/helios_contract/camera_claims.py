"""Contract tests of the camera image and its pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_bridge.capture_checks import check_capture
from helios_core.geometry import invert, tilt_of
from helios_core.robot import Capture, Observe

from helios_contract.rig import Rig, seen_points

LEAST_VALID = 0.05  # share of the pixels
FLOOR_TOLERANCE_M = 0.15
BELOW_FLOOR = 0.02  # share of the points, for mirrors and noise
MOUNT_TOLERANCE_M = 0.25


class CameraClaims:
    """Contract tests of `capture` and `state`."""

    def test_an_image_has_the_type_and_size_that_its_calibration_says(self, rig: Rig) -> None:
        check_capture(rig.driver.capture())

    def test_the_calibration_is_the_one_described(self, rig: Rig) -> None:
        seen, described = rig.driver.capture().camera, rig.robot.camera
        assert (seen.width, seen.height) == (described.width, described.height)
        assert seen.fx == pytest.approx(described.fx, rel=0.02)
        assert seen.fy == pytest.approx(described.fy, rel=0.02)

    def test_depth_is_metres_with_0_where_there_is_none(self, rig: Rig) -> None:
        depth_m = rig.driver.capture().depth_m
        assert np.isfinite(depth_m).all(), "invalid depth is 0, not NaN"
        assert (depth_m >= 0).all()
        valid_m = depth_m[depth_m > 0]
        assert valid_m.size >= LEAST_VALID * depth_m.size, "hardly a pixel has depth"
        assert 0.1 <= np.median(valid_m) <= rig.robot.max_depth_m, "are these metres?"

    def test_the_picture_is_no_single_colour(self, rig: Rig) -> None:
        assert rig.driver.capture().color.std() > 1.0

    def test_an_image_stays_as_it_was_given(self, rig: Rig) -> None:
        first = rig.driver.capture()
        kept = [np.copy(a) for a in _arrays(first)]
        rig.act(Observe())
        rig.driver.capture()
        for before, now in zip(kept, _arrays(first), strict=True):
            np.testing.assert_array_equal(before, now)

    def test_later_images_have_later_stamps(self, rig: Rig) -> None:
        stamps_ns = []
        for _ in range(3):
            rig.act(Observe())
            stamps_ns.append(rig.driver.capture().stamp_ns)
        assert all(isinstance(stamp_ns, int) for stamp_ns in stamps_ns)
        assert stamps_ns[0] < stamps_ns[1] < stamps_ns[2]

    def test_the_base_stands_upright_on_the_floor(self, rig: Rig) -> None:
        T_world_base = rig.driver.capture().T_world_base
        assert T_world_base[2, 2] > math.cos(0.1), "the base's z axis points up"
        assert abs(T_world_base[2, 3]) <= FLOOR_TOLERANCE_M, "the base's origin is on the floor"

    def test_the_camera_is_mounted_where_the_description_says(self, rig: Rig) -> None:
        rig.act(Observe())  # a robot may stand up for its first action
        x_m, y_m, z_m = _T_base_cam(rig.driver.capture())[:3, 3]
        assert z_m == pytest.approx(rig.robot.camera_height_m, abs=MOUNT_TOLERANCE_M)
        assert x_m == pytest.approx(rig.robot.camera_forward_m, abs=MOUNT_TOLERANCE_M)
        assert abs(y_m) <= MOUNT_TOLERANCE_M

    def test_the_camera_looks_ahead_the_right_way_up(self, rig: Rig) -> None:
        R = _T_base_cam(rig.driver.capture())[:3, :3]
        assert R[1, 0] < -0.7, "the camera's x axis points to the robot's right"
        assert R[2, 1] < 0.0, "the camera's y axis points down"
        assert R[0, 2] > 0.0 or R[2, 2] < -0.9, "the camera's z axis points ahead"

    def test_the_tilt_that_is_told_is_the_cameras(self, rig: Rig) -> None:
        rig.act(Observe())
        capture = rig.driver.capture()
        tilt_rad = tilt_of(capture.T_world_cam)
        assert rig.driver.state().tilt_rad == pytest.approx(tilt_rad, abs=0.1)

    def test_the_image_was_taken_where_the_robot_says_it_is(self, rig: Rig) -> None:
        capture = rig.driver.capture()
        np.testing.assert_allclose(rig.pose(), capture.T_world_base, atol=rig.tolerance_m)

    def test_nothing_is_seen_below_the_floor(self, rig: Rig) -> None:
        points_m = seen_points(rig.driver.capture(), rig.robot.max_depth_m)
        below = points_m[:, 2] < -FLOOR_TOLERANCE_M
        assert below.mean() <= BELOW_FLOOR, "units, intrinsics, or the camera's height or tilt"

    def test_the_robot_sees_nothing_within_its_own_footprint(self, rig: Rig) -> None:
        robot, capture = rig.robot, rig.driver.capture()
        if not (robot.can_move or robot.recorded):
            pytest.skip("a carried camera has no body")
        points_m = seen_points(capture, robot.max_depth_m)
        gap_m = np.linalg.norm(points_m[:, :2] - capture.T_world_base[:2, 3], axis=1)
        high = (points_m[:, 2] > 0.1) & (points_m[:, 2] < robot.height_m)
        assert (high & (gap_m < 0.9 * robot.footprint_radius_m)).mean() <= 0.002

    def test_the_state_names_one_world(self, rig: Rig) -> None:
        first, second = rig.driver.state(), rig.driver.state()
        assert (first.robot_boot_id, first.world_epoch) == (
            second.robot_boot_id,
            second.world_epoch,
        )


def _arrays(capture: Capture) -> tuple[np.ndarray, ...]:
    return capture.color, capture.depth_m, capture.T_world_cam, capture.T_world_base


def _T_base_cam(capture: Capture) -> np.ndarray:
    return invert(capture.T_world_base) @ capture.T_world_cam
