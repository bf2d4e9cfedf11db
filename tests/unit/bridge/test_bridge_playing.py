"""A recording as a robot: it plays when the maps are ready and reports skipped frames."""

from __future__ import annotations

from dataclasses import replace

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.robot import Capture
from helios_core.topics import (
    CONTEXT,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    ROBOT_STATE,
    status_topic,
)

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage


def test_a_recording_plays_when_the_maps_are_ready_and_reports_its_end() -> None:
    stage = Stage(LineRobot(frames=3))
    states: list[pb.RobotState] = []
    stage.other.subscribe(ROBOT_STATE, states.append)
    stage.bridge.start()
    stage.other.publish(CONTEXT, pb.SearchContext(id="c"))
    for service in ("detector", "objectmap"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    assert stage.keyframes == []
    stage.other.publish(status_topic("map2d"), pb.ServiceStatus(service="map2d", state="ready"))
    wait_until(lambda: states and states[-1].finished, 60, "the recording ends")
    assert len(stage.keyframes) == 3
    stage.bridge.close()


def test_a_fault_in_the_driver_of_a_recording_is_reported() -> None:
    class Failing(LineRobot):
        def capture(self) -> Capture:
            raise OverflowError("timeout value is too large")

    stage = Stage(Failing(frames=3), contexts=True)
    stage.bridge.start()
    for service in ("detector", "objectmap", "map2d"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    wait_until(lambda: stage.health.state[0] == "degraded", 60, "it is said")
    assert "OverflowError" in stage.health.state[1]
    stage.bridge.close()


class Scratched(LineRobot):
    """A recording of four frames, of which the second and third cannot be read."""

    def capture(self) -> Capture:
        out = super().capture()
        if self.left in (1, 2):
            raise InvalidInput(f"frame {4 - self.left} is no image")
        return out


def play_scratched_recording(**settings: object) -> Stage:
    stage = Stage(Scratched(frames=4), contexts=True, **settings)
    stage.bridge.start()
    for service in ("detector", "objectmap", "map2d"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    return stage


def test_unreadable_frames_are_skipped_counted_and_reported() -> None:
    stage = play_scratched_recording()
    wait_until(lambda: stage.bridge.state().finished, 60, "the recording ends")
    said = "some frames were left out, the last: frame 3 is no image"
    wait_until(lambda: stage.health.state[1] == said, 60, "it is said")
    assert stage.health.state[0] == "ready"
    assert len(stage.keyframes) == 2
    assert stage.health.metrics()["unreadable_frames"] == 2
    stage.bridge.close()


def test_a_strict_replay_ends_at_an_unreadable_frame() -> None:
    stage = play_scratched_recording(strict=True)
    wait_until(lambda: stage.health.state[0] == "degraded", 60, "it is said")
    assert "frame 2 is no image" in stage.health.state[1]
    assert len(stage.keyframes) == 1
    stage.bridge.close()


class LateSearch(LineRobot):
    """A recording of four keyframes: its search begins with the third."""

    def capture(self) -> Capture:
        return replace(super().capture(), searching=(self.left or 0) < 2)


def test_detections_are_not_waited_for_before_the_first_search() -> None:
    stage = Stage(LateSearch(frames=4), contexts=True, lockstep=True, ack_timeout_s=60.0)

    def answer(parts: list[tuple[str, str]], message: pb.Frame) -> None:
        for service, part in parts:
            topic = MAP2D_ACK if service == "map2d" else OBJECTMAP_ACK
            ack = pb.Ack(service=service, part=part, id=message.id, accepted=True)
            stage.other.publish(topic, ack)

    stage.other.subscribe(KEYFRAME, lambda m: answer([("map2d", "occupancy")], m))
    stage.bridge.start()
    for service in ("detector", "objectmap", "map2d"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    wait_until(lambda: len(stage.keyframes) == 3, 60, "the search begins")
    wait_until(
        lambda: "waits for map2d/value, objectmap/objects" in stage.health.state[1], 60, "it waits"
    )
    assert len(stage.keyframes) == 3
    assert stage.health.metrics()["keyframes_before_search"] == 2
    rest = [("map2d", "value"), ("objectmap", "objects")]
    stage.other.subscribe(KEYFRAME, lambda m: answer(rest, m))
    answer(rest, stage.keyframes[-1])
    wait_until(lambda: stage.bridge.state().finished, 60, "the recording ends")
    stage.bridge.close()


def test_a_recording_does_not_wait_for_a_degraded_service() -> None:
    stage = Stage(LineRobot(frames=3), contexts=True)
    stage.bridge.start()
    for service, state in (("detector", "degraded"), ("objectmap", "ready"), ("map2d", "ready")):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state=state))
    wait_until(lambda: stage.bridge.state().finished, 60, "the recording ends")
    stage.bridge.close()
