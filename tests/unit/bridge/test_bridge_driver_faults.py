"""A fault in a user's driver becomes one sentence with the driver, the method and the fault."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.driver_guard import GuardedDriver
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import HeliosError, Internal, InvalidInput, Unavailable
from helios_core.geometry import Pinhole
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, ActionResult, Capture, Turn
from helios_core.topics import FRAME, GET_STATE, STOP
from helios_core.types import RobotDescription, RobotState

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import CAMERA, LineRobot, Stage

ME = f"{__name__}:Misbehaving"


class Misbehaving(LineRobot):
    """Each method returns the test's value, or raises it if it is an exception; `...`: correct."""

    gives: dict[str, Any]

    def __init__(self, **gives: Any) -> None:
        super().__init__()
        self.gives = gives

    def answer(self, method: str, right: Any) -> Any:
        out = self.gives.get(method, ...)
        if isinstance(out, BaseException):
            raise out
        return right if out is ... else out

    def describe(self) -> RobotDescription:
        return self.answer("describe", super().describe())

    def state(self) -> RobotState:
        return self.answer("state", super().state())

    def capture(self) -> Capture:
        return self.answer("capture", super().capture())

    def act(self, action: Action, action_id: str) -> ActionResult:
        return self.answer("act", super().act(action, action_id))

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        result = self.act(action, action_id)
        return self.answer("act_and_watch", (result, (LineRobot().capture(),)))

    def stop(self, reason: str) -> None:
        super().stop(reason)
        self.answer("stop", None)


