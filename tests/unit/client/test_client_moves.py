"""`helios go`, `explore` and `home`, and the same moves from Python and over MCP."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from helios_client.cli import run
from helios_client.mcp_server import build
from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios
from mcp import Client

from tests.gateway_process import Served, served
from tests.support import wait_until

TASK = {
    "id": "t1",
    "state": "queued",
    "kind": "go_to_point",
    "point": {"x_m": 3.2, "y_m": -4.1, "yaw_rad": None},
}


@pytest.fixture
def gateway(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with served() as gateway:
        yield gateway


def run_without_waiting(gateway: Served, *args: str) -> int:
    return run([*args, "--no-wait", "--port", str(gateway.port)])


# --- the command line ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (["go", "3.2", "4.1"], "go to 3.2, 4.1"),
        (["go", "-3.2", "-4.1", "-90"], "go to -3.2, -4.1 facing -90 degrees"),
        (["go", "-0", "0.5", "270"], "go to 0, 0.5 facing -90 degrees"),
        (["go", "1e-9", "2"], "go to 0, 2"),
        (["explore"], "explore the home"),
        (["home"], "return to the start"),
    ],
)
def test_each_move_command_submits_its_instruction(
    args: list[str], sentence: str, gateway: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_without_waiting(gateway, *args) == 0
    assert capsys.readouterr().out == "t1\n"
    assert gateway.backend.tasks["t1"].instruction == sentence


def test_an_exploration_accepts_a_time_limit(gateway: Served) -> None:
    assert run_without_waiting(gateway, "explore", "--time-limit-s", "90") == 0
    assert gateway.backend.tasks["t1"].time_limit_s == 90


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["go"], "Missing argument"),
        (["go", "1"], "Missing argument"),
        (["go", "here", "1"], "helios go --help"),
        (["go", "1", "2", "--prot", "80"], "helios go --help"),
        (["go", "1", "2", "3", "4"], "unexpected extra argument"),
        (["go", "nan", "1"], "X is nan; wanted a number"),
        (["go", "1", "-inf"], "Y is -inf; wanted a number"),
        (["go", "1", "99999"], "y_m is 99999.0; wanted less than or equal to 10000"),
        (["explore", "--time-limit-s", "0"], "helios explore --help"),
    ],
)
def test_invalid_arguments_are_a_usage_error(
    args: list[str], says: str, gateway: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_without_waiting(gateway, *args) == 2
    assert says.lower() in capsys.readouterr().err.lower()
    assert gateway.backend.tasks == {}


@pytest.mark.parametrize(("state", "status"), [("succeeded", 0), ("failed", 1), ("cancelled", 1)])
def test_the_exit_status_is_0_only_if_the_task_succeeds(
    state: str, status: int, gateway: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    def end() -> None:
        wait_until(lambda: "t1" in gateway.backend.tasks, 60, "it is submitted")
        gateway.backend.change_task("t1", state, message="stands at (3.20, 4.10) m")

    ending = threading.Thread(target=end)
    ending.start()
    assert run(["go", "3.2", "4.1", "--port", str(gateway.port), "--json"]) == status
    ending.join()
    said = capsys.readouterr()
    assert json.loads(said.out)["state"] == state
    assert "stands at (3.20, 4.10) m" in said.err


# --- from Python --------------------------------------------------------------------------------
def record_request(request: httpx.Request, seen: list[tuple[str, Any]]) -> httpx.Response:
    seen.append((request.url.path, json.loads(request.content) if request.content else None))
    return httpx.Response(202, json=TASK)


CALLS = [
    ("/v1/robot/go", {"x_m": 3.2, "y_m": -4.1}),
    ("/v1/robot/go", {"x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.0}),
    ("/v1/robot/explore", {}),
    ("/v1/robot/explore", {"time_limit_s": 9.0}),
    ("/v1/robot/home", None),
]


def test_the_sdk_posts_each_move_to_its_address() -> None:
    seen: list[tuple[str, Any]] = []
    helios = Helios(transport=httpx.MockTransport(lambda request: record_request(request, seen)))
    task = helios.go(3.2, -4.1)
    assert (task.kind, task.point) == ("go_to_point", TASK["point"])
    helios.go(0.0, 0.0, yaw_rad=0.0)
    helios.explore()
    helios.explore(time_limit_s=9.0)
    helios.home()
    assert seen == CALLS


def test_the_asynchronous_sdk_posts_the_same_requests() -> None:
    seen: list[tuple[str, Any]] = []

    async def act() -> None:
        transport = httpx.MockTransport(lambda request: record_request(request, seen))
        async with AsyncHelios(transport=transport) as helios:
            await helios.go(3.2, -4.1)
            await helios.go(0.0, 0.0, yaw_rad=0.0)
            await helios.explore()
            await helios.explore(time_limit_s=9.0)
            assert (await helios.home()).id == "t1"

    asyncio.run(act())
    assert seen == CALLS


# --- over MCP -----------------------------------------------------------------------------------
def test_an_agent_submits_go_explore_and_home_tasks() -> None:
    async def act() -> None:
        with served() as gateway:
            async with AsyncHelios(gateway.url) as helios, Client(build(helios)) as client:
                await client.call_tool("go_to_point", {"x_m": 1, "y_m": -2, "yaw_deg": 90})
                await client.call_tool("explore", {"time_limit_s": 30})
                await client.call_tool("go_home", {})
                wrong = await client.call_tool("go_to_point", {"x_m": 1e6, "y_m": 0})
            assert wrong.is_error
            assert "less than or equal to 10000" in str(wrong.content)
            reported = [t.instruction for t in gateway.backend.tasks.values()]
            assert reported == [
                "go to 1, -2 facing 90 degrees",
                "explore the home",
                "return to the start",
            ]
            assert gateway.backend.tasks["t2"].time_limit_s == 30

    asyncio.run(act())
