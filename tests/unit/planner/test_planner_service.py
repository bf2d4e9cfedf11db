"""Tasks over the bus: submitted, watched, cancelled, paused, failed and remembered."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, cast

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CANCEL,
    CONTEXT,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    OBJECTS,
    RETIRE,
    SNAPSHOT,
    SUBMIT,
    TASK,
    VOCABULARY,
    WHAT_IF,
)
from helios_planner import bus_body, calls, driving
from helios_planner.instruction import parse
from helios_planner.service import PlannerService
from helios_planner.settings import Settings
from helios_planner.store import Store
from helios_planner.task import State, Task
from planner_peers import Peers
from planner_world import FakeWorld, coffee_table, counter, flat, mug

from tests.support import wait_until

MOVE = "Move the mug from the coffee table to the counter"
Start = Callable[..., tuple[PlannerService, MemoryBus, Peers]]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Starts a planner among peers; quick to lose patience."""
    monkeypatch.setattr(bus_body, "ACK_PATIENCE_S", 0.2)
    for module in (bus_body, calls, driving):
        monkeypatch.setattr(module, "RETRY_S", 0.02)
    running: list[PlannerService] = []

    def go(
        world: FakeWorld | None = None, names: tuple[str, ...] = ()
    ) -> tuple[PlannerService, MemoryBus, Peers]:
        hub = MemoryHub()
        peers = Peers(hub, world or flat([coffee_table(), counter(), mug()]), names)
        settings = Settings(state_dir=tmp_path, ack_timeout_s=0.4, away_s=0.4)
        running.append(PlannerService(MemoryBus(hub), settings, Health()))
        return running[-1], MemoryBus(hub), peers

    yield go
    for service in running:
        service.close()


def submit(bus: MemoryBus, text: str = MOVE, max_steps: int = 0, agent: str = "") -> pb.Task:
    request = pb.SubmitRequest(instruction=text, max_steps=max_steps, agent=agent)
    return bus.call(SUBMIT, request, 5)


def task(bus: MemoryBus, id: str) -> pb.Task:
    return bus.call(GET_TASK, pb.TaskRequest(id=id), 5)


def ended(bus: MemoryBus, id: str) -> pb.Task:
    wait_until(lambda: task(bus, id).state in ("succeeded", "failed", "cancelled"), 60, "it ended")
    return task(bus, id)


def test_a_task_succeeds_and_its_decisions_say_why(start: Start) -> None:
    _, bus, peers = start()
    states: list[str] = []
    bus.subscribe(TASK, lambda t: states.append(t.state))
    id = submit(bus).id
    done = ended(bus, id)
    assert (done.state, done.cause) == ("succeeded", ""), done.message
    assert states[0] == "queued"
    wait_until(lambda: states[-1] == "succeeded", 5, "the end was told")
    assert done.steps == peers.world.steps
    assert done.picks == 1
    told = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    assert [d.index for d in told] == list(range(len(told)))
    assert all(d.why and d.rule and d.context_id == done.context_id for d in told)
    assert any("pick" in d.rule for d in told)
    assert {c.role for c in peers.context.classes} == {
        "object", "start_receptacle", "goal_receptacle"
    }  # fmt: skip
    assert peers.context.prompts["pick"] == "Seems like there is a coffee table ahead"


