"""Runs the driver contract suite of `helios_contract` on every robot driver of the project."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_contract.rig import Rig
from helios_contract.suite import DriverContract
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, ActionResult, Capture, Forward, Turn
from helios_core.topics import ROBOT_STATE
from helios_core.types import RobotState
from helios_core.zenoh_bus import ZenohBus
from helios_examples.arm_robot import ArmRobot
from helios_examples.room_robot import CAMERA, RoomRobot
from helios_replay.driver import ReplayDriver
from helios_sim.driver import SimDriver
from helios_sim.episode_tracker import episode_of
from helios_sim.home import PRESETS, generate_home
from helios_sim.service import WorldService
from helios_sim.simulation_thread import WorldThread
from helios_sim.world import World

from tests.bare_robot.processes import bare_robot, generate_messages
from tests.support import ENDS_WITHIN_S, free_port, wait_until


class TestExample(DriverContract):
    """The room robot of `helios_examples`."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        yield Rig(
            RoomRobot(),
            tolerance_m=0.01,
            tolerance_rad=0.01,
            depth_tolerance_m=0.02,
            started_again=lambda: closing(RoomRobot()),
        )


class TestExampleWithAnArm(DriverContract):
    """The arm robot of `helios_examples`."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        yield Rig(
            ArmRobot(),
            tolerance_m=0.01,
            tolerance_rad=0.01,
            depth_tolerance_m=0.02,
            started_again=lambda: closing(ArmRobot()),
        )


class TestSimulator(DriverContract):
    """The simulator's driver with a simulated world behind a bus."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        home = generate_home(0, PRESETS["demo-v1"])
        hub = MemoryHub()
        service = WorldService(
            MemoryBus(hub), WorldThread(lambda: World(home, episode_of(home, 0))), Health()
        )

        @contextmanager
        def away() -> Iterator[None]:
            servers, hub.servers = hub.servers, {}
            try:
                yield
            finally:
                hub.servers = servers

        with closing(service):
            yield Rig(SimDriver(MemoryBus(hub)), away=away)


class TestReplay(DriverContract):
    """The replay driver on a data set that the room robot's camera recorded."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        with TemporaryDirectory() as folder:
            record_folder(Path(folder), frames=60)
            yield Rig(ReplayDriver(Path(folder)), depth_tolerance_m=0.02)


class TestSpot(DriverContract):
    """Spot's driver with a fake Spot that speaks the real gRPC services over TLS."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        pytest.importorskip("bosdyn.client", reason="pip install 'helios-ovmm[spot]'")
        from tests.unit.spot.spot_stage import Stage

        # No faster: a stop has to arrive in the middle of a turn.
        with TemporaryDirectory() as folder, closing(Stage(Path(folder), hurry=2.0)) as stage:
            driver = stage.driver()

            @contextmanager
            def away() -> Iterator[None]:
                stage.cut(driver)
                try:
                    yield
                finally:
                    stage.mend(driver)

            yield Rig(driver, away=away)


