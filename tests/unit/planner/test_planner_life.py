"""The life of a task: paused, out of time, side by side, and over a planner's death."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    ACT,
    CANCEL,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    PAUSE,
    RESUME,
    SUBMIT,
    TASK,
    Method,
    Rep,
    Req,
)
from helios_planner import bus_body, calls, driving, recovery
from helios_planner.service import PlannerService
from helios_planner.settings import Settings
from planner_flat import coffee_table, counter, flat, mug
from planner_peers import Peers
from planner_world import FakeWorld

from tests.support import wait_until

MOVE = "Move the mug from the coffee table to the counter"
GO = "go to the counter"


class MortalBus(MemoryBus):
    """Freezes its caller for good at the first action that `dies_at` is true for; with `answered`
    the robot has done the action by then, and nobody has heard what came of it."""

    dies_at: Callable[[pb.ActionRequest], bool] | None = None
    answered = True
    dead = threading.Event()

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        if not isinstance(request, pb.ActionRequest) or method.name != ACT.name:
            return super().call(method, request, timeout_s)
        dies = self.dies_at is not None and self.dies_at(request)
        if dies and not self.answered:
            self._die()
        reply = super().call(method, request, timeout_s)
        if dies:
            self._die()
        return reply

    def _die(self) -> None:
        self.dead.set()
        threading.Event().wait()


class House:
    """Planners, one after the other or side by side, among peers on one hub."""

    def __init__(self, state_dir: Path) -> None:
        self.state_dir, self.hub = state_dir, MemoryHub()
        self.planners: list[PlannerService] = []

    def peers(self, world: FakeWorld, robot: str = "robot") -> Peers:
        return Peers(self.hub, world, robot=robot)

    def planner(self, robot: str = "robot", **settings: Any) -> MemoryBus:
        """A planner, and a bus to ask it."""
        given = Settings(
            state_dir=self.state_dir / robot, ack_timeout_s=0.4, away_s=0.4,
            **settings,
        )  # fmt: skip
        self.planners.append(PlannerService(MemoryBus(self.hub, robot), given, Health()))
        return MemoryBus(self.hub, robot)

    def mortal(
        self, dies_at: Callable[[pb.ActionRequest], bool], answered: bool = True
    ) -> tuple[MortalBus, MemoryBus]:
        """A planner that dies, and a bus to ask it."""
        bus = MortalBus(self.hub)
        bus.dies_at, bus.answered = dies_at, answered
        bus.dead = threading.Event()
        settings = Settings(state_dir=self.state_dir / "robot", ack_timeout_s=0.4, away_s=0.4)
        PlannerService(bus, settings, Health())
        return bus, MemoryBus(self.hub)

    def close(self) -> None:
        for planner in self.planners:
            planner.close()


@pytest.fixture
def house(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[House]:
    monkeypatch.setattr(bus_body, "ACK_PATIENCE_S", 0.2)
    for module in (bus_body, calls, driving, recovery):
        monkeypatch.setattr(module, "RETRY_S", 0.02)
    house = House(tmp_path)
    yield house
    house.close()


def home() -> FakeWorld:
    return flat([coffee_table(), counter(), mug()])


def submit(bus: MemoryBus, text: str = MOVE, time_limit_s: float = 0.0) -> str:
    request = pb.SubmitRequest(instruction=text, time_limit_s=time_limit_s)
    return bus.call(SUBMIT, request, 5).id


def task(bus: MemoryBus, id: str) -> pb.Task:
    return bus.call(GET_TASK, pb.TaskRequest(id=id), 5)


def ended(bus: MemoryBus, id: str) -> pb.Task:
    done = ("succeeded", "failed", "cancelled")
    wait_until(lambda: task(bus, id).state in done, 120, "it ended")
    return task(bus, id)


# --- paused --------------------------------------------------------------------------------------
def test_a_paused_task_begins_no_action_until_it_is_resumed(house: House) -> None:
    peers = house.peers(home())
    bus = house.planner(max_steps=3)
    peers.gate = threading.Event()
    id = submit(bus, GO)
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    wait_until(lambda: task(bus, id).state == "paused", 60, "it is paused")
    assert task(bus, id).message == "paused; resume or cancel it"
    assert peers.world.steps == 1
    bus.call(RESUME, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).steps == 3


def test_a_paused_task_can_be_cancelled(house: House) -> None:
    peers = house.peers(home())
    bus = house.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO)
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    wait_until(lambda: task(bus, id).state == "paused", 60, "it is paused")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "cancelled"
    assert peers.world.steps == 1


def test_only_a_task_that_runs_can_be_paused(house: House) -> None:
    peers = house.peers(home())
    bus = house.planner()
    peers.gate = threading.Event()
    first, second = submit(bus, GO), submit(bus, GO)
    wait_until(peers.acting.is_set, 60, "it acts")
    with pytest.raises(Conflict, match=f"task {second} is queued"):
        bus.call(PAUSE, pb.TaskRequest(id=second), 5)
    with pytest.raises(InvalidInput, match="there is no task"):
        bus.call(RESUME, pb.TaskRequest(id="nobody"), 5)
    bus.call(CANCEL, pb.TaskRequest(id=second), 5)
    bus.call(CANCEL, pb.TaskRequest(id=first), 5)
    peers.gate.set()
    ended(bus, first)
    with pytest.raises(Conflict, match="is cancelled"):
        bus.call(RESUME, pb.TaskRequest(id=first), 5)


# --- limits --------------------------------------------------------------------------------------
def test_a_task_ends_when_its_time_is_over(house: House) -> None:
    house.peers(home())
    bus = house.planner()
    id = submit(bus, GO, time_limit_s=0.2)
    assert task(bus, id).time_limit_s == pytest.approx(0.2)
    done = ended(bus, id)
    assert (done.state, done.cause) == ("failed", "step budget")
    assert done.message == "the task's 0.2 s are used up"


def test_a_time_that_makes_no_sense_is_refused(house: House) -> None:
    house.peers(home())
    bus = house.planner()
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InvalidInput, match="wanted seconds"):
            submit(bus, GO, time_limit_s=wrong)
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


# --- several -------------------------------------------------------------------------------------
def test_two_tasks_on_one_robot_are_done_one_after_the_other(house: House) -> None:
    house.peers(home())
    bus = house.planner(max_steps=3)
    ran: list[tuple[str, str]] = []
    bus.subscribe(TASK, lambda t: ran.append((t.id, t.state)))
    first, second = submit(bus, GO), submit(bus, GO)
    assert ended(bus, second).cause == "step budget"
    began = ran.index((second, "running"))
    assert (first, "failed") in ran[:began]


def test_different_robots_run_side_by_side(house: House) -> None:
    """One stands still with its hand on its action; the other one goes on and ends."""
    still, other = house.peers(home(), "one"), house.peers(home(), "two")
    one, two = house.planner("one", max_steps=5), house.planner("two", max_steps=5)
    still.gate = threading.Event()
    held = submit(one, GO)
    wait_until(still.acting.is_set, 60, "it acts")
    assert ended(two, submit(two, GO)).cause == "step budget"
    assert other.world.steps == 5
    assert (task(one, held).state, still.world.steps) == ("running", 0)
    still.gate.set()
    assert ended(one, held).steps == 5


def test_of_ended_tasks_the_newest_are_remembered(house: House) -> None:
    house.peers(home())
    bus = house.planner(keep_tasks=1, max_steps=1)
    ids = []
    for _ in range(3):
        ids.append(submit(bus, GO))
        ended(bus, ids[-1])
    assert [t.id for t in bus.call(LIST_TASKS, pb.Empty(), 5).tasks] == ids[1:]
    with pytest.raises(InvalidInput):
        bus.call(DECISIONS, pb.TaskRequest(id=ids[0]), 5)


# --- the planner dies ----------------------------------------------------------------------------
def kinds(world: FakeWorld) -> list[str]:
    return [type(a).__name__ for a in world.log]


@pytest.mark.parametrize("answered", [True, False], ids=["done", "never sent"])
def test_a_planner_that_dies_in_a_pick_goes_on_and_picks_once(house: House, answered: bool) -> None:
    peers = house.peers(home())
    mortal, bus = house.mortal(lambda r: r.action.HasField("pick"), answered)
    id = submit(bus)
    wait_until(mortal.dead.is_set, 120, "it dies")
    before = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    steps = peers.world.steps
    mortal.close()
    bus = house.planner()
    done = ended(bus, id)
    assert (done.state, done.cause) == ("succeeded", ""), done.message
    assert (kinds(peers.world).count("Pick"), kinds(peers.world).count("Place")) == (1, 1)
    assert done.picks == 1
    assert peers.world.released is peers.world.things[3]
    assert done.steps >= steps
    told = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    assert [d.index for d in told] == list(range(len(told)))
    assert told[: len(before)] == before
    assert peers.contexts == [id], "a new search context would forget what was searched"


def test_a_paused_task_stays_paused_over_the_planners_death(house: House) -> None:
    peers = house.peers(home())
    mortal, bus = house.mortal(lambda _: True)
    id = submit(bus, GO)
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)  # it was still there to hear this
    mortal.close()
    bus = house.planner()
    wait_until(lambda: "resume" in task(bus, id).message, 60, "it waits")
    assert task(bus, id).state == "paused"
    assert peers.world.steps == 1
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "cancelled"


def test_a_cancelled_task_does_not_go_on_after_the_planners_death(house: House) -> None:
    peers = house.peers(home())
    mortal, bus = house.mortal(lambda _: True)
    id = submit(bus, GO)
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)  # it was still there to hear this
    mortal.close()
    assert task(house.planner(), id).state == "cancelled"
    assert peers.world.steps == 1


def test_a_planner_that_was_away_for_too_long_leaves_the_task(house: House) -> None:
    peers = house.peers(home())
    mortal, bus = house.mortal(lambda r: r.action.HasField("turn"))
    id = submit(bus)
    wait_until(mortal.dead.is_set, 60, "it dies")
    mortal.close()
    steps = peers.world.steps
    bus = house.planner(resume_within_s=0)
    done = task(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "away for too long" in done.message
    assert peers.world.steps == steps


def test_a_planner_that_is_stopped_leaves_no_task_that_starts_by_itself(house: House) -> None:
    peers = house.peers(home())
    bus = house.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO)
    wait_until(peers.acting.is_set, 60, "it acts")
    stopping = threading.Thread(target=house.planners[0].close)
    stopping.start()
    peers.gate.set()
    stopping.join(10)
    steps = peers.world.steps
    bus = house.planner()
    done = task(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "was stopped" in done.message
    assert peers.world.steps == steps


def test_a_robot_that_restarted_meanwhile_does_not_go_on(house: House) -> None:
    peers = house.peers(home())
    mortal, bus = house.mortal(lambda r: r.action.HasField("tilt"))
    id = submit(bus)
    wait_until(mortal.dead.is_set, 60, "it dies")
    mortal.close()
    peers.boot = "another"
    done = ended(house.planner(), id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "restarted" in done.message