def test_a_running_task_is_cancelled_within_one_action(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    id = submit(bus).id
    wait_until(peers.acting.is_set, 5, "it acts")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    assert ended(bus, id).state == "cancelled"
    assert peers.world.steps <= 1


def test_a_queued_task_waits_and_can_be_cancelled(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    first = submit(bus, "find the mug").id
    wait_until(peers.acting.is_set, 5, "it acts")
    second = submit(bus).id
    assert task(bus, second).state == "queued"
    assert bus.call(CANCEL, pb.TaskRequest(id=second), 5).state == "cancelled"
    bus.call(CANCEL, pb.TaskRequest(id=first), 5)
    peers.gate.set()
    assert ended(bus, first).state == "cancelled"


def test_stop_now_pauses_and_clearing_it_goes_on(start: Start) -> None:
    _, bus, peers = start()
    peers.stopped = True
    id = submit(bus, "go to the counter").id
    wait_until(lambda: task(bus, id).state == "paused", 5, "it pauses")
    assert "a person" in task(bus, id).message
    assert peers.world.steps == 0
    peers.stopped = False
    assert ended(bus, id).state == "succeeded"


def test_a_robot_that_begins_a_new_world_in_mid_task_is_a_system_error(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    id = submit(bus).id
    wait_until(peers.acting.is_set, 5, "it acts")
    peers.gate.set()
    wait_until(lambda: peers.world.steps > 3, 30, "it acts on")
    peers.boot = "another boot"
    done = ended(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "localisation jumped" in done.message


def test_a_map_that_stays_silent_fails_the_task_and_is_named(start: Start) -> None:
    _, bus, peers = start()
    peers.silent.add("objects")
    told: list[str] = []
    bus.subscribe(TASK, lambda task: told.append(task.message))
    done = ended(bus, submit(bus).id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "objectmap" in done.message
    assert any(m.startswith("waits for objectmap") for m in told)


def test_a_task_says_what_it_waits_for_and_goes_on_with_what_it_did(start: Start) -> None:
    _, bus, peers = start()
    away = [2]

    def snapshot(request: pb.SnapshotRequest) -> pb.MapSnapshot:
        if peers.world.steps > 5 and away[0]:
            away[0] -= 1
            raise Unavailable("it starts again")
        return peers._snapshot(request)

    peers.bus.serve(SNAPSHOT, snapshot)
    told: list[str] = []
    bus.subscribe(TASK, lambda task: told.append(task.message))
    assert ended(bus, submit(bus, "go to the counter").id).state == "succeeded"
    k = told.index("waits for the map2d: it starts again")
    assert told.count(told[k]) == 1
    assert told[k + 1] == told[k - 1]


def test_a_queued_task_says_that_no_robot_is_there_yet(tmp_path: Path) -> None:
    hub = MemoryHub()
    service = PlannerService(MemoryBus(hub), Settings(state_dir=tmp_path), Health())
    told = submit(MemoryBus(hub)).message
    service.close()
    assert told == "waits for its turn; the bridge has not described the robot yet"


def test_a_task_may_name_its_agent_and_one_that_trusts_the_detector_needs_no_object_map(
    start: Start,
) -> None:
    _, bus, peers = start()
    peers.silent.add("objects")
    peers.bus.serve(OBJECTS, forbidden)
    peers.bus.serve(WHAT_IF, forbidden)
    peers.bus.serve(RETIRE, forbidden)
    done = ended(bus, submit(bus, agent="trusting").id)
    assert (done.state, done.agent, done.cause) == ("succeeded", "trusting", ""), done.message
    assert peers.world.released is peers.world.things[3]


def forbidden(_: object) -> NoReturn:
    raise AssertionError("the object map was asked")


def test_a_task_says_that_it_waits_for_a_detector_without_a_model(start: Start) -> None:
    _, bus, peers = start()

    def away(_: pb.Empty) -> NoReturn:
        raise Unavailable("the model file nano.onnx does not exist; give another")

    told: list[str] = []
    bus.subscribe(TASK, lambda task: told.append(task.message))
    peers.bus.serve(VOCABULARY, away)
    failed = ended(bus, submit(bus).id)
    why = "the model file nano.onnx does not exist; give another"
    assert told.count(f"waits for the detector: {why}") == 1
    assert "nano.onnx" in failed.message


def test_a_detector_that_stays_silent_is_named_by_who_trusts_it(start: Start) -> None:
    _, bus, peers = start()
    peers.silent.add("detections")
    done = ended(bus, submit(bus, agent="trusting").id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "detector" in done.message


def test_an_agent_that_there_is_not_is_refused_at_once(start: Start) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match="choose one of helios"):
        submit(bus, agent="clever")
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


def test_the_step_budget_of_a_task_ends_it(start: Start) -> None:
    _, bus, _ = start()
    done = ended(bus, submit(bus, max_steps=10).id)
    assert (done.state, done.cause, done.steps) == ("failed", "step budget", 10)


def test_the_queue_is_taken_by_priority_and_then_in_turn(start: Start) -> None:
    _, bus, peers = start()
    begun: list[str] = []
    bus.subscribe(TASK, lambda t: begun.append(t.id) if t.state == "running" else None)
    peers.gate = threading.Event()
    first = submit(bus, "find the mug").id
    wait_until(peers.acting.is_set, 60, "it acts")
    asked = [pb.SubmitRequest(instruction="go to the counter", priority=p) for p in (0, -5, 7, 0)]
    ids = [bus.call(SUBMIT, request, 5).id for request in asked]
    told = bus.call(LIST_TASKS, pb.Empty(), 5).tasks
    assert {t.id: t.priority for t in told} == {
        first: 0, **dict(zip(ids, (0, -5, 7, 0), strict=True))
    }  # fmt: skip
    peers.gate.set()
    ended(bus, ids[1])
    assert list(dict.fromkeys(begun)) == [first, ids[2], ids[0], ids[3], ids[1]]


def test_what_was_under_way_goes_on_before_anything_of_a_higher_priority() -> None:
    move = parse(MOVE)
    tasks = {
        name: Task(name, MOVE, move, state, 100, 0.0, priority=priority)
        for name, state, priority in (
            ("first", State.QUEUED, 0), ("urgent", State.QUEUED, 9), ("cut off", State.RUNNING, 0),
            ("held", State.PAUSED, -1),
        )
    }  # fmt: skip
    service = SimpleNamespace(_book=SimpleNamespace(known=tasks.__getitem__))
    order = sorted(tasks, key=partial(PlannerService._rank, cast(Any, service)), reverse=True)
    assert order == ["cut off", "held", "urgent", "first"]


def test_a_priority_out_of_range_is_refused(start: Start) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match="-100 to 100"):
        bus.call(SUBMIT, pb.SubmitRequest(instruction=MOVE, priority=101), 5)


def test_a_task_has_settings_of_its_own_and_the_next_one_has_not(start: Start) -> None:
    _, bus, _ = start()
    asked = pb.SubmitRequest(instruction=MOVE, settings={"alpha_d": "0.02", "rounds": "1"})
    own, after = bus.call(SUBMIT, asked, 5).id, submit(bus).id
    assert dict(ended(bus, own).settings) == {"alpha_d": "0.02", "rounds": "1"}
    ended(bus, after)

    def weights(id: str) -> set[float]:
        told = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
        return {d.settings["alpha_d"] for d in told if "alpha_d" in d.settings}

    assert (weights(own), weights(after)) == ({0.02}, {0.001})


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [("ack_timeout_s", "9", "choose among alpha_d"), ("alpha_d", "much", "alpha_d is 'much'"),
     ("alpha_d", "-1", "alpha_d is '-1'"), ("tau_g", "nan", "finite"),
     ("gain_norm", "none", "gain_norm is 'none'")],
)  # fmt: skip
def test_a_setting_that_no_task_can_have_is_refused_by_name(
    start: Start, name: str, text: str, says: str
) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match=says):
        bus.call(SUBMIT, pb.SubmitRequest(instruction=MOVE, settings={name: text}), 5)


def test_an_unknown_class_is_refused_with_close_names(start: Start) -> None:
    _, bus, _ = start(names=("mug", "coffee table", "kitchen counter", "sofa"))
    with pytest.raises(InvalidInput, match=r"does not know the goal “unicorn”"):
        submit(bus, "bring the mug to the unicorn")
    with pytest.raises(InvalidInput, match="did you mean kitchen counter"):
        submit(bus, "bring the mug to the kitchen table counter top")
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


def test_names_are_understood_in_the_vocabulary(start: Start) -> None:
    _, bus, peers = start(names=("mug", "coffee table", "counter"))
    id = submit(bus, "bring the red coffee mug to the counter").id
    assert task(bus, id).object == "mug"
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state in ("cancelled", "succeeded")
    assert peers.world.contacts == 0


def test_nonsense_is_refused_and_a_task_afterwards_is_done(start: Start) -> None:
    _, bus, _ = start()
    for text in ("", "x" * 10_000, "the quick brown fox", "bring it"):
        with pytest.raises(InvalidInput):
            submit(bus, text)
    assert ended(bus, submit(bus, "go to the counter").id).state == "succeeded"


def test_what_ran_when_the_planner_ended_is_a_system_error_afterwards(
    start: Start, tmp_path: Path
) -> None:
    store = Store(tmp_path)
    base = {"kind": "move", "object": "mug", "goal": "sofa", "max_steps": 5}
    store.put(pb.Task(id="ran", state="running", created_s=1, **base))
    store.put(pb.Task(id="done", state="succeeded", created_s=0, **base))
    store.close()
    _, bus, _ = start()
    assert task(bus, "done").state == "succeeded"
    assert (task(bus, "ran").state, task(bus, "ran").cause) == ("failed", "system error")


def test_the_search_context_is_there_for_late_joiners(start: Start) -> None:
    _, bus, _ = start()
    id = submit(bus, "go to the counter").id
    ended(bus, id)
    got: list[str] = []
    bus.subscribe(CONTEXT, lambda c: got.append(c.id))
    assert got == [id]
