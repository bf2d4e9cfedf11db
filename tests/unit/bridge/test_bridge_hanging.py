"""A driver call that hangs is reported within a deadline, and the bridge can still end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_bridge.driver_executor import DriverExecutor
from helios_core import proto as pb
from helios_core.errors import Conflict, DeadlineExceeded, Unavailable
from helios_core.keyframe_acks import KeyframeAcks, MapPart, full_names
from helios_core.topics import CLEAR_STOP, FRAME, STOP, status_topic
from helios_core.types import FrameId

from tests.support import free_port, wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage


class Hanging(LineRobot):
    """Its stop returns when `go_on` is set."""

    def __init__(self) -> None:
        super().__init__()
        self.go_on, self.stops = threading.Event(), 0

    def stop(self, reason: str) -> None:
        self.stops += 1
        self.go_on.wait(30)
        super().stop(reason)


@pytest.fixture
def stage() -> Iterator[Stage]:
    robot = Hanging()
    out = Stage(robot, stop_timeout_s=0.1)
    yield out
    robot.go_on.set()
    out.bridge.close()


def stop(stage: Stage) -> None:
    stage.other.call(STOP, pb.StopRequest(reason="a person"), 10)


def test_a_hanging_stop_is_reported_and_no_action_starts(stage: Stage) -> None:
    with pytest.raises(DeadlineExceeded, match="may still move: use its own emergency stop"):
        stop(stage)
    assert "emergency stop" in stage.health.state[1]
    with pytest.raises(Conflict, match="a person"):
        stage.drive("a")
    assert stage.robot.done == []


def test_stream_frames_do_not_hide_a_hanging_stop() -> None:
    robot = Hanging()
    stage = Stage(robot, stop_timeout_s=0.1, stream_hz=30.0, lockstep=False)
    try:
        stage.bridge.start()
        with pytest.raises(DeadlineExceeded):
            stop(stage)
        streamed: list[pb.Frame] = []
        stage.other.subscribe(FRAME, streamed.append)
        wait_until(lambda: len(streamed) > 3, 60, "the stream goes on")
        assert stage.health.state[0] == "degraded"
        assert "emergency stop" in stage.health.state[1]
        robot.go_on.set()
        wait_until(lambda: stage.health.state[0] == "ready", 60, "it comes back")
    finally:
        robot.go_on.set()
        stage.bridge.close()


def test_further_stops_do_not_call_the_driver_while_a_stop_hangs(stage: Stage) -> None:
    for _ in range(3):
        with pytest.raises(DeadlineExceeded):
            stop(stage)
    assert isinstance(stage.robot, Hanging)
    assert stage.robot.stops == 1


def test_a_hanging_stop_cannot_be_cleared_until_the_driver_returns(stage: Stage) -> None:
    with pytest.raises(DeadlineExceeded):
        stop(stage)
    with pytest.raises(Conflict, match="has not come back"):
        stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    assert isinstance(stage.robot, Hanging)
    stage.robot.go_on.set()
    wait_until(lambda: stage.health.state[0] != "degraded", 60, "it comes back")
    wait_until(lambda: not stage.bridge._stopping._stop_hangs(), 60, "it is over")
    assert stage.bridge.state().stopped
    stage.other.call(CLEAR_STOP, pb.Empty(), 1)
    assert stage.drive("a").succeeded


def test_a_failed_stop_is_reported_with_its_reason() -> None:
    class Away(LineRobot):
        def stop(self, reason: str) -> None:
            raise Unavailable("no answer from the robot")

    stage = Stage(Away())
    with pytest.raises(Unavailable, match="no answer from the robot"):
        stop(stage)
    with pytest.raises(Conflict):
        stage.drive("a")


def test_closing_names_the_hanging_call_and_does_not_wait_for_its_end() -> None:
    never = threading.Event()

    class Stubborn(LineRobot):
        def close(self) -> None:
            never.wait(30)

    stage = Stage(Stubborn())
    assert stage.bridge.close() == ["close"]
    never.set()


def test_ending_the_acks_ends_the_wait_for_the_maps() -> None:
    acks, executor = KeyframeAcks(), DriverExecutor()

    def wait() -> None:
        acks.wait(FrameId("a", 0, 1), full_names(MapPart), 60.0)

    executor.start("wait", wait)
    assert executor.wait(0.05) == ["wait"]
    acks.end()
    assert executor.wait(5.0) == []


DRIVER = """
import time
from helios_examples.room_robot import RoomRobot
class Stubborn(RoomRobot):
    def stop(self, reason):
        time.sleep(1000)
    def close(self):
        time.sleep(1000)
"""


def test_the_process_ends_although_the_driver_hangs(tmp_path: Path) -> None:
    from helios_core.zenoh_bus import ZenohBus

    (tmp_path / "stubborn_robot.py").write_text(DRIVER)
    router = f"tcp/127.0.0.1:{free_port()}"
    routing = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", router])
    log = tmp_path / "bridge.log"
    with log.open("wb") as out:
        bridge = subprocess.Popen(
            [sys.executable, "-m", "helios_bridge", "--router", router,
             "--driver", "stubborn_robot:Stubborn", "--stop-timeout-s", "0.2"],
            env=os.environ | {"PYTHONPATH": str(tmp_path)}, stderr=out,
        )  # fmt: skip
    try:
        wait_until(lambda: "ready" in log.read_text(), 60, "the bridge is ready")
        bus = ZenohBus(router)
        with pytest.raises(DeadlineExceeded, match="emergency stop"):
            bus.call(STOP, pb.StopRequest(reason="a person"), 10)
        bus.close()
        bridge.send_signal(signal.SIGTERM)
        assert bridge.wait(20) == 1
    finally:
        for process in (bridge, routing):
            process.kill()
            process.wait()
    said = log.read_text()
    assert "abandoned" in said
    assert "FATAL" not in said


def test_a_waiting_keyframe_names_its_map_and_closing_counts_no_unanswered_keyframe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("helios_bridge.frame_publisher.SAY_WAITING_S", 0.05)
    stage = Stage(LineRobot(frames=3), contexts=True, lockstep=True, ack_timeout_s=60.0)
    stage.bridge.start()
    for service in ("detector", "objectmap", "map2d"):
        stage.other.publish(status_topic(service), pb.ServiceStatus(service=service, state="ready"))
    wait_until(lambda: "waits for map2d/occupancy" in stage.health.state[1], 60, "it is said")
    assert stage.health.state[0] == "ready"
    assert stage.bridge.close() == []
    assert "unanswered_keyframes" not in stage.health.metrics()
    assert stage.health.state[0] == "ready"
