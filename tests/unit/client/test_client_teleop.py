"""Teleoperation from Python and by a language agent, over a real gateway."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator

import pytest
from helios_client.http.teleop import TeleopState
from helios_client.mcp_server import build
from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios
from helios_core.errors import Conflict, InvalidInput, Unavailable
from mcp import Client
from mcp.types import TextContent

from tests.gateway_process import Served, served
from tests.support import free_port, wait_until

INSTRUCTION = "move the mug to the kitchen counter"


@pytest.fixture
def gateway() -> Iterator[Served]:
    with served() as gateway:
        yield gateway


@pytest.fixture
def helios(gateway: Served) -> Iterator[Helios]:
    with Helios(gateway.url) as helios:
        yield helios


def test_a_held_command_drives_the_robot_until_it_is_released(
    gateway: Served, helios: Helios
) -> None:
    driving = gateway.backend.driving
    with helios.teleop() as drive:
        state = drive(forward=1.0, for_s=0.3)
        assert state.state in ("driving", "standing")
        wait_until(lambda: driving.kinds()[-1:] == ["observe"], 60, "it stands, with a keyframe")
        wait_until(lambda: drive(forward=1.0, for_s=0.3) and driving.x_m >= 0.2, 60, "it drives")
        drive(turn=-1.0)
        wait_until(lambda: driving.yaw_rad < 0, 60, "it turns right")
    wait_until(lambda: driving.kinds()[-1] == "observe", 60, "it is given back")


def test_the_asynchronous_sdk_drives_the_robot(gateway: Served) -> None:
    async def run() -> None:
        async with AsyncHelios(gateway.url) as helios:
            async with helios.teleop() as drive:
                while gateway.backend.driving.x_m < 0.1:
                    await drive(forward=1.0, for_s=0.5)
            made = await helios.drive(turn_rad=0.2)
            assert made["turned_rad"] == pytest.approx(0.2)

    asyncio.run(run())
    assert gateway.backend.driving.x_m >= 0.1


def test_teleop_during_a_task_is_refused_on_entry(gateway: Served, helios: Helios) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.change_task("t1", "running")
    with pytest.raises(Conflict, match="task t1 is running"), helios.teleop():
        pass
    with pytest.raises(Conflict, match="task t1 is running"):
        helios.drive(forward_m=0.2)


def test_a_stop_ends_teleop_with_its_reason(gateway: Served, helios: Helios) -> None:
    with helios.teleop() as drive:
        drive(forward=1.0, for_s=0.2)
        helios.stop_robot("child on the floor")
        with pytest.raises(Conflict, match="child on the floor"):
            drive(forward=1.0, for_s=20)


@pytest.mark.parametrize("wrong", [{"forward": 1.5}, {"turn": -2}, {"forward": float("nan")}])
def test_an_invalid_command_is_reported_at_once_and_not_sent(
    gateway: Served, helios: Helios, wrong: dict[str, float]
) -> None:
    with helios.teleop() as drive, pytest.raises(InvalidInput, match="-1 to 1"):
        drive(**wrong, for_s=20)
    assert gateway.backend.driving.moves == []
    with helios.teleop() as drive, pytest.raises(InvalidInput, match="0 or more"):
        drive(forward=1.0, for_s=-1.0)


def test_a_refusal_by_the_gateway_raises_the_error_of_its_kind() -> None:
    def refused(**more: str) -> str:
        return json.dumps(
            {"state": "refused", "reason": "the command is wrong", "pose": None, **more}
        )

    with pytest.raises(InvalidInput):
        TeleopState.from_json(refused(kind="invalid"))
    for earlier in ({}, {"kind": "conflict"}):
        with pytest.raises(Conflict):
            TeleopState.from_json(refused(**earlier))


def test_a_move_beyond_the_robot_limits_is_invalid_even_during_a_task(
    gateway: Served, helios: Helios
) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.change_task("t1", "running")
    for wrong in (
        {"forward_m": 3.0},
        {"forward_m": float("nan")},
        {"turn_rad": 0.5, "forward_m": 0.1},
    ):
        with pytest.raises(InvalidInput):
            helios.drive(**wrong)
    with pytest.raises(InvalidInput, match="never drives back"):
        helios.drive(forward_m=-0.2)


def test_teleop_without_a_gateway_reports_how_to_start_one() -> None:
    with (
        Helios(f"http://127.0.0.1:{free_port()}") as helios,
        pytest.raises(Unavailable, match="helios up"),
        helios.teleop(),
    ):
        pass


def test_a_move_without_an_amount_is_refused(helios: Helios) -> None:
    with pytest.raises(InvalidInput, match="send one of them"):
        helios.drive()


def test_an_agent_makes_one_short_move(gateway: Served) -> None:
    async def run() -> None:
        async with AsyncHelios(gateway.url) as helios, Client(build(helios)) as client:
            made = await client.call_tool("drive", {"forward_m": 0.3})
            [content] = made.content
            assert isinstance(content, TextContent)
            assert json.loads(content.text)["moved_m"] == pytest.approx(0.3)
            assert (await client.call_tool("drive", {"forward_m": 3.0})).is_error

    asyncio.run(run())
