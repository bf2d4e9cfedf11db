"""The bridge tries again after an error of the robot's description, except after invalid input."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_bridge import __main__ as bridge_main
from helios_bridge.driver_executor import DriverExecutor
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    Internal,
    InvalidInput,
    Unavailable,
)
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CLEAR_STOP, GET_STATE, STOP
from helios_core.types import RobotDescription

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot


class Awkward(LineRobot):
    """Its description raises `wrong`, unless that is None."""

    wrong: Exception | None = None
    asked = closed = 0
    why = ""  # reason of its stop

    def stop(self, reason: str) -> None:
        Awkward.why = reason

    def clear_stop(self) -> None:
        Awkward.why = ""

    def describe(self) -> RobotDescription:
        Awkward.asked += 1
        if Awkward.wrong is not None:
            raise Awkward.wrong
        return super().describe()

    def close(self) -> None:
        Awkward.closed += 1


class Rig:
    """Host of a bridge with the awkward robot, and a client."""

    def __init__(self, state_dir: Path) -> None:
        hub = MemoryHub()
        self.bus, self.health = MemoryBus(hub), Health()
        settings = Settings(driver=f"{__name__}:Awkward", stream_hz=0.0, state_dir=state_dir)
        self.host = bridge_main.RobotHost(MemoryBus(hub), self.health, settings, DriverExecutor())


@pytest.fixture
def rig(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Rig]:
    monkeypatch.setattr(bridge_main, "FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(bridge_main, "LONGEST_PAUSE_S", 0.08)
    Awkward.wrong, Awkward.asked, Awkward.closed, Awkward.why = request.param, 0, 0, ""
    rig = Rig(tmp_path)
    yield rig
    rig.host.close()


@pytest.mark.parametrize(
    ("rig", "state", "said"),
    [
        (Unavailable("no link"), "waiting", "the robot cannot be reached: no link"),
        (
            DeadlineExceeded("0.5 s"),
            "waiting",
            "the robot answers too late: 0.5 s; the bridge tries again",
        ),
        (Conflict("taken"), "degraded", "taken; the bridge tries again in "),
        (Internal("a fault"), "degraded", "a fault; the bridge tries again in "),
        (KeyError("motor 3"), "degraded", "KeyError: 'motor 3'; `helios logs bridge` shows where;"),
    ],
    indirect=["rig"],
)
def test_a_robot_that_recovers_from_an_error_of_its_description_becomes_ready(
    rig: Rig, state: str, said: str
) -> None:
    wait_until(lambda: said in rig.health.state[1], 60, "the health tells the error")
    assert rig.health.state[0] == state
    wait_until(lambda: Awkward.asked > 3, 60, "it is asked again and again")
    Awkward.wrong = None
    wait_until(lambda: rig.health.state[0] == "ready", 60, "the bridge is ready")
    assert not rig.bus.call(GET_STATE, pb.Empty(), 5).stopped


SILENT = pytest.mark.parametrize("rig", [Unavailable("no image")], indirect=True)


@SILENT
def test_a_robot_without_a_description_is_stopped_and_cleared(rig: Rig) -> None:
    rig.bus.call(STOP, pb.StopRequest(reason="a child"), 5)
    assert Awkward.why == "a child"
    rig.bus.call(CLEAR_STOP, pb.Empty(), 5)
    assert not Awkward.why


@SILENT
def test_a_stop_before_the_description_still_holds_after_it(rig: Rig) -> None:
    rig.bus.call(STOP, pb.StopRequest(reason="a child"), 5)
    Awkward.wrong = None
    wait_until(lambda: rig.health.state[0] == "ready", 60, "the bridge is ready")
    assert rig.bus.call(GET_STATE, pb.Empty(), 5).message == "a child"


@SILENT
def test_a_kept_stop_reaches_a_robot_without_a_description(rig: Rig, tmp_path: Path) -> None:
    rig.bus.call(STOP, pb.StopRequest(reason="a child"), 5)
    rig.host.close()
    Awkward.why = ""
    following = Rig(tmp_path).host
    wait_until(lambda: Awkward.why == "a child", 60, "the next bridge stops the robot")
    following.close()


@pytest.mark.parametrize("rig", [InvalidInput("height_m nan")], indirect=True)
def test_invalid_input_of_a_robot_is_told_and_not_asked_for_again(rig: Rig) -> None:
    wait_until(lambda: rig.health.state == ("degraded", "height_m nan"), 60, "it is told")
    assert rig.host._executor.wait(10) == []
    assert Awkward.asked == 1


@pytest.mark.parametrize("rig", [Internal("a fault")], indirect=True)
def test_the_pause_before_the_next_attempt_grows(rig: Rig) -> None:
    wait_until(lambda: "again in 0.08 s" in rig.health.state[1], 60, "the pause has grown")


@pytest.mark.parametrize(
    "rig", [InvalidInput("height_m nan"), Internal("a fault"), None], indirect=True
)
def test_the_driver_is_closed_once_whether_the_bridge_was_created_or_not(rig: Rig) -> None:
    state = "ready" if Awkward.wrong is None else "degraded"
    wait_until(lambda: rig.health.state[0] == state, 60, "it was asked")
    rig.host.close()
    assert Awkward.closed == 1
