"""Checks of a robot's set-up: each estimate against a scene whose truth is known."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from helios_core.errors import Unavailable
from helios_core.geometry import Pinhole, camera_on_base, invert, se2_to_se3
from helios_core.robot import Action, ActionResult, Capture, Forward, RobotDriver, Turn
from helios_core.robot_checks import finding as f
from helios_core.robot_checks.attribution import scale_findings
from helios_core.robot_checks.direct_run import check_driver
from helios_core.robot_checks.finding import Estimate, combined, judged, shown, warning
from helios_core.robot_checks.floor_plane import floor_in_view
from helios_core.robot_checks.image_shift import image_shift
from helios_core.robot_checks.intrinsics import intrinsics_finding
from helios_core.robot_checks.routine import MoveLimits, free_ahead_m, moves
from helios_core.robot_checks.scan_alignment import align, plane_field
from helios_core.robot_checks.time_offset import WatchedTurn, time_offset
from helios_core.robot_checks.watching import watched
from helios_core.types import RobotDescription, RobotState
from hypothesis import given, settings
from hypothesis import strategies as st

CAMERA = Pinhole(260.0, 260.0, 159.5, 119.5, 320, 240)
ROOM_M = ((-2.0, 3.0), (-1.8, 2.2))  # walls in x and in y
CLAIMED_M, TILT_RAD = 1.2, 0.5


def room(T_world_cam: np.ndarray) -> np.ndarray:
    """Depth [h, w] of an empty room with floor and walls."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], -1)
    d, o = rays @ T_world_cam[:3, :3].T, T_world_cam[:3, 3]
    with np.errstate(divide="ignore"):
        hits = [np.where(d[..., 2] < 0, -o[2] / d[..., 2], np.inf)]
        for axis, (low, high) in enumerate(ROOM_M):
            wall = np.where(d[..., axis] > 0, high, low)
            hits.append((wall - o[axis]) / d[..., axis])
    return np.min([np.where(hit > 0, hit, np.inf) for hit in hits], axis=0).astype(np.float32)


def camera_at(
    x_m: float = 0.0, yaw_rad: float = 0.0, tilt_rad: float = TILT_RAD, height_m: float = CLAIMED_M
) -> np.ndarray:
    return camera_on_base(se2_to_se3(x_m, 0.0, yaw_rad), height_m, tilt_rad)


@settings(max_examples=25, deadline=None)
@given(
    pitch_deg=st.floats(-4, 4),
    higher_m=st.floats(-0.08, 0.08),
    yaw_rad=st.floats(-1.2, 3),  # the wall at -1.57 is too near to show enough floor
    percent=st.floats(-3, 3),
)
def test_the_floor_shows_pitch_and_height(
    pitch_deg: float, higher_m: float, yaw_rad: float, percent: float
) -> None:
    tilt_rad = TILT_RAD + math.radians(pitch_deg)
    true = camera_at(yaw_rad=yaw_rad, tilt_rad=tilt_rad, height_m=CLAIMED_M + higher_m)
    depth_m = room(true) * np.float32(1 + percent / 100)
    found = floor_in_view(depth_m, CAMERA, camera_at(yaw_rad=yaw_rad))
    assert found is not None
    assert math.degrees(found.down_rad) == pytest.approx(pitch_deg, abs=0.05)
    assert math.degrees(found.right_rad) == pytest.approx(0.0, abs=0.05)
    wanted_m = (CLAIMED_M + higher_m) * (1 + percent / 100) - CLAIMED_M
    assert found.higher_m == pytest.approx(wanted_m, abs=0.002)


def test_a_camera_that_leans_to_the_right_is_said_to() -> None:
    claimed = camera_at()
    true = claimed.copy()
    lean = math.radians(2)  # about the forward axis, left side up
    c, s = math.cos(lean), math.sin(lean)
    true[:3, :3] = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ claimed[:3, :3]
    found = floor_in_view(room(true), CAMERA, claimed)
    assert found is not None
    assert math.degrees(found.right_rad) == pytest.approx(2.0, abs=0.05)


def test_a_view_without_floor_measures_nothing() -> None:
    level = camera_at(tilt_rad=-0.6)
    assert floor_in_view(room(level), CAMERA, level) is None
    assert floor_in_view(np.zeros((240, 320), np.float32), CAMERA, camera_at()) is None


@settings(max_examples=15, deadline=None)
@given(drive_m=st.floats(0.15, 0.4), turn_deg=st.floats(-25, 25), error=st.floats(-0.03, 0.03))
def test_the_alignment_finds_the_true_motion(drive_m: float, turn_deg: float, error: float) -> None:
    a, b = camera_at(yaw_rad=0.3), camera_at(x_m=drive_m, yaw_rad=0.3 + math.radians(turn_deg))
    claimed_b = camera_at(x_m=drive_m + error, yaw_rad=0.3 + math.radians(turn_deg) + error)
    found = align(plane_field(room(a), CAMERA), plane_field(room(b), CAMERA), invert(claimed_b) @ a)
    assert found is not None
    off = found.T_b_a - invert(b) @ a
    spread = np.sqrt(np.diag(found.covariance))  # large along a wall that fills the view
    assert np.abs(off[:3, :3]).max() < 0.004
    assert (np.abs(off[:3, 3]) < 0.004 + 4 * spread[3:]).all()