@pytest.mark.parametrize(
    ("gives", "said"),
    [
        (
            KeyError("motor 3"),
            f"the driver {ME} failed in act(Forward): KeyError: 'motor 3'; "
            "`helios logs bridge` shows where",
        ),
        (
            SystemExit(3),
            f"the driver {ME} failed in act(Forward): SystemExit: 3; "
            "`helios logs bridge` shows where",
        ),
        (None, f"the driver {ME} returned None from act(Forward); return an ActionResult"),
        (
            {"succeeded": True},
            f"the driver {ME} returned a dict from act(Forward); return an ActionResult",
        ),
        (
            ActionResult(True, moved_m="far"),  # pyright: ignore[reportArgumentType]
            f"the driver {ME} returned an ActionResult from act(Forward) with a field of a wrong "
            "type",
        ),
    ],
)
def test_a_fault_in_act_names_driver_and_method_until_an_action_succeeds(
    gives: Any, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = Misbehaving()
    stage = Stage(robot)
    stage.bridge.start()
    assert stage.drive("good").succeeded
    robot.gives["act"] = gives
    with caplog.at_level(logging.ERROR), pytest.raises(Internal) as failed:
        stage.drive("bad")
    assert failed.value.message.startswith(said)
    assert stage.health.state == ("degraded", failed.value.message)
    if isinstance(gives, BaseException):
        assert "in act" in caplog.text  # the traceback
    stage.bridge._publisher.capture_and_wait(
        keyframe=False
    )  # an image does not show that the robot can drive
    assert stage.health.state[0] == "degraded"
    robot.gives.clear()
    assert stage.drive("good again").succeeded
    assert stage.health.state[0] == "ready"
    stage.bridge.close()


@pytest.mark.parametrize("method", ["capture", "state"])
@pytest.mark.parametrize("gives", [None, [1, 2], OSError("USB unplugged")])
def test_a_fault_in_capture_or_state_names_driver_and_method_until_it_is_over(
    method: str, gives: Any
) -> None:
    robot, health = Misbehaving(), Health()
    bridge = BridgeService(MemoryBus(MemoryHub()), robot, Settings(stream_hz=50), health)
    bridge.start()
    try:
        wait_until(lambda: health.state[0] == "ready", 60, "it streams")
        robot.gives[method] = gives
        wait_until(lambda: health.state[0] == "degraded", 60, "the fault is said")
        assert health.state[1].startswith(f"the driver {ME} ")
        assert f"{method}()" in health.state[1]
        robot.gives.clear()
        wait_until(lambda: health.state[0] == "ready", 60, "it is over")
    finally:
        bridge.close()


def test_a_state_with_an_impossible_pose_is_a_fault_of_the_driver_that_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    robot = Misbehaving()
    stage = Stage(robot)
    states = {
        "T_world_base is not a rigid 4x4 matrix; [[nan, ": RobotState(np.full((4, 4), np.nan)),
        "T_world_base is not a rigid 4x4 matrix; [[2.0, ": RobotState(2 * np.eye(4)),
        "T_world_base is not a rigid 4x4 matrix; 9 numbers came": RobotState(np.eye(3)),
        "tilt_rad is inf": RobotState(np.eye(4), tilt_rad=np.inf),
    }
    with caplog.at_level(logging.ERROR):
        for said, state in states.items():
            robot.gives["state"] = state
            with pytest.raises(Internal, match=r"RobotState from state\(\)") as failed:
                stage.other.call(GET_STATE, pb.Empty(), 5)
            assert said in failed.value.message
            assert stage.health.state == ("degraded", failed.value.message)
    assert len(caplog.records) == 1
    stage.bridge.close()


@pytest.mark.parametrize("gives", [None, "a robot", ZeroDivisionError("a slip")])
def test_a_fault_in_describe_names_driver_and_method(gives: Any) -> None:
    with pytest.raises(Internal, match=r"the driver .*:Misbehaving .* describe\(\)"):
        BridgeService(MemoryBus(MemoryHub()), Misbehaving(describe=gives), Settings(), Health())


def test_a_fault_in_stop_is_reported_to_the_caller() -> None:
    stage = Stage(Misbehaving(stop=OSError("no route")))
    with pytest.raises(Internal, match=r"failed in stop\(\): OSError: no route"):
        stage.other.call(STOP, pb.StopRequest(reason="a cat"), 5)
    assert stage.health.state[0] == "degraded"


def test_a_typed_error_of_a_driver_keeps_its_message() -> None:
    stage = Stage(Misbehaving(act=Unavailable("the arm is asleep; wake it")))
    with pytest.raises(Unavailable, match=r"^the arm is asleep; wake it$"):
        stage.drive("a")


def test_a_repeated_fault_is_logged_with_one_traceback(caplog: pytest.LogCaptureFixture) -> None:
    stage = Stage(Misbehaving(capture=OSError("USB unplugged")))
    with caplog.at_level(logging.ERROR):
        for _ in range(20):
            with pytest.raises(HeliosError):
                stage.bridge._publisher.capture_and_wait(keyframe=False)
    assert caplog.text.count("Traceback") == 1


def test_a_robot_that_is_away_is_logged_once_and_not_with_every_state(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stage = Stage(Misbehaving(state=Unavailable("no answer from the robot")))
    for _ in range(20):
        stage.bridge._publish_state()
    assert caplog.text.count("the robot's state could not be told: no answer from the robot") == 1


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"color": [[0]]}, "color is a list; give an array of uint8"),
        ({"depth_m": None}, "depth_m is a NoneType; give an array of float32"),
        ({"camera": (8, 8)}, "camera is a tuple; give a Pinhole"),
        ({"T_world_cam": None}, "T_world_cam is a NoneType"),
        ({"stamp_ns": 1.5}, "stamp_ns is a float; give an int"),
        ({"stamp_ns": True}, "stamp_ns is a bool; give an int"),
        ({"T_world_base": np.eye(4).tolist()}, "T_world_base is a list"),
        ({"stamp_ns": 2**63}, "stamp_ns is 9223372036854775808; give the robot's clock in nanos"),
        ({"stamp_ns": -(10**30)}, "stamp_ns is -1000000000000000000000000000000; give the robot's"),
        ({"camera": replace(CAMERA, fx=0.0)}, "the driver's camera is wrong: .* fx 0.0, fy 8.0"),
        ({"camera": replace(CAMERA, fy=math.nan)}, "the driver's camera is wrong: .* fy nan"),
        ({"camera": replace(CAMERA, cx=1e6)}, "the driver's camera is wrong: .*centre"),
        ({"camera": replace(CAMERA, cy="6")}, r"camera\.cy is '6'; give a number of pixels"),
        ({"camera": replace(CAMERA, width=16.0)}, r"camera\.width is 16\.0; give an int of pixels"),
        ({"camera": replace(CAMERA, height=-1)}, r"camera\.height is -1; give an int of pixels"),
        ({"camera": replace(CAMERA, width=2**40)}, r"camera\.width is 1099511627776; give"),
    ],
)
def test_an_image_with_a_field_of_a_wrong_type_or_value_is_refused(
    wrong: dict[str, Any], said: str
) -> None:
    robot = Misbehaving()
    robot.gives["capture"] = replace(LineRobot().capture(), **wrong)
    with pytest.raises(InvalidInput, match=said):
        Stage(robot).bridge._publisher.capture_and_wait(keyframe=False)


