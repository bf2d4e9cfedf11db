"""Actions over the bridge: executed once per id, shown by a keyframe, answered by the maps."""

from __future__ import annotations

import re
import time
from dataclasses import replace

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.bus import arrived
from helios_core.codec import frame_from_proto
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable
from helios_core.geometry import se2_to_se3
from helios_core.robot import Capture
from helios_core.topics import (
    DETECTOR_ACK,
    FRAME,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    ROBOT_STATE,
)
from helios_core.types import RobotDescription, RobotState

from tests.unit.bridge.bridge_stage import LineRobot, Stage


def test_an_action_ends_with_a_keyframe_that_the_result_names() -> None:
    stage = Stage()
    result = stage.drive("a")
    assert result.succeeded
    assert [k.id.seq for k in stage.keyframes] == [result.keyframe.seq]
    frame = frame_from_proto(stage.keyframes[0])
    assert frame.keyframe
    np.testing.assert_allclose(frame.T_world_base, se2_to_se3(0.5, 0, 0), atol=1e-9)
    np.testing.assert_allclose(frame.depth_m, 1.5, atol=5e-4)


def test_an_action_without_a_keyframe_reports_the_robot_pose() -> None:
    stage = Stage(stream_hz=0.0)
    result = stage.drive("a", no_keyframe=True)
    assert result.succeeded
    assert not result.HasField("keyframe")
    np.testing.assert_allclose(result.T_world_base.rows, se2_to_se3(0.5, 0, 0).ravel())
    assert stage.keyframes == []
    assert stage.drive("b").keyframe.seq == stage.keyframes[0].id.seq


def test_stream_frames_continue_while_the_robot_moves_without_keyframes() -> None:
    stage = Stage(stream_hz=60.0)
    frames: list[pb.Frame] = []
    stage.other.subscribe(FRAME, frames.append)
    stage.drive("a", no_keyframe=True)  # the last image is older than one period
    assert [f.keyframe for f in frames] == [False]
    assert stage.keyframes == []


def test_the_robot_state_after_an_action_is_published_before_its_keyframe() -> None:
    """A map must know the held object when the hand appears in the image."""

    class Taking(LineRobot):
        def state(self) -> RobotState:
            return replace(super().state(), held="mug" if self.done else "")

    stage = Stage(Taking())
    reported: list[str] = []
    stage.other.subscribe(ROBOT_STATE, lambda state: reported.append(f"held: {state.held}"))
    stage.other.subscribe(KEYFRAME, lambda _: reported.append("keyframe"))
    stage.drive("a")
    assert "held: mug" in reported[: reported.index("keyframe")]
    assert [frame_from_proto(k).held for k in stage.keyframes] == ["mug"]


def shown_in(stage: Stage) -> list[tuple[tuple[float, float, float], float] | None]:
    """Shown object of each keyframe: its point and its turn."""
    shown = [frame_from_proto(k).shown for k in stage.keyframes]
    return [None if s is None else (s.point_m, s.turn_rad) for s in shown]


def test_a_frame_says_that_the_robot_shows_what_it_holds_until_its_next_motion() -> None:
    class Showing(LineRobot):
        def describe(self) -> RobotDescription:
            return replace(super().describe(), show_base_m=(0.5, 0.0, 1.1))

        def state(self) -> RobotState:
            return replace(super().state(), held="mug")

    stage = Stage(Showing())
    stage.drive("a")
    x_m = stage.robot.x_m
    stage.drive("b", action=pb.Action(show=pb.Action.Show(angle_rad=0.25)))
    stage.drive("c", action=pb.Action(observe=pb.Action.Observe()))
    stage.drive("d")
    point = (x_m + 0.5, 0.0, 1.1)
    assert shown_in(stage) == [None, (point, 0.25), (point, 0.25), None]


def test_a_robot_that_cannot_show_is_not_asked_to() -> None:
    stage = Stage()
    result = stage.drive("a", action=pb.Action(show=pb.Action.Show(angle_rad=0.25)))
    assert not result.succeeded
    assert "its description has no show_base_m" in result.reason
    assert stage.robot.done == []
    assert shown_in(stage) == [None]


def test_an_action_with_a_repeated_id_is_executed_once() -> None:
    stage = Stage()
    first, second = stage.drive("a"), stage.drive("a")
    assert first == second
    assert len(stage.robot.done) == 1