def test_two_images_of_nothing_have_no_motion() -> None:
    nothing = plane_field(np.zeros((240, 320), np.float32), CAMERA)
    assert align(nothing, nothing, np.eye(4)) is None


@pytest.mark.parametrize(("right_px", "down_px"), [(0, 0), (5, 0), (-4, 3)])
def test_edges_show_the_shift_between_colour_and_depth(right_px: int, down_px: int) -> None:
    rng = np.random.default_rng(0)
    depth_m = np.full((240, 320), 4.0, np.float32)
    color = np.full((240, 320, 3), 120, np.uint8)
    for _ in range(12):  # boxes in front of a wall
        x, y = int(rng.integers(20, 240)), int(rng.integers(20, 170))
        w, h = int(rng.integers(25, 60)), int(rng.integers(25, 50))
        depth_m[y : y + h, x : x + w] = rng.uniform(1.0, 2.5)
        color[y : y + h, x : x + w] = rng.integers(0, 255, 3)
    moved = np.roll(color, (down_px, right_px), (0, 1))
    found = image_shift(moved, depth_m)
    assert found is not None
    assert found.right_px == pytest.approx(right_px, abs=0.5)
    assert found.down_px == pytest.approx(down_px, abs=0.5)
    assert image_shift(np.full_like(color, 99), depth_m) is None


@settings(max_examples=30, deadline=None)
@given(offset_s=st.floats(-0.15, 0.15), left=st.booleans(), too_far=st.floats(0.95, 1.05))
def test_a_turn_shows_the_time_offset(offset_s: float, left: bool, too_far: float) -> None:
    def heading(t: np.ndarray) -> np.ndarray:  # a smooth turn of 0.5 rad within 0.8 s
        share = np.clip(t / 0.8, 0.0, 1.0)
        return (0.5 if left else -0.5) * share**2 * (3 - 2 * share)

    stamps = np.arange(0.0, 1.1, 0.05)
    claimed = too_far * heading(stamps)
    found = time_offset([WatchedTurn(stamps, claimed, heading(stamps - offset_s))])
    assert found is not None
    assert found[0] == pytest.approx(offset_s, abs=0.01)


def test_a_slow_turn_shows_no_time_offset() -> None:
    stamps = np.arange(0.0, 0.9, 0.1)
    assert time_offset([WatchedTurn(stamps, 0.01 * stamps, 0.01 * stamps)]) is None
    assert time_offset([]) is None


def verdicts(higher_m: float, ratio: float | None) -> dict[str, str]:
    drives = None if ratio is None else Estimate(ratio, 0.001, 8)
    found = scale_findings(Estimate(higher_m, 0.001, 12), 1.25, drives)
    return {finding.name: finding.verdict for finding in found}


def test_one_fault_explains_floor_and_drives() -> None:
    ok = {"height": "ok", "depth scale": "ok", "distance drift": "ok"}
    assert verdicts(0.0, 0.0) == ok
    assert verdicts(0.0125, 0.01) == ok | {"depth scale": "wrong"}
    assert verdicts(0.03, 0.0) == ok | {"height": "wrong"}
    assert verdicts(0.0, -0.05) == ok | {"distance drift": "wrong"}
    without = verdicts(0.03, None)
    assert (without["height"], without["depth scale"]) == ("wrong", "not measured")


def test_intrinsics_of_another_image_size_are_named() -> None:
    of_twice = Pinhole(520.0, 520.0, 319.5, 239.5, 320, 240)
    found = intrinsics_finding(of_twice)
    assert found.verdict == "wrong"
    assert "640 x 480" in found.words
    assert "320 x 240" in found.words
    assert intrinsics_finding(CAMERA, CAMERA).verdict == "ok"
    described = Pinhole(300.0, 300.0, 159.5, 119.5, 320, 240)
    assert intrinsics_finding(CAMERA, described).verdict == "wrong"
    assert intrinsics_finding(None).verdict == "not measured"


def test_a_value_is_wrong_only_beyond_its_limit_and_its_error() -> None:
    def verdict(value: float, error: float) -> str:
        return judged(f.PITCH, Estimate(value, error, 5), "{size} more", "{size} less", "").verdict

    assert verdict(0.5, 0.01) == "ok"
    assert verdict(1.0, 0.01) == "wrong"
    assert verdict(-1.0, 0.5) == "ok"
    wrong = judged(f.HEIGHT, Estimate(-0.031, 0.001, 5), "up {size}", "down {size}", "")
    assert warning([wrong]) == "down 3.1 cm"
    assert shown(0.031, "m", 0.001) == "3.10 ± 0.10 cm"
    assert shown(-0.0001, "deg") == "0.0 deg"


