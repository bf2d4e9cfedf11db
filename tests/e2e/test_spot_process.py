"""Tests `helios up --robot spot` with a fake Spot: it gets ready; it halts when the bridge dies."""

from __future__ import annotations

import itertools
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
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
from tests.helios_up import Up, helios_up
from tests.support import wait_until


class SpotUp(Up):
    """A running `helios up` that drives a fake Spot."""

    def bridge(self) -> dict[str, Any]:
        """The bridge as `helios status` reports it; empty before the status is known."""
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


@contextmanager
def spot_up(fake: FakeSpot, folder: Path, **environment: str) -> Iterator[SpotUp]:
    env = fake.environment | environment | {"XDG_STATE_HOME": str(folder / "home")}
    env["HELIOS_SPOT_RPC_TIMEOUT_S"] = "30"
    del env["HELIOS_SPOT_HOST"]  # the flag names the host
    flags = ("--robot", "spot", "--spot-host", "127.0.0.1", "--detector", "ground-truth")
    with helios_up(folder / "state", *flags, kind=SpotUp, environment=env) as up:
        yield up


def test_a_killed_bridge_leaves_no_robot_walking_and_the_restarted_one_drives(
    fake: FakeSpot, tmp_path: Path
) -> None:
    world = fake.world
    with spot_up(fake, tmp_path) as up:
        wait_until(lambda: up.bridge_is("ready"), 60, "the bridge is ready")
        pid = up.bridge()["pid"]
        assert PASSWORD not in " ".join(psutil.Process(pid).cmdline())
        with closing(ZenohBus(up.router, "robot")) as bus:
            assert act(bus, "get up", pb.Action(observe=pb.Action.Observe())).succeeded
            forward = pb.Action(forward=pb.Action.Forward(distance_m=1.0))
            walk = threading.Thread(
                target=lambda: _ignore(lambda: act(bus, "walk", forward)), daemon=True
            )
            walk.start()
            wait_until(lambda: world.moving, 60, "the robot walks")
            os.kill(pid, signal.SIGKILL)
            wait_until(lambda: not world.moving, 60, "the robot stands still")
            assert "halt: the command ended" in world.log
            wait_until(
                lambda: up.bridge().get("pid") != pid and up.bridge_is("ready"), 60, "it is back"
            )
            assert state_from_proto(bus.call(GET_STATE, pb.Empty(), 5)).robot_boot_id
            turn = pb.Action(turn=pb.Action.Turn(angle_rad=0.3))
            ids = (f"turn {n}" for n in itertools.count())  # a failed action never runs again
            wait_until(
                lambda: _ignore(lambda: act(bus, next(ids), turn).succeeded),
                60,
                "the robot turns again",
            )
    assert world.lease_owner == ""  # an orderly end returns the lease


def test_a_wrong_password_degrades_the_bridge_with_the_reason(
    fake: FakeSpot, tmp_path: Path
) -> None:
    with spot_up(fake, tmp_path, HELIOS_SPOT_PASSWORD="guess") as up:
        wait_until(lambda: up.bridge_is("degraded"), 60, "the bridge says what is wrong")
        assert "HELIOS_SPOT_PASSWORD" in up.bridge()["reason"]
        assert not fake.world.motors


def act(bus: ZenohBus, id: str, action: pb.Action) -> pb.ActionResult:
    """Raises HeliosError."""
    token = bus.call(LEASE, pb.LeaseRequest(holder="a test", take=True), 5).token
    request = pb.ActionRequest(action_id=id, lease_token=token, time_remaining_s=30, action=action)
    return bus.call(ACT, request, 35)


def _ignore(do: Any) -> Any:
    try:
        return do()
    except HeliosError:
        return None
