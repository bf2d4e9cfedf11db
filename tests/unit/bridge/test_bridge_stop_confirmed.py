"""A stop counts when the robot confirms it, is repeated until then, and outlives the bridge."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, Unavailable
from helios_core.topics import CLEAR_STOP, GET_STATE, ROBOT_STATE, STOP
from helios_core.types import RobotState

from tests.support import free_port, wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage
from tests.unit.bridge.test_bridge_hanging import Hanging


class Away(LineRobot):
    """Its stop fails while `away` is set."""

    away = True

    def stop(self, reason: str) -> None:
        if self.away:
            raise Unavailable("no answer from the robot")
        super().stop(reason)


class StopReturnsLater(LineRobot):
    """Its first stop fails; the second one stops the robot, and returns when `go_on` is set."""

    def __init__(self) -> None:
        super().__init__()
        self.calls, self.go_on = 0, threading.Event()

    def stop(self, reason: str) -> None:
        self.calls += 1
        if self.calls == 1:
            raise Unavailable("no answer from the robot")
        super().stop(reason)
        self.go_on.wait(30)


def stop(stage: Stage, error: type[HeliosError] | None) -> None:
    request = pb.StopRequest(reason="a child")
    if error is None:
        stage.other.call(STOP, request, 10)
        return
    with pytest.raises(error):
        stage.other.call(STOP, request, 10)


def test_a_robot_whose_stop_fails_is_not_told_as_stopped_until_a_repeated_stop_succeeds() -> None:
    robot = Away()
    stage = Stage(robot)
    stage.bridge.start()
    try:
        stop(stage, Unavailable)
        state = stage.other.call(GET_STATE, pb.Empty(), 5)
        assert not state.stopped
        assert "a child; the robot has not confirmed the stop" in state.message
        with pytest.raises(Conflict, match="a child"):
            stage.drive("a")
        robot.away = False
        wait_until(lambda: stage.bridge.state().stopped, 60, "the stop is repeated")
        assert stage.bridge.state().message == "a child"
        assert stage.robot.stopped == "a child"
        stage.other.call(CLEAR_STOP, pb.Empty(), 5)
        assert stage.drive("b").succeeded
    finally:
        stage.bridge.close()


def test_a_robot_whose_stop_hangs_is_not_told_as_stopped() -> None:
    robot = Hanging()
    stage = Stage(robot, stop_timeout_s=0.1)
    try:
        stop(stage, DeadlineExceeded)
        assert not stage.bridge.state().stopped
        assert "may still move" in stage.bridge.state().message
        robot.go_on.set()
        wait_until(lambda: stage.bridge.state().stopped, 60, "it is confirmed")
    finally:
        robot.go_on.set()
        stage.bridge.close()


class SlowState(LineRobot):
    """Its state returns when `go_on` is set, as it was when it was asked."""

    def __init__(self) -> None:
        super().__init__()
        self.asked, self.go_on = threading.Event(), threading.Event()

    def state(self) -> RobotState:
        state = super().state()
        if not self.asked.is_set():  # only the first one is slow
            self.asked.set()
            self.go_on.wait(30)
        return state


def test_a_confirmed_stop_is_answered_although_the_state_is_slow_and_the_state_follows() -> None:
    robot = SlowState()
    stage, told = Stage(robot, stop_timeout_s=5.0), list[pb.RobotState]()
    stage.other.subscribe(ROBOT_STATE, told.append)
    try:
        stop(stage, None)
        assert robot.stopped == "a child"
        assert robot.asked.wait(10)
        assert not told
        robot.go_on.set()
        wait_until(lambda: told and told[-1].stopped, 60, "the state is published")
    finally:
        robot.go_on.set()
        stage.bridge.close()


def test_a_slow_state_from_before_a_clear_does_not_follow_the_state_after_it() -> None:
    robot = SlowState()
    stage, told = Stage(robot), list[pb.RobotState]()
    stage.other.subscribe(ROBOT_STATE, told.append)
    try:
        stop(stage, None)
        assert robot.asked.wait(10)
        stage.other.call(CLEAR_STOP, pb.Empty(), 10)
        assert [state.stopped for state in told] == [False]
        robot.go_on.set()
        assert stage.bridge._executor.wait(10) == []
        assert [state.stopped for state in told] == [False]
    finally:
        robot.go_on.set()
        stage.bridge.close()


def test_a_clear_waits_for_a_stop_that_is_being_repeated() -> None:
    """The robot stands already, but its stop has not come back when the clear is asked for."""
    robot = StopReturnsLater()
    stage = Stage(robot)
    stop(stage, Unavailable)
    begin, errors = stage.bridge._executor.begin, list[HeliosError]()

    def clear() -> None:
        try:
            stage.other.call(CLEAR_STOP, pb.Empty(), 10)
        except HeliosError as error:
            errors.append(error)

    clearing = threading.Thread(target=clear)

    def begin_and_clear(name: str, do: Callable[[], None]) -> Future[None]:
        call = begin(name, do)
        if name == "stop":
            wait_until(lambda: bool(robot.stopped), 60, "the robot stands")
            clearing.start()
            clearing.join(0.2)  # it has to wait for this call
        return call

    stage.bridge._executor.begin = begin_and_clear
    try:
        stage.bridge._stopping.repeat()
        clearing.join(0.2)
        robot.go_on.set()
        clearing.join(60)
        assert not errors
        assert stage.drive("a").succeeded
    finally:
        robot.go_on.set()
        stage.bridge.close()


def test_a_later_stop_that_fails_leaves_a_confirmed_stop_confirmed() -> None:
    robot = Away()
    robot.away = False
    stage = Stage(robot)
    stop(stage, None)
    robot.away = True
    stop(stage, Unavailable)
    assert stage.bridge.state().stopped


def test_a_new_bridge_stops_the_robot_that_the_old_one_had_stopped(tmp_path: Path) -> None:
    old = Stage(state_dir=tmp_path / "bridge")
    stop(old, None)
    new = Stage(state_dir=tmp_path / "bridge")  # and a driver that knows of no stop
    with pytest.raises(Conflict, match="a child"):
        new.drive("a")
    new.bridge.start()
    try:
        wait_until(lambda: new.robot.stopped == "a child", 60, "the robot is stopped")
        wait_until(lambda: new.bridge.state().stopped, 60, "it is confirmed")
        new.other.call(CLEAR_STOP, pb.Empty(), 5)
        assert new.drive("b").succeeded
    finally:
        new.bridge.close()
    assert not Stage(state_dir=tmp_path / "bridge").bridge.state().message


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00"])
def test_an_unreadable_latch_is_a_stop(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "stopped.txt").write_bytes(content)
    with pytest.raises(Conflict, match="from before the restart"):
        Stage(state_dir=tmp_path).drive("a")


def test_a_stop_works_although_it_cannot_be_written_down(tmp_path: Path) -> None:
    (tmp_path / "bridge").write_text("a file in the folder's place")
    stage = Stage(state_dir=tmp_path / "bridge")
    stop(stage, None)
    assert stage.bridge.state().stopped
    stage.other.call(CLEAR_STOP, pb.Empty(), 5)
    assert stage.drive("a").succeeded


def test_a_killed_bridge_process_starts_stopped_again(tmp_path: Path) -> None:
    from helios_core.zenoh_bus import ZenohBus

    router = f"tcp/127.0.0.1:{free_port()}"
    argv = [
        sys.executable,
        "-m",
        "helios_bridge",
        "--router",
        router,
        "--state-dir",
        str(tmp_path),
        "--driver",
        "helios_examples.room_robot:RoomRobot",
    ]
    running = [
        subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", router]),
        subprocess.Popen(argv),
    ]
    bus: ZenohBus | None = None
    try:
        wait_until(lambda: _opens(router), 60, "the router answers")
        bus = ZenohBus(router)
        wait_until(lambda: _state(bus) is not None, 60, "the bridge answers")
        bus.call(STOP, pb.StopRequest(reason="a person"), 10)
        os.kill(running[1].pid, signal.SIGKILL)
        running[1].wait()
        running.append(subprocess.Popen(argv))
        wait_until(lambda: (s := _state(bus)) is not None and s.stopped, 60, "it is stopped")
    finally:
        if bus is not None:
            bus.close()
        for process in running:
            process.kill()
            process.wait()


def _opens(router: str) -> bool:
    from helios_core.zenoh_bus import ZenohBus

    try:
        ZenohBus(router).close()
    except Unavailable:
        return False
    return True


def _state(bus: Bus) -> pb.RobotState | None:
    try:
        return bus.call(GET_STATE, pb.Empty(), 5)
    except HeliosError:
        return None