def test_an_action_repeated_after_a_camera_failure_moves_the_robot_once() -> None:
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


def test_a_late_action_is_refused() -> None:
    stage = Stage()
    with pytest.raises(DeadlineExceeded, match="before it began"):
        stage.drive("a", left_s=0.0)
    assert stage.robot.done == []


@pytest.mark.parametrize("distance_m", [float("nan"), float("inf")])
def test_an_action_with_a_non_finite_distance_is_refused(distance_m: float) -> None:
    with pytest.raises(InvalidInput, match="finite"):
        Stage().drive("a", distance_m)


@pytest.mark.parametrize("action_id", ["", "x" * 10_000])
def test_an_empty_or_overlong_action_id_is_refused(action_id: str) -> None:
    stage = Stage()
    with pytest.raises(InvalidInput, match="id"):
        stage.drive(action_id)
    assert not stage.robot.done


@pytest.mark.parametrize("left_s", [float("nan"), float("inf"), 1e9])
def test_an_action_with_an_invalid_time_limit_is_refused(left_s: float) -> None:
    stage = Stage()
    with pytest.raises(InvalidInput, match="time_remaining_s"):
        stage.drive("a", left_s=left_s)
    assert not stage.robot.done


def test_lockstep_waits_for_the_answers_of_all_maps() -> None:
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


def test_lockstep_does_not_wait_for_detections_that_the_detector_refused() -> None:
    stage = Stage(lockstep=True, ack_timeout_s=60.0)

    def answer(frame: pb.Frame) -> None:
        refusal = pb.Ack(service="detector", part="observation", id=frame.id, reason="no model")
        stage.other.publish(DETECTOR_ACK, refusal)
        stage.other.publish(MAP2D_ACK, pb.Ack(service="map2d", part="occupancy", id=frame.id))

    stage.other.subscribe(KEYFRAME, answer)
    assert stage.drive("a").succeeded
    assert "unanswered_keyframes" not in stage.health.metrics()


def test_lockstep_does_not_count_an_answer_of_the_detector_as_one_of_a_map() -> None:
    stage = Stage(lockstep=True, ack_timeout_s=0.05)
    done = pb.Ack(service="detector", part="observation", accepted=True)

    def answer(frame: pb.Frame) -> None:
        done.id.CopyFrom(frame.id)
        stage.other.publish(DETECTOR_ACK, done)

    stage.other.subscribe(KEYFRAME, answer)
    stage.drive("a")
    assert "map2d/value" in stage.health.state[1]


def test_lockstep_names_the_map_part_that_does_not_answer() -> None:
    stage = Stage(lockstep=True, ack_timeout_s=0.05)
    stage.drive("a")
    state, reason = stage.health.state
    assert state == "degraded"
    assert "map2d/value" in reason


def test_the_state_names_the_last_executed_action() -> None:
    stage = Stage()
    assert stage.bridge.state().last_action_id == ""
    stage.drive("a")
    stage.drive("b")
    stage.drive("a")  # a repeated id: not executed again
    assert stage.bridge.state().last_action_id == "b"


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (pb.Action(forward=pb.Action.Forward(distance_m=1.01)), "takes at most 1 (max_forward_m)"),
        (pb.Action(forward=pb.Action.Forward(distance_m=1e6)), "forward.distance_m is 1e+06"),
        (pb.Action(forward=pb.Action.Forward(distance_m=-0.1)), "back by at most 0 m (max_back_m)"),
        (pb.Action(turn=pb.Action.Turn(angle_rad=0.6)), "turns by at most 0.5236 (max_turn_rad"),
        (pb.Action(turn=pb.Action.Turn(angle_rad=-50.0)), "turn.angle_rad is -50"),
    ],
)
def test_an_action_beyond_the_limits_of_the_robot_does_not_reach_its_driver(
    action: pb.Action, said: str
) -> None:
    stage = Stage()
    with pytest.raises(InvalidInput, match=re.escape(said)):
        stage.drive("a", action=action)
    assert not stage.robot.done


def test_the_time_that_a_call_has_waited_to_be_served_counts() -> None:
    stage = Stage()
    with arrived(time.monotonic() - 2.0), pytest.raises(DeadlineExceeded, match="was over"):
        stage.drive("a", left_s=1.0)
    assert not stage.robot.done
