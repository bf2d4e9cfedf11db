"""The bridge over a MemoryBus with a robot of arrays."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from helios_bridge.lease import Lease
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import Conflict, DeadlineExceeded, InvalidInput, Unavailable
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    EndOfRecording,
    Forward,
    RobotDriver,
)
from helios_core.topics import (
    ACT,
    CLEAR_STOP,
    CONTEXT,
    KEYFRAME,
    LEASE,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    ROBOT_STATE,
    STOP,
    status_topic,
)
from helios_core.types import RobotDescription, RobotState

from tests.support import wait_until

CAMERA = Pinhole(8.0, 8.0, 8.0, 6.0, 16, 12)


class LineRobot(RobotDriver):
    """Drives along x. With `frames`, it is a recording of that many."""

    def __init__(self, frames: int | None = None) -> None:
        self.x_m = 0.0
        self.done: list[Action] = []
        self.stopped = ""
        self.hold = threading.Event()
        self.hold.set()
        self.left = frames

    def describe(self) -> RobotDescription:
        movable = self.left is None
        return RobotDescription("line", 0.3, 1.0, CAMERA, 1.0, 0.8, 5.0, can_move=movable)

    def state(self) -> RobotState:
        return RobotState(se2_to_se3(self.x_m, 0, 0), stopped=bool(self.stopped))

    def capture(self) -> Capture:
        if self.left is not None:
            if self.left == 0:
                raise EndOfRecording
            self.left -= 1
        base = se2_to_se3(self.x_m, 0, 0)
        return Capture(
            stamp_ns=len(self.done) + 1,
            color=np.zeros((12, 16, 3), np.uint8),
            depth_m=np.full((12, 16), 1.5, np.float32),
            camera=CAMERA,
            T_world_cam=camera_on_base(base, 1.0, 0.5),
            T_world_base=base,
        )

    def act(self, action: Action, action_id: str) -> ActionResult:
        self.done.append(action)
        self.hold.wait(5)
        if self.stopped:
            return ActionResult(False, self.stopped)
        if isinstance(action, Forward):
            self.x_m += action.distance_m
        return ActionResult(True, moved_m=self.x_m, steps=len(self.done))

    def stop(self, reason: str) -> None:
        self.stopped = reason
        self.hold.set()

    def clear_stop(self) -> None:
        self.stopped = ""


class Stage:
    """A bridge with its robot, and somebody who drives."""

    def __init__(self, robot: LineRobot | None = None, **settings: object) -> None:
        hub = MemoryHub()
        self.robot = robot or LineRobot()
        self.bus, self.other = MemoryBus(hub), MemoryBus(hub)
        self.health = Health()
        values = {"stream_hz": 0.0, **settings}
        self.bridge = BridgeService(self.bus, self.robot, Settings(**values), self.health, 0)  # pyright: ignore[reportArgumentType]
        self.keyframes: list[pb.Frame] = []
        self.other.subscribe(KEYFRAME, self.keyframes.append)
        self.token = 0

    def drive(self, action_id: str, distance_m: float = 0.5, left_s: float = 5) -> pb.ActionResult:
        if not self.token:
            self.token = self.other.call(LEASE, pb.LeaseRequest(holder="planner"), 1).token
        request = pb.ActionRequest(
            action_id=action_id,
            lease_token=self.token,
            time_remaining_s=left_s,
            action=pb.Action(forward=pb.Action.Forward(distance_m=distance_m)),
        )
        return self.other.call(ACT, request, 10)


def test_an_action_ends_with_a_keyframe_that_the_result_names() -> None:
    stage = Stage()
    result = stage.drive("a")
    assert result.succeeded
    assert [k.id.seq for k in stage.keyframes] == [result.keyframe.seq]
    frame = frame_from_proto(stage.keyframes[0])
    assert frame.keyframe
    np.testing.assert_allclose(frame.T_world_base, se2_to_se3(0.5, 0, 0), atol=1e-9)
    np.testing.assert_allclose(frame.depth_m, 1.5, atol=5e-4)


def test_what_an_action_changed_is_told_before_the_image_that_shows_it() -> None:
    """So that a map knows what is held when the hand is in the picture."""

    class Taking(LineRobot):
        def state(self) -> RobotState:
            return replace(super().state(), held="mug" if self.done else "")

    stage = Stage(Taking())
    told: list[str] = []
    stage.other.subscribe(ROBOT_STATE, lambda state: told.append(f"held: {state.held}"))
    stage.other.subscribe(KEYFRAME, lambda _: told.append("keyframe"))
    stage.drive("a")
    assert "held: mug" in told[: told.index("keyframe")]
    assert [frame_from_proto(k).held for k in stage.keyframes] == ["mug"]


def test_the_same_action_asked_for_twice_is_done_once() -> None:
    stage = Stage()
    first, second = stage.drive("a"), stage.drive("a")
    assert first == second
    assert len(stage.robot.done) == 1


def test_an_action_after_which_the_camera_failed_moves_the_robot_once() -> None:
    class Blinking(LineRobot):
        blinks = 1

        def capture(self) -> Capture:
            if self.blinks:
                self.blinks -= 1
                raise Unavailable("the camera is away")
            return super().capture()

    stage = Stage(Blinking())
    with pytest.raises(Unavailable, match="camera"):
        stage.drive("a")
    result = stage.drive("a")
    assert result.succeeded
    assert result.keyframe.seq == stage.keyframes[0].id.seq
    assert len(stage.robot.done) == 1
    assert stage.robot.x_m == 0.5


def test_without_the_present_lease_nobody_drives() -> None:
    stage = Stage()
    stage.drive("a")
    with pytest.raises(Conflict, match="planner drives the robot"):
        stage.other.call(LEASE, pb.LeaseRequest(holder="other"), 1)
    stage.other.call(LEASE, pb.LeaseRequest(holder="other", take=True), 1)
    with pytest.raises(Conflict, match="ask anew"):
        stage.drive("b")
    assert len(stage.robot.done) == 1


def test_a_refused_action_may_be_asked_for_again_with_its_id() -> None:
    stage = Stage()
    stage.drive("a")
    stage.other.call(LEASE, pb.LeaseRequest(holder="other", take=True), 1)
    with pytest.raises(Conflict):
        stage.drive("b")
    stage.token = stage.other.call(LEASE, pb.LeaseRequest(holder="planner", take=True), 1).token
    assert stage.drive("b").succeeded


def test_a_lease_ends_by_itself() -> None:
    now = [0.0]
    lease = Lease(10.0, 0, clock=lambda: now[0])
    token = lease.grant("planner")
    now[0] = 9.0
    lease.check(token)
    now[0] = 18.0
    lease.check(token)
    now[0] = 29.0
    with pytest.raises(Conflict, match="ran out"):
        lease.check(token)
    lease.renew(token)  # its last action took so long
    lease.check(token)
    lease.renew(token - 1)
    now[0] = 50.0
    assert lease.grant("other") > token


def test_an_action_longer_than_the_lease_leaves_its_driver_the_lease() -> None:
    now = [0.0]

    class Slow(LineRobot):
        def act(self, action: Action, action_id: str) -> ActionResult:
            now[0] += 60.0
            return super().act(action, action_id)

    stage = Stage(Slow())
    stage.bridge._lease = Lease(10.0, 0, clock=lambda: now[0])
    stage.drive("a")
    assert stage.drive("b").succeeded


def test_a_late_action_is_refused() -> None:
    stage = Stage()
    with pytest.raises(DeadlineExceeded, match="before it began"):
        stage.drive("a", left_s=0.0)
    assert stage.robot.done == []


@pytest.mark.parametrize("distance_m", [float("nan"), float("inf")])
def test_an_action_that_makes_no_sense_is_refused(distance_m: float) -> None:
    with pytest.raises(InvalidInput, match="finite"):
        Stage().drive("a", distance_m)


def test_stop_now_ends_the_running_action_latches_and_needs_an_explicit_clear() -> None:
    stage = Stage()
    stage.robot.hold.clear()
    results: list[pb.ActionResult] = []
    runner = threading.Thread(target=lambda: results.append(stage.drive("a")))
    runner.start()
    wait_until(lambda: stage.robot.done, 5, "the action runs")
    stage.other.call(STOP, pb.StopRequest(reason="a child in the way"), 1)
    runner.join(5)
    assert not results[0].succeeded
    assert stage.bridge.state().stopped
    with pytest.raises(Conflict, match="a child in the way"):
        stage.drive("b")
    stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    assert stage.drive("b").succeeded


@pytest.mark.parametrize("action_id", ["", "x" * 10_000])
def test_an_action_without_a_sensible_id_is_refused(action_id: str) -> None:
    stage = Stage()
    with pytest.raises(InvalidInput, match="id"):
        stage.drive(action_id)
    assert not stage.robot.done


def test_the_watchdog_stops_an_action_that_outlives_its_time() -> None:
    stage = Stage()
    stage.bridge.start()
    stage.robot.hold.clear()
    result = stage.drive("a", left_s=0.2)
    assert not result.succeeded
    assert "outlived" in result.reason
    stage.bridge.close()


@pytest.mark.parametrize("left_s", [float("nan"), float("inf"), 1e9])
def test_an_action_without_an_end_is_refused(left_s: float) -> None:
    stage = Stage()
    with pytest.raises(InvalidInput, match="time_remaining_s"):
        stage.drive("a", left_s=left_s)
    assert not stage.robot.done


def test_the_watchdog_outlives_a_robot_that_does_not_answer() -> None:
    stage = Stage()

    def deaf(reason: str) -> None:
        LineRobot.stop(stage.robot, reason)
        raise Unavailable("the robot is away")

    stage.bridge.start()
    stage.robot.stop = deaf  # pyright: ignore[reportAttributeAccessIssue]
    for action_id in ("a", "b"):
        stage.robot.hold.clear()
        assert "outlived" in stage.drive(action_id, left_s=0.2).reason
        stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    stage.bridge.close()


def test_in_lockstep_a_keyframe_waits_for_the_answers_of_all_maps() -> None:
    stage = Stage(lockstep=True, ack_timeout_s=5.0)

    def answer(frame: pb.Frame) -> None:
        for topic, service, part in (
            (OBJECTMAP_ACK, "objectmap", "objects"),
            (MAP2D_ACK, "map2d", "occupancy"),
            (MAP2D_ACK, "map2d", "value"),
        ):
            stage.other.publish(topic, pb.Ack(service=service, part=part, id=frame.id))

    stage.other.subscribe(KEYFRAME, answer)
    assert stage.drive("a").succeeded
    assert stage.health.state[0] != "degraded"


def test_in_lockstep_a_missing_answer_is_said_by_name() -> None:
    stage = Stage(lockstep=True, ack_timeout_s=0.05)
    stage.drive("a")
    state, reason = stage.health.state
    assert state == "degraded"
    assert "map2d/value" in reason


def test_a_recording_plays_once_the_maps_are_ready_and_says_its_end() -> None:
    stage = Stage(LineRobot(frames=3))
    states: list[pb.RobotState] = []
    stage.other.subscribe(ROBOT_STATE, states.append)
    stage.bridge.start()
    stage.other.publish(CONTEXT, pb.SearchContext(id="c"))
    for service in ("detector", "objectmap"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    assert stage.keyframes == []
    stage.other.publish(status_topic("map2d"), pb.ServiceStatus(service="map2d", state="ready"))
    wait_until(lambda: states and states[-1].finished, 5, "the recording ends")
    assert len(stage.keyframes) == 3
    stage.bridge.close()


def test_a_recording_whose_driver_fails_says_so() -> None:
    class Failing(LineRobot):
        def capture(self) -> Capture:
            raise OverflowError("timeout value is too large")

    stage = Stage(Failing(frames=3), contexts=True)
    stage.bridge.start()
    for service in ("detector", "objectmap", "map2d"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    wait_until(lambda: stage.health.state[0] == "degraded", 5, "it is said")
    assert "OverflowError" in stage.health.state[1]
    stage.bridge.close()


class Scratched(LineRobot):
    """A recording of four frames, of which the second and third cannot be read."""

    def capture(self) -> Capture:
        out = super().capture()
        if self.left in (1, 2):
            raise InvalidInput(f"frame {4 - self.left} is no image")
        return out


def played(**settings: object) -> Stage:
    stage = Stage(Scratched(frames=4), contexts=True, **settings)
    stage.bridge.start()
    for service in ("detector", "objectmap", "map2d"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    return stage


def test_frames_that_cannot_be_read_are_left_out_counted_and_said() -> None:
    stage = played()
    wait_until(lambda: stage.bridge.state().finished, 5, "the recording ends")
    said = "some frames were left out, the last: frame 3 is no image"
    wait_until(lambda: stage.health.state[1] == said, 5, "it is said")
    assert stage.health.state[0] == "ready"
    assert len(stage.keyframes) == 2
    assert stage.health.metrics()["unreadable_frames"] == 2
    stage.bridge.close()


def test_a_strict_replay_ends_at_a_frame_that_cannot_be_read() -> None:
    stage = played(strict=True)
    wait_until(lambda: stage.health.state[0] == "degraded", 5, "it is said")
    assert "frame 2 is no image" in stage.health.state[1]
    assert len(stage.keyframes) == 1
    stage.bridge.close()
