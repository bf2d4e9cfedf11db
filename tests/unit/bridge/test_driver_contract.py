"""The contract suite finds faults: each common driver mistake fails the claim about it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_contract.rig import Rig
from helios_contract.suite import DriverContract
from helios_core.errors import HeliosError
from helios_core.geometry import R_BODY_CAM, se2_to_se3
from helios_core.robot import ActionResult, Capture, Forward, Show, Turn
from helios_core.types import RobotDescription, RobotState
from helios_examples.room_robot import ROBOT, RoomRobot


class Described(RoomRobot):
    """Gives a wrong description of itself."""

    def __init__(self, **wrong: Any) -> None:
        super().__init__()
        self._wrong = wrong

    def describe(self) -> RobotDescription:
        return replace(ROBOT, **self._wrong)


class Seeing(RoomRobot):
    """Applies `slip` to every image."""

    def __init__(self, slip: Callable[[Capture], Capture]) -> None:
        super().__init__()
        self._slip = slip

    def capture(self) -> Capture:
        return self._slip(super().capture())


def along_the_ray(c: Capture) -> Capture:
    """Depth as the length of the ray, not along the optical axis."""
    v, u = np.mgrid[0 : c.camera.height, 0 : c.camera.width]
    x, y = (u - c.camera.cx) / c.camera.fx, (v - c.camera.cy) / c.camera.fy
    return replace(c, depth_m=(c.depth_m * np.sqrt(1 + x**2 + y**2)).astype(np.float32))


def turned_camera(c: Capture) -> Capture:
    """A camera pose with x forward and z up, as ROS' camera_link has it."""
    T = c.T_world_cam.copy()
    T[:3, :3] = T[:3, :3] @ R_BODY_CAM.T
    return replace(c, T_world_cam=T)


class RightIsPositive(RoomRobot):
    def _do(self, action) -> str:
        return super()._do(Turn(-action.angle_rad) if isinstance(action, Turn) else action)


class Degrees(RoomRobot):
    def _do(self, action) -> str:
        return super()._do(
            Turn(math.radians(action.angle_rad)) if isinstance(action, Turn) else action
        )


class Sideways(RoomRobot):
    """Drives along the world's y axis whatever its heading."""

    def _do(self, action) -> str:
        if isinstance(action, Forward):
            self._y_m += action.distance_m
            return ""
        return super()._do(action)


class Reversing(RoomRobot):
    """Drives back although its description does not allow it."""

    def _do(self, action) -> str:
        if isinstance(action, Forward):
            return self._move(action.distance_m, 0.0)
        return super()._do(action)


class AsAsked(RoomRobot):
    """Reports the requested distance and drives half of it."""

    def _do(self, action) -> str:
        return super()._do(
            Forward(action.distance_m / 2) if isinstance(action, Forward) else action
        )


class Forgetful(RoomRobot):
    def act(self, action, action_id: str) -> ActionResult:
        return super().act(action, f"{action_id} {time.monotonic_ns()}")


class Deaf(RoomRobot):
    """Accepts a stop but drives on until its action has ended."""

    def _move(self, ahead_m: float, left_rad: float) -> str:
        stopped, self._stopped = self._stopped, type(self._stopped)()
        why_not = super()._move(ahead_m, left_rad)
        self._stopped = stopped
        return why_not

    def act(self, action, action_id: str) -> ActionResult:
        result = super().act(action, action_id)
        return replace(result, succeeded=True) if isinstance(action, Turn) else result


class Unlatched(RoomRobot):
    def stop(self, reason: str) -> None:
        super().stop(reason)
        self.clear_stop()


class Wordless(RoomRobot):
    def stop(self, reason: str) -> None:
        super().stop("")


class Stuck(RoomRobot):
    def clear_stop(self) -> None:
        return


class OneBuffer(RoomRobot):
    """Returns the same array every time and overwrites it."""

    def __init__(self) -> None:
        super().__init__()
        self._color = np.zeros((120, 160, 3), np.uint8)
        self._count = 0

    def capture(self) -> Capture:
        c = super().capture()
        self._count += 1
        self._color[:] = c.color + np.uint8(self._count)
        return replace(c, color=self._color)


class Raising(RoomRobot):
    """Raises an exception instead of returning a failed result."""

    def _do(self, action) -> str:
        why_not = super()._do(action)
        if "cannot" in why_not:
            raise ValueError(why_not)
        return why_not


class Showing(Described):
    """Shows its empty hand."""

    def __init__(self) -> None:
        super().__init__(can_pick=True, reach_m=0.8, show_base_m=(0.5, 0.0, 0.6))

    def _do(self, action) -> str:
        return "" if isinstance(action, Show) else super()._do(action)


class Lost(RoomRobot):
    """Has another origin id at every call."""

    def state(self) -> RobotState:
        return replace(super().state(), origin_id=f"room {time.monotonic_ns()}")


class Renamed(RoomRobot):
    """Has another origin id at each start."""

    def __init__(self) -> None:
        super().__init__()
        self._origin_id = f"room {time.monotonic_ns()}"

    def state(self) -> RobotState:
        return replace(super().state(), origin_id=self._origin_id)


