"""`/v1/fleet` over a running gateway with two fake robots, and `helios` with `--robot any`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from helios_client.answer_types import FleetTask
from helios_client.sdk import Helios
from helios_client.supervision import state_file
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryHub

from tests.client_command import Helios as Command
from tests.gateway_backend import Backend
from tests.gateway_process import Served, served
from tests.support import wait_until

INSTRUCTION = "Move the mug from the coffee table to the kitchen counter"


class Fleet:
    """A gateway with the robots `robot` and `second`."""

    def __init__(self, gateway: Served, second: Backend) -> None:
        self.gateway, self.first, self.second = gateway, gateway.backend, second
        self.sdk = Helios(gateway.url)

    def robots(self) -> dict[str, Any]:
        return {robot["name"]: robot for robot in self.sdk.fleet()["robots"]}

    def has(self, id: str, robot: str) -> bool:
        task = self.sdk.fleet_task(id)
        return task.robot == robot and task.begun


def started(hub: MemoryHub, name: str) -> Backend:
    backend = Backend(hub, name)
    backend.start()
    return backend


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    hub = MemoryHub()
    first, second = started(hub, "robot"), started(hub, "second")
    first.alive("gateway", 4199)
    queue = str(tmp_path / "fleet.sqlite")
    with served("--robots", "second", "--fleet-queue", queue, backend=first) as gateway:
        fleet = Fleet(gateway, second)
        wait_until(
            lambda: {r["state"] for r in fleet.robots().values()} == {"idle"}, 60, "both are idle"
        )
        yield fleet


def test_the_overview_has_state_task_battery_and_picture_of_every_robot(fleet: Fleet) -> None:
    fleet.second.battery = 0.42
    fleet.second.publish_robot()
    fleet.second.publish_frame()
    fleet.first.change_task(fleet.first.submit(INSTRUCTION).id, "running", message="on its way")
    robots = fleet.robots()
    assert robots["robot"]["state"] == "busy"
    assert robots["robot"]["task"]["message"] == "on its way"
    assert (robots["robot"]["battery"], robots["robot"]["picture"]) == (None, None)
    second = robots["second"]
    assert (second["state"], second["task"], second["battery"]) == ("idle", None, 0.42)
    assert second["pose"]["x_m"] == pytest.approx(3.1)
    picture = httpx.get(fleet.gateway.url + second["picture"])
    assert picture.headers["content-type"] == "image/jpeg"
    services = Helios(fleet.gateway.url, robot="second").status()["services"]
    assert {s["name"]: s["state"] for s in services}["gateway"] == "ready"
    fleet.second.die("bridge")
    assert fleet.robots()["second"]["state"] == "away"


def test_a_task_for_any_robot_goes_to_the_one_next_to_the_thing_and_to_its_end(
    fleet: Fleet,
) -> None:
    fleet.first.found = []
    fleet.first.change_objects()
    task = fleet.sdk.submit_to_fleet(INSTRUCTION, priority=3)
    wait_until(lambda: fleet.has(task.id, "second"), 60, "the second robot has it")
    told = fleet.sdk.fleet_task(task.id)
    assert told.why == (
        "second's map had the mug 1.7 m away (score 0.71): the only idle robot with one in its map"
    )
    assert (told.wanted, told.priority, told.state) == ("any", 3, "queued")
    assert told.task is not None
    assert told.task["on_hold"] is False
    fleet.second.change_task(told.task_id, "running", progress=0.5, message="picking")
    wait_until(lambda: fleet.sdk.fleet_task(task.id).message == "picking", 60, "it goes on")
    fleet.second.change_task(told.task_id, "succeeded", message="placed the mug")
    wait_until(lambda: fleet.sdk.fleet_task(task.id).ended, 60, "it ends")
    ended = fleet.sdk.fleet_task(task.id)
    assert (ended.state, ended.message, ended.robot) == ("succeeded", "placed the mug", "second")
    assert fleet.sdk.fleet()["tasks"] == []
    assert [t.id for t in fleet.sdk.fleet_tasks("succeeded")] == [task.id]


def test_a_dropped_robots_waiting_task_goes_to_the_other_robot(fleet: Fleet) -> None:
    fleet.second.found = []
    fleet.second.change_objects()
    task = fleet.sdk.submit_to_fleet(INSTRUCTION)
    wait_until(lambda: fleet.has(task.id, "robot"), 60, "the first robot has it")
    offered = fleet.sdk.fleet_task(task.id).task_id
    fleet.first.die("bridge")
    wait_until(lambda: fleet.has(task.id, "second"), 60, "the other robot has it")
    wait_until(lambda: fleet.first.tasks[offered].state == "cancelled", 60, "the first drops it")
    assert fleet.sdk.fleet_task(task.id).returned == 1


def test_wrong_requests_are_refused_and_queue_nothing(fleet: Fleet) -> None:
    with pytest.raises(InvalidInput, match="names no action"):
        fleet.sdk.submit_to_fleet("dance")
    with pytest.raises(InvalidInput, match="there is no robot 'third' here; there are: robot, se"):
        fleet.sdk.submit_to_fleet(INSTRUCTION, robot="third")
    with pytest.raises(InvalidInput, match="no task 'nothing' of the fleet"):
        fleet.sdk.fleet_task("nothing")
    assert fleet.sdk.fleet_tasks() == ()


def test_a_task_of_the_fleet_is_cancelled_at_its_robot(fleet: Fleet) -> None:
    task = fleet.sdk.submit_to_fleet(INSTRUCTION, robot="second")
    wait_until(lambda: fleet.has(task.id, "second"), 60, "the second robot has it")
    assert fleet.sdk.cancel_fleet_task(task.id).state == "cancelled"
    assert fleet.second.tasks[fleet.sdk.fleet_task(task.id).task_id].state == "cancelled"


def test_the_command_line_shows_the_fleet_and_gives_it_tasks(
    fleet: Fleet, capsys: pytest.CaptureFixture[str]
) -> None:
    command = Command(fleet.gateway, capsys)
    id = command("task", INSTRUCTION, "--robot", "any", "--no-wait").strip()
    wait_until(lambda: fleet.sdk.fleet_task(id).begun, 60, "a robot has it")
    shown = command("fleet")
    assert "second" in shown
    assert INSTRUCTION in shown
    assert [task["id"] for task in command.json("fleet")["tasks"]] == [id]
    assert [t["id"] for t in command.json("tasks", "--robot", "any")["tasks"]] == [id]
    assert "is cancelled" in command("cancel", id[:6], "--robot", "any")
    command("task", "dance", "--robot", "any", status=2)
    assert "names no action" in command.error


def test_a_task_for_the_fleet_names_the_words_that_have_no_effect(
    fleet: Fleet, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet.first.unused = fleet.second.unused = ["in the kitchen"]
    command = Command(fleet.gateway, capsys)
    id = command("task", INSTRUCTION, "--robot", "any", "--no-wait").strip()
    assert command.error == "helios: ignored: “in the kitchen”\n"
    assert fleet.sdk.fleet_task(id).unused == ["in the kitchen"]


def test_all_tasks_of_the_fleet_are_cancelled_in_an_order_in_which_none_starts(
    fleet: Fleet, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    at_second = fleet.sdk.submit_to_fleet(INSTRUCTION, robot="second").id
    wait_until(lambda: fleet.has(at_second, "second"), 60, "the second robot has it")
    waiting = fleet.sdk.submit_to_fleet(INSTRUCTION, robot="second").id
    running = fleet.sdk.submit_to_fleet(INSTRUCTION, robot="robot").id
    wait_until(lambda: fleet.has(running, "robot"), 60, "the first robot has it")
    fleet.first.change_task(fleet.sdk.fleet_task(running).task_id, "running")
    wait_until(lambda: fleet.sdk.fleet_task(running).state == "running", 60, "it runs")
    order: list[str] = []

    def cancel(helios: Helios, id: str) -> FleetTask:
        order.append(id)
        return original(helios, id)

    original = Helios.cancel_fleet_task
    monkeypatch.setattr(Helios, "cancel_fleet_task", cancel)
    ended = Command(fleet.gateway, capsys).json("cancel", "--all", "--robot", "any")["tasks"]
    assert order == [task["id"] for task in ended] == [waiting, at_second, running]


@pytest.mark.parametrize("supervised", [False, True])
def test_the_status_has_a_line_for_each_robot(
    supervised: bool,
    fleet: Fleet,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    if supervised:
        row = {"name": "second/map2d", "state": "ready", "reason": "", "restarts": 0, "pid": 7}
        here = {"ready": True, "services": [row], "robot": "robot", "robots": ["robot", "second"]}
        state_file.write([tmp_path / "helios" / str(fleet.gateway.port)], here)
    command = Command(fleet.gateway, capsys)
    assert command("status").splitlines()[-2:] == ["robot: ready", "second: ready"]
    Helios(fleet.gateway.url, robot="second").stop_robot("a child")
    clear = "it will not move until you run helios clear-stop --robot second"
    said = ["robot: ready", f"second: stopped (a child): {clear}"]
    assert command("status").splitlines()[-2:] == said
    found = command.json("status")
    assert (found["ready"], found["stopped"]) == (False, True)
    assert found["stop_reason"] == "second: a child"
    assert [(r["name"], r["ready"], r["stopped"]) for r in found["robots"]] == [
        ("robot", True, False),
        ("second", False, True),
    ]
    rows = {service["name"] for service in found["services"]}
    assert "second/map2d" in rows
    assert ("robot/map2d" in rows) is not supervised
    assert "robots" not in command.json("status", "--robot", "robot")
