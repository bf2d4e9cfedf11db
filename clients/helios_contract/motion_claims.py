"""Contract tests of the robot's actions."""

from __future__ import annotations

import uuid

import numpy as np
import pytest
from helios_core.geometry import invert, project, wrap_angle, yaw_of
from helios_core.robot import Action, Capture, Forward, Observe, Pick, Place, Show, Tilt, Turn

from helios_contract.rig import Rig, seen_points

FAR_AWAY_M = (60.0, 60.0, 0.8)
LEAST_AGREEING = 0.7  # share of the common points; edges appear and disappear
LEAST_SHARED = 200  # points


class MotionClaims:
    """Contract tests of `act`. A robot that cannot move must report it."""

    def test_a_positive_turn_goes_left_by_that_angle(self, rig: Rig) -> None:
        rig.need_motion()
        before = rig.pose()
        result = rig.act(Turn(rig.turn_rad))
        assert result.succeeded, result.reason
        turned_rad = wrap_angle(yaw_of(rig.pose()) - yaw_of(before))
        assert turned_rad == pytest.approx(rig.turn_rad, abs=rig.tolerance_rad)
        assert result.turned_rad == pytest.approx(turned_rad, abs=rig.tolerance_rad)
        assert np.linalg.norm((rig.pose() - before)[:2, 3]) <= rig.tolerance_m
        back = rig.act(Turn(-rig.turn_rad))
        assert wrap_angle(yaw_of(rig.pose()) - yaw_of(before)) == pytest.approx(
            0.0, abs=2 * rig.tolerance_rad
        ), back.reason

    def test_a_drive_goes_along_the_heading_by_that_distance(self, rig: Rig) -> None:
        rig.need_motion()
        before = rig.pose()
        result = rig.act(Forward(rig.forward_m))
        assert result.succeeded, result.reason
        x_m, y_m = (invert(before) @ rig.pose())[:2, 3]
        assert x_m == pytest.approx(rig.forward_m, abs=rig.tolerance_m)
        assert y_m == pytest.approx(0.0, abs=rig.tolerance_m)
        assert result.moved_m == pytest.approx(x_m, abs=rig.tolerance_m)

    def test_a_move_back_goes_straight_back_by_that_distance(self, rig: Rig) -> None:
        rig.need_motion()
        if rig.robot.max_back_m == 0.0:
            pytest.skip("this robot cannot move back")
        rig.act(Forward(rig.forward_m))
        before, back_m = rig.pose(), min(rig.forward_m, rig.robot.max_back_m)
        result = rig.act(Forward(-back_m))
        assert result.succeeded, result.reason
        x_m, y_m = (invert(before) @ rig.pose())[:2, 3]
        assert x_m == pytest.approx(-back_m, abs=rig.tolerance_m)
        assert y_m == pytest.approx(0.0, abs=rig.tolerance_m)
        assert result.moved_m == pytest.approx(back_m, abs=rig.tolerance_m)  # never negative

    def test_a_robot_that_cannot_move_back_says_so_and_stays(self, rig: Rig) -> None:
        rig.need_motion()
        if rig.robot.max_back_m > 0.0:
            pytest.skip("this robot moves back")
        before = rig.pose()
        _failed_with_a_sentence(rig, Forward(-rig.forward_m))
        np.testing.assert_allclose(rig.pose(), before, atol=rig.tolerance_m / 5)

    def test_tilting_moves_the_camera_and_nothing_else(self, rig: Rig) -> None:
        rig.need_motion()
        low, high = rig.robot.tilt_range_rad
        if high - low < 0.1:
            pytest.skip("this camera does not tilt")
        before = rig.pose()
        for tilt_rad in (low + 0.6 * (high - low), low + 0.4 * (high - low)):
            result = rig.act(Tilt(tilt_rad))
            assert result.succeeded, result.reason
            assert rig.driver.state().tilt_rad == pytest.approx(tilt_rad, abs=rig.tolerance_rad)
            axis = rig.driver.capture().T_world_cam[:3, 2]
            assert -axis[2] == pytest.approx(np.sin(tilt_rad), abs=rig.tolerance_rad)
        np.testing.assert_allclose(rig.pose(), before, atol=rig.tolerance_m)

    def test_observing_moves_nothing(self, rig: Rig) -> None:
        before = rig.driver.state()
        result = rig.act(Observe())
        assert result.succeeded, result.reason
        now = rig.driver.state()
        np.testing.assert_allclose(now.T_world_base, before.T_world_base, atol=rig.tolerance_m)
        assert now.held == before.held

    def test_what_was_seen_is_still_there_after_a_move(self, rig: Rig) -> None:
        """Check poses, intrinsics, depth and directions together: one error shifts the points."""
        moves: tuple[Action, ...] = (Observe(),)
        if rig.robot.can_move:
            moves = (Turn(rig.turn_rad / 2), Forward(rig.forward_m / 2), Turn(-rig.turn_rad / 2))
        before = rig.driver.capture()
        for move in moves:
            result = rig.act(move)
            assert result.succeeded, result.reason
            now = rig.driver.capture()
            assert _agreeing(before, now, rig) >= LEAST_AGREEING, f"after {move}"
            before = now

    def test_the_same_action_is_done_once(self, rig: Rig) -> None:
        action, id = Turn(rig.turn_rad) if rig.robot.can_move else Observe(), uuid.uuid4().hex
        first = rig.driver.act(action, id)
        there = rig.pose()
        assert rig.driver.act(action, id) == first
        np.testing.assert_allclose(rig.pose(), there, atol=rig.tolerance_m / 5)
        if rig.robot.can_move:
            rig.act(Turn(-rig.turn_rad))

    def test_every_action_is_counted(self, rig: Rig) -> None:
        steps = [rig.act(Observe()).steps for _ in range(3)]
        assert steps[0] < steps[1] < steps[2]

    def test_a_robot_that_cannot_move_says_so_and_stays(self, rig: Rig) -> None:
        if rig.robot.can_move:
            pytest.skip("this robot moves")
        before = rig.pose()
        for action in (Forward(rig.forward_m), Turn(rig.turn_rad)):
            _failed_with_a_sentence(rig, action)
        np.testing.assert_array_equal(rig.pose(), before)

    def test_a_thing_out_of_reach_is_not_picked_and_the_reason_said(self, rig: Rig) -> None:
        _failed_with_a_sentence(rig, Pick(FAR_AWAY_M, "mug"))
        assert rig.driver.state().held == ""

    def test_with_an_empty_hand_nothing_is_placed_and_the_reason_said(self, rig: Rig) -> None:
        _failed_with_a_sentence(rig, Place(FAR_AWAY_M))

    def test_with_an_empty_hand_nothing_is_shown_and_the_reason_said(self, rig: Rig) -> None:
        if rig.robot.show_base_m is not None:
            _failed_with_a_sentence(rig, Show(0.0))

    def test_a_failed_action_keeps_no_later_one_from_its_work(self, rig: Rig) -> None:
        _failed_with_a_sentence(rig, Pick(FAR_AWAY_M, "mug"))
        assert rig.act(Observe()).succeeded


def _failed_with_a_sentence(rig: Rig, action: Action) -> None:
    result = rig.act(action)
    assert not result.succeeded
    assert len(result.reason.split()) >= 2, f"{result.reason!r} is no sentence"


def _agreeing(before: Capture, now: Capture, rig: Rig) -> float:
    """Share of the common points of two images at which the second has the expected depth."""
    points_m = seen_points(before, rig.robot.max_depth_m)
    uv, depth_m = project(points_m, now.camera, now.T_world_cam)
    column, row = np.rint(uv).astype(int).T
    inside = (
        (depth_m > 0.1)
        & (column >= 0)
        & (column < now.camera.width)
        & (row >= 0)
        & (row < now.camera.height)
    )
    seen_m = now.depth_m[row[inside], column[inside]]
    wanted_m = depth_m[inside][seen_m > 0]
    seen_m = seen_m[seen_m > 0]
    assert seen_m.size >= LEAST_SHARED, "the two images share too little; is there room to move?"
    tolerance_m = rig.depth_tolerance_m * np.maximum(wanted_m / 2.0, 1.0)
    return float((np.abs(seen_m - wanted_m) <= tolerance_m).mean())