class TestAnotherLanguage(DriverContract):
    """`--robot bus`: a robot process with bare messages behind a real router."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        router = f"tcp/127.0.0.1:{free_port()}"
        process = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", router])
        with TemporaryDirectory() as folder:
            try:
                generate_messages(Path(folder))
                wait_until(lambda: can_open(router), 60, "the router answers")
                with bare_robot(Path(folder), router), closing(ZenohBus(router)) as bus:
                    yield Rig(SimDriver(bus), tolerance_m=0.01, depth_tolerance_m=0.02)
            finally:
                process.terminate()
                process.wait(ENDS_WITHIN_S)


class DrivesOn(RoomRobot):
    """Applies a stop only after its action ends."""

    def __init__(self) -> None:
        super().__init__()
        self._heard = ""

    def state(self) -> RobotState:
        return replace(super().state(), stopped=bool(self._heard))

    def act(self, action: Action, action_id: str) -> ActionResult:
        if self._heard:
            super().stop(self._heard)
        return super().act(action, action_id)

    def stop(self, reason: str) -> None:
        self._heard = reason

    def clear_stop(self) -> None:
        self._heard = ""
        super().clear_stop()


class EndsLate(DrivesOn):
    """Also applies a stop late, and reports the finished action as refused."""

    def act(self, action: Action, action_id: str) -> ActionResult:
        result = super().act(action, action_id)
        return replace(result, succeeded=False, reason=self._heard) if self._heard else result


class TurnsOn(RoomRobot):
    """Ends the running action but not its motion."""

    def state(self) -> RobotState:
        if self._stopped.is_set():
            self._yaw_rad += 0.01
        return super().state()


@pytest.mark.parametrize("make", [DrivesOn, EndsLate, TurnsOn])
def test_a_driver_that_does_not_end_the_running_action_fails_the_contract(
    make: Callable[[], RoomRobot], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_contract.stop_claims.TRIES_S", 2.0)
    check = DriverContract().test_a_stop_from_another_thread_ends_the_action_that_runs
    check(Rig(RoomRobot()))  # the driver without the defect passes
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        check(Rig(make()))


class Forgetful(RoomRobot):
    """Cannot report its state while it is `broken`."""

    broken = False

    def state(self) -> RobotState:
        if self.broken:
            raise KeyError("odometry")
        return super().state()

    def capture(self) -> Capture:
        return replace(RoomRobot().capture(), stamp_ns=time.time_ns())


def test_the_bridge_reports_a_driver_that_cannot_read_its_state_and_keeps_streaming() -> None:
    hub, robot, health = MemoryHub(), Forgetful(), Health()
    reported: list[pb.RobotState] = []
    MemoryBus(hub).subscribe(ROBOT_STATE, reported.append)
    service = BridgeService(MemoryBus(hub), robot, Settings(stream_hz=50), health, first_number=0)
    service.start()
    with closing(service):
        robot.broken = True
        wait_until(lambda: "KeyError" in health.state[1], 60, "the bridge says so")
        robot.broken, before = False, len(reported)
        wait_until(lambda: len(reported) > before + 2, 60, "the stream goes on")
        wait_until(lambda: health.state[0] == "ready", 60, "the bridge is well again")


def can_open(router: str) -> bool:
    """Whether the router accepts a connection."""
    try:
        ZenohBus(router).close()
    except Unavailable:
        return False
    return True


def record_folder(folder: Path, frames: int) -> None:
    """Drive the room robot around and write its frames as a data set."""
    robot = RoomRobot()
    (folder / "frames").mkdir()
    header = "frame,t_s,r00,r01,r02,tx,r10,r11,r12,ty,r20,r21,r22,tz"
    lines = [header, *(_keep(folder, k, _next(robot, k)) for k in range(frames))]
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    meta = {
        "width": CAMERA.width,
        "height": CAMERA.height,
        "fx": CAMERA.fx,
        "fy": CAMERA.fy,
        "cx": CAMERA.cx,
        "cy": CAMERA.cy,
        "depth_scale_m": 0.001,
    }
    (folder / "meta.json").write_text(json.dumps(meta))


def _next(robot: RoomRobot, k: int) -> Capture:
    action = Forward(0.05) if k % 5 == 4 else Turn(0.05 if k % 10 < 5 else -0.05)
    robot.act(action, str(k))
    return robot.capture()


def _keep(folder: Path, k: int, c: Capture) -> str:
    depth_mm = np.rint(c.depth_m * 1000).astype(np.uint16)
    cv2.imwrite(str(folder / f"frames/{k:06d}.jpg"), c.color[..., ::-1])
    cv2.imwrite(str(folder / f"frames/{k:06d}.png"), depth_mm)
    return ",".join([str(k), str(k / 10), *(f"{v:.9f}" for v in c.T_world_cam[:3].ravel())])