@given(
    middle=st.floats(-10, 10),
    outlier=st.floats(20, 100),
    n=st.integers(5, 20),
    error=st.floats(0.01, 1.0),
)
def test_one_outlier_does_not_move_the_mean(
    middle: float, outlier: float, n: int, error: float
) -> None:
    values = [middle + error * math.sin(k) for k in range(n)]
    found = combined([*values, middle + outlier], [error] * (n + 1), 0.0)
    assert found is not None
    assert found.value == pytest.approx(middle, abs=error)


def test_the_routine_turns_once_and_drives_only_with_room_and_leave() -> None:
    def run(drive: bool, room_m: float) -> list[Action]:
        routine, out = moves(MoveLimits(), drive), []
        action = next(routine, None)
        while action is not None:
            out.append(action)
            try:
                action = routine.send(room_m)
            except StopIteration:
                break
        return out

    turns = run(False, 5.0)
    assert sum(a.angle_rad for a in turns if isinstance(a, Turn)) == pytest.approx(2 * math.pi)
    assert not [a for a in turns if isinstance(a, Forward)]
    assert len([a for a in run(True, 5.0) if isinstance(a, Forward)]) == 8
    assert not [a for a in run(True, 0.5) if isinstance(a, Forward)]
    assert list(moves(MoveLimits(can_move=False), True)) == []


@given(st.floats(0.1, 2.0))
def test_the_routine_never_turns_farther_than_the_robot_can(max_turn_rad: float) -> None:
    turns = [a for a in moves(MoveLimits(max_turn_rad=max_turn_rad), False) if isinstance(a, Turn)]
    assert all(a.angle_rad <= max_turn_rad + 1e-6 for a in turns)
    assert sum(a.angle_rad for a in turns) == pytest.approx(2 * math.pi)


@pytest.mark.parametrize("max_turn_rad", [0.0, 5e-324])
@pytest.mark.parametrize("drive", [False, True])
def test_a_robot_that_cannot_turn_makes_no_move_and_its_findings_say_so(
    max_turn_rad: float, drive: bool
) -> None:
    class Sliding(RobotDriver):
        """Drives straight ahead and cannot turn."""

        def describe(self) -> RobotDescription:
            return RobotDescription(
                "s",
                0.3,
                1.4,
                CAMERA,
                CLAIMED_M,
                0.0,
                5.0,
                min_turn_rad=0.0,
                max_turn_rad=max_turn_rad,
            )

        def state(self) -> RobotState:
            return RobotState(np.eye(4))

        def capture(self) -> Capture:
            color = np.zeros((240, 320, 3), np.uint8)
            return Capture(0, color, room(camera_at()), CAMERA, camera_at(), np.eye(4))

        def act(self, action: Action, action_id: str) -> ActionResult:
            raise AssertionError(f"the robot was to do {action}")

        def stop(self, reason: str) -> None: ...

        def clear_stop(self) -> None: ...

    found = {finding.name: finding for finding in check_driver(Sliding(), drive)}
    for check in (f.HEADING, f.TIME_OFFSET):
        assert found[check.name].verdict == "not measured"
        assert found[check.name].words.startswith("left out: the robot offers no turns")
        assert "give max_turn_rad in its driver's describe()" in found[check.name].words
    assert found[f.PITCH.name].words.startswith("1 of 3 images came; the robot offers no turns")


def test_the_free_way_ahead_ends_at_the_wall() -> None:
    robot = RobotDescription("r", 0.3, 1.4, CAMERA, CLAIMED_M, 0.0, 5.0)
    T_world_cam, base = camera_at(), se2_to_se3(0.0, 0.0, 0.0)
    color = np.zeros((240, 320, 3), np.uint8)
    seen = Capture(0, color, room(T_world_cam), CAMERA, T_world_cam, base)
    assert free_ahead_m(seen, robot) == pytest.approx(ROOM_M[0][1] - 0.3, abs=0.1)
    nothing = Capture(0, color, np.zeros((240, 320), np.float32), CAMERA, T_world_cam, base)
    assert free_ahead_m(nothing, robot) == 0.0


def test_images_are_taken_while_an_action_runs() -> None:
    enough, taken = threading.Event(), []

    def capture() -> Capture:
        taken.append(1)
        if len(taken) == 3:
            enough.set()
        pose = np.eye(4)
        return Capture(
            len(taken),
            np.zeros((1, 1, 3), np.uint8),
            np.ones((1, 1), np.float32),
            CAMERA,
            pose,
            pose,
        )

    result, seen = watched(lambda: ActionResult(enough.wait(20)), capture, 200.0)
    assert result.succeeded
    assert [c.stamp_ns for c in seen[:3]] == [1, 2, 3]

    def broken() -> Capture:
        raise Unavailable("the camera is away")

    assert watched(lambda: ActionResult(True), broken, 200.0) == (ActionResult(True), ())