def test_an_image_with_numbers_of_numpy_is_published() -> None:
    numbers: list[Any] = [*(np.float32(v) for v in (8, 8, 8, 6)), np.int64(16), np.int64(12)]
    camera = Pinhole(*numbers)
    robot = Misbehaving()
    robot.gives["capture"] = replace(LineRobot().capture(), camera=camera, stamp_ns=np.int64(7))
    stage = Stage(robot)
    stage.bridge._publisher.capture_and_wait(keyframe=True)
    frame = frame_from_proto(stage.keyframes[0])
    assert (frame.camera, frame.stamp_ns) == (CAMERA, 7)


def test_an_image_after_an_action_ends_the_report_that_no_image_comes() -> None:
    """A task leaves the stream no turn, so the stream cannot take the report back."""
    robot = Misbehaving(capture=Unavailable("/odom is silent"))
    stage = Stage(robot, stream_hz=50.0)
    stage.bridge.start()
    wait_until(lambda: "/odom is silent" in stage.health.state[1], 60, "the stream has failed")
    stage.bridge._ending.set()  # from here on only actions take images
    stage.bridge._executor.wait(5)
    robot.gives.clear()
    assert stage.health.state[0] == "waiting"
    stage.drive("after the outage")
    assert stage.health.state == ("ready", "")


RIGHT = LineRobot().capture()


@pytest.mark.parametrize(
    ("images", "used", "said"),
    [
        ((RIGHT, replace(RIGHT, T_world_cam=np.zeros((4, 4))), RIGHT), 2, "T_world_cam"),
        ([RIGHT, RIGHT, None], 2, "AttributeError"),
        (None, 0, "they are a NoneType; give a tuple of Capture"),
    ],
)
def test_a_wrong_image_of_an_action_is_left_out_and_its_result_is_kept(
    images: Any, used: int, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    result, health = ActionResult(True, turned_rad=0.4), Health()
    robot = Misbehaving(act_and_watch=(result, images))
    guard = GuardedDriver(robot, BridgeHealth(health))
    with caplog.at_level(logging.WARNING):
        kept, seen = guard.act_and_watch(Turn(0.4), "a", 12.0)
    assert kept is result
    assert seen == (RIGHT,) * used
    assert f"the driver {ME} returned wrong images from act_and_watch(Turn): " in caplog.text
    assert said in caplog.text
    assert health.state[0] == "starting"  # no fault of the driver is reported


def test_a_repeated_turn_with_a_wrong_image_moves_the_robot_once() -> None:
    robot = Misbehaving()
    robot.gives["act_and_watch"] = ActionResult(True), (RIGHT, None)
    stage = Stage(robot)
    assert stage.bridge._setup is not None
    stage.bridge._setup.restart()  # the next turns are watched
    turn = pb.Action(turn=pb.Action.Turn(angle_rad=0.4))
    for _ in range(2):
        assert stage.drive("a", action=turn).succeeded
    assert robot.done == [Turn(0.4)]


def test_stream_frames_do_not_hide_a_keyframe_that_no_map_answered() -> None:
    silent = Unavailable("/color is silent")
    robot = Misbehaving(capture=silent)
    stage = Stage(robot, stream_hz=50.0, lockstep=True, ack_timeout_s=0.05)
    streamed = list[pb.Frame]()
    stage.other.subscribe(FRAME, streamed.append)
    stage.bridge.start()
    try:
        robot.gives.clear()  # the first frame is a keyframe, which no map answers here
        wait_until(lambda: len(streamed) > 3, 60, "the stream goes on")
        assert stage.health.state[0] == "degraded"
        assert "was not answered by map2d/occupancy" in stage.health.state[1]
        robot.gives["capture"] = silent
        wait_until(lambda: "/color is silent" in stage.health.state[1], 60, "no image comes")
        robot.gives.clear()
        wait_until(lambda: "was not answered" in stage.health.state[1], 60, "an image comes")
    finally:
        stage.bridge.close()
