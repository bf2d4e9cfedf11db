"""Tasks over the bus, from submission to the stored result."""

from __future__ import annotations

import threading
from pathlib import Path

from helios_core import proto as pb
from helios_core.topics import CANCEL, CONTEXT, DECISIONS, SUBMIT, TASK
from helios_planner.tasks.store import Store
from planner_bus import Start, ended, submit, task

from tests.support import wait_until


def test_a_task_succeeds_and_its_decisions_have_reasons(start: Start) -> None:
    _, bus, peers = start()
    states: list[str] = []
    bus.subscribe(TASK, lambda t: states.append(t.state))
    id = submit(bus).id
    done = ended(bus, id)
    assert (done.state, done.cause) == ("succeeded", ""), done.message
    assert states[0] == "queued"
    wait_until(lambda: states[-1] == "succeeded", 60, "the end was told")
    assert done.steps == peers.world.steps
    assert done.picks == 1
    wait_until(lambda: peers.released == peers.token, 60, "the robot is given back")
    reported = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    assert [d.index for d in reported] == list(range(len(reported)))
    assert all(d.why and d.rule and d.context_id == done.context_id for d in reported)
    assert any("pick" in d.rule for d in reported)
    assert {c.role for c in peers.context.classes} == {
        "object",
        "start_receptacle",
        "goal_receptacle",
    }
    assert peers.context.prompts["pick"] == "Seems like there is a coffee table ahead"


def test_a_decision_of_another_version_does_not_hide_the_others(start: Start) -> None:
    planner, bus, _ = start()
    id = bus.call(SUBMIT, pb.SubmitRequest(instruction="find the mug", on_hold=True), 5).id
    rows = (
        pb.Decision(rule="best view", do="a former name"),
        pb.Decision(rule="pick (eq. 7, 11)", do="nothing_left"),  # it has no threshold
        pb.Decision(rule="best view", do="nothing_left"),
    )
    for index, row in enumerate(rows):
        row.task_id, row.index = id, index
        planner._store.add(row)
    asked = pb.TaskRequest(id=id, settings={"alpha_d": "0.2"})
    reported = bus.call(DECISIONS, asked, 5).decisions
    assert [d.HasField("recomputed") for d in reported] == [False, False, True]


def test_a_running_task_is_cancelled_within_one_action(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    id = submit(bus).id
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    assert ended(bus, id).state == "cancelled"
    assert peers.world.steps <= 1


def test_a_task_that_ran_when_the_planner_ended_fails_with_a_system_error(
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


def test_late_subscribers_receive_the_search_context(start: Start) -> None:
    _, bus, _ = start()
    id = submit(bus, "go to the counter").id
    ended(bus, id)
    got: list[str] = []
    bus.subscribe(CONTEXT, lambda c: got.append(c.id))
    assert got == [id]
