"""`helios up --robot spot` at a fake Spot: it gets ready, and its death leaves no robot walking."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip("bosdyn.client", reason="pip install 'helios-ovmm[spot]'")

from helios_client.commands.status import find_status
from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_core.codec import state_from_proto
from helios_core.errors import HeliosError
from helios_core.topics import ACT, GET_STATE, LEASE
from helios_core.zenoh_bus import ZenohBus

from tests.fake_spot.rooms import tea_room
from tests.fake_spot.server import PASSWORD, FakeSpot
from tests.fake_spot.world import World
from tests.support import free_port, wait_until


@dataclass
class Up:
    """A running `helios up` and the robot that it drives."""

    fake: FakeSpot
    process: subprocess.Popen[bytes]
    port: int
    router: str
    state: Path

    def bridge(self) -> dict[str, Any]:
        """As `helios status` finds it; empty before it is known."""
        with Helios(f"http://127.0.0.1:{self.port}", 3.0) as helios:
            try:
                services = find_status(helios, self.port, self.state)["services"]
            except HeliosError:
                return {}
        return next((dict(s) for s in services if s["name"] == "bridge"), {})

    def bridge_is(self, state: str) -> bool:
        return self.bridge().get("state") == state


@pytest.fixture
def fake(tmp_path: Path) -> Iterator[FakeSpot]:
    fake = FakeSpot(tmp_path, World(*tea_room()))
    yield fake
    fake.close()


def start(fake: FakeSpot, folder: Path, **environment: str) -> Up:
    port, router_port = free_port(), free_port()
    env = fake.environment | environment
    del env["HELIOS_SPOT_HOST"]  # a flag names it
    process = subprocess.Popen(
        [sys.executable, "-m", "helios_client", "up", "--robot", "spot",
         "--spot-host", "127.0.0.1", "--detector", "ground-truth", "--port", str(port),
         "--router-port", str(router_port), "--state", str(folder / "state")],
        env=os.environ | env | {"XDG_STATE_HOME": str(folder / "home")},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return Up(fake, process, port, f"tcp/127.0.0.1:{router_port}", folder / "state")


@pytest.fixture
def up(fake: FakeSpot, tmp_path: Path) -> Iterator[Up]:
    up = start(fake, tmp_path)
    yield up
    end(up)


def end(up: Up) -> None:
    up.process.send_signal(signal.SIGINT)
    try:
        up.process.wait(20)
    finally:
        up.process.kill()


def test_a_bridge_that_is_killed_leaves_no_robot_walking_and_its_successor_goes_on(up: Up) -> None:
    wait_until(lambda: up.bridge_is("ready"), 60, "the bridge is ready")
    pid = up.bridge()["pid"]
    assert PASSWORD not in " ".join(psutil.Process(pid).cmdline())
    bus = ZenohBus(up.router, "robot")
    world = up.fake.world

    def act(id: str, action: pb.Action) -> pb.ActionResult:
        token = bus.call(LEASE, pb.LeaseRequest(holder="a test", take=True), 5).token
        request = pb.ActionRequest(
            action_id=id, lease_token=token, time_remaining_s=30, action=action
        )
        return bus.call(ACT, request, 35)

    try:
        assert act("get up", pb.Action(observe=pb.Action.Observe())).succeeded
        forward = pb.Action(forward=pb.Action.Forward(distance_m=1.0))
        threading.Thread(target=lambda: _ignore(lambda: act("walk", forward)), daemon=True).start()
        wait_until(lambda: world.moving, 10, "the robot walks")
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: not world.moving, 3, "the robot stands still")
        assert "halt: the command ended" in world.log
        wait_until(
            lambda: up.bridge().get("pid") != pid and up.bridge_is("ready"), 60, "it is back"
        )
        assert state_from_proto(bus.call(GET_STATE, pb.Empty(), 5)).robot_boot_id
        turn = pb.Action(turn=pb.Action.Turn(angle_rad=0.3))
        wait_until(
            lambda: _ignore(lambda: act("turn", turn).succeeded), 20, "the robot turns again"
        )
    finally:
        bus.close()
    end(up)
    assert world.lease_owner == ""  # given back in an orderly end


def test_a_wrong_password_is_shown_and_not_tried_again(fake: FakeSpot, tmp_path: Path) -> None:
    up = start(fake, tmp_path, HELIOS_SPOT_PASSWORD="guess")
    try:
        wait_until(lambda: up.bridge_is("degraded"), 60, "the bridge says what is wrong")
        assert "HELIOS_SPOT_PASSWORD" in up.bridge()["reason"]
        assert not fake.world.motors
    finally:
        end(up)


def _ignore(do: Any) -> Any:
    try:
        return do()
    except HeliosError:
        return None