class Wordy(RoomRobot):
    def state(self) -> RobotState:
        return replace(super().state(), origin_id="room " * 20)


SLIPS: list[tuple[Callable[[], RoomRobot], str]] = [
    (lambda: Described(footprint_radius_m=25.0), "test_lengths_are_metres"),
    (lambda: Described(max_depth_m=5000.0), "test_lengths_are_metres"),
    (lambda: Described(max_turn_rad=30.0), "test_angles_are_radians"),
    (lambda: Described(tilt_range_rad=(-20.0, 60.0)), "test_angles_are_radians"),
    (lambda: Described(can_pick=True), "test_a_robot_that_can_pick_can_reach"),
    (
        lambda: Described(show_base_m=(0.5, 0.0, 0.6)),  # and no arm
        "test_a_held_object_is_shown_where_the_camera_can_see_it",
    ),
    (
        lambda: Described(can_pick=True, reach_m=0.8, show_base_m=(-0.5, 0.0, 0.6)),
        "test_a_held_object_is_shown_where_the_camera_can_see_it",
    ),
    (Showing, "test_with_an_empty_hand_nothing_is_shown_and_the_reason_said"),
    (lambda: Described(name=" "), "test_the_robot_has_a_name"),
    (
        lambda: Described(camera_height_m=0.3),
        "test_the_camera_is_mounted_where_the_description_says",
    ),
    (
        lambda: Described(camera=replace(ROBOT.camera, fx=500.0)),
        "test_the_calibration_is_the_one_described",
    ),
    (
        lambda: Seeing(lambda c: replace(c, depth_m=c.depth_m * 1000)),
        "test_depth_is_metres_with_0_where_there_is_none",
    ),
    (
        lambda: Seeing(lambda c: replace(c, depth_m=np.where(c.depth_m > 2.5, np.nan, c.depth_m))),
        "test_depth_is_metres_with_0_where_there_is_none",
    ),
    (
        lambda: Seeing(lambda c: replace(c, depth_m=c.depth_m.astype(np.float64))),
        "test_an_image_has_the_type_and_size_that_its_calibration_says",
    ),
    (
        lambda: Seeing(lambda c: replace(c, color=np.zeros_like(c.color))),
        "test_the_picture_is_no_single_colour",
    ),
    (lambda: Seeing(lambda c: replace(c, stamp_ns=7)), "test_later_images_have_later_stamps"),
    (lambda: Seeing(turned_camera), "test_the_camera_looks_ahead_the_right_way_up"),
    (
        lambda: Seeing(lambda c: replace(c, T_world_base=c.T_world_cam)),
        "test_the_base_stands_upright_on_the_floor",
    ),
    (
        lambda: Seeing(lambda c: replace(c, T_world_base=se2_to_se3(1.0, 0.0, 0.0))),
        "test_the_image_was_taken_where_the_robot_says_it_is",
    ),
    (
        lambda: Seeing(lambda c: replace(c, depth_m=np.ascontiguousarray(c.depth_m[:, ::-1]))),
        "test_what_was_seen_is_still_there_after_a_move",
    ),
    (lambda: Seeing(along_the_ray), "test_nothing_is_seen_below_the_floor"),
    (OneBuffer, "test_an_image_stays_as_it_was_given"),
    (RightIsPositive, "test_a_positive_turn_goes_left_by_that_angle"),
    (Degrees, "test_a_positive_turn_goes_left_by_that_angle"),
    (Sideways, "test_a_drive_goes_along_the_heading_by_that_distance"),
    (AsAsked, "test_a_drive_goes_along_the_heading_by_that_distance"),
    (Reversing, "test_a_robot_that_cannot_move_back_says_so_and_stays"),
    (Forgetful, "test_the_same_action_is_done_once"),
    (Unlatched, "test_a_stop_latches_refuses_every_action_and_says_why"),
    (Wordless, "test_a_stop_latches_refuses_every_action_and_says_why"),
    (Stuck, "test_a_cleared_stop_is_over"),
    (Deaf, "test_a_stop_from_another_thread_ends_the_action_that_runs"),
    (Lost, "test_the_origin_stays_the_same_while_the_robot_acts"),
    (Renamed, "test_a_driver_that_names_an_origin_names_the_same_one_at_every_start"),
    (Wordy, "test_the_name_of_the_origin_is_short_enough_to_be_shown"),
    (Raising, "test_a_thing_out_of_reach_is_not_picked_and_the_reason_said"),
]


@pytest.mark.parametrize(
    ("make", "claim"), SLIPS, ids=[f"{c}-{i}" for i, (_, c) in enumerate(SLIPS)]
)
def test_each_driver_mistake_fails_its_claim(
    make: Callable[[], RoomRobot], claim: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_contract.stop_claims.WITHIN_S", 0.5)
    check = getattr(DriverContract(), claim)
    # The claim holds for the driver without the mistake.
    check(Rig(RoomRobot(), started_again=lambda: closing(RoomRobot())))
    with pytest.raises((AssertionError, ValueError, HeliosError)):
        check(Rig(make(), started_again=lambda: closing(make())))
