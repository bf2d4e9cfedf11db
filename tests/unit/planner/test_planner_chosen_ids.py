"""Requests that choose the id of their task: they may be repeated, held, and checked before."""

from __future__ import annotations

import threading

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.topics import CHECK, LIST_TASKS, RESUME, SUBMIT
from planner_bus import ended, submit, task
from planner_flat import GO, flat_with_mug
from planner_group import PlannerGroup

ID = "0123456789ab"


def test_a_repeated_request_adds_one_task(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    request = pb.SubmitRequest(instruction=GO, id=ID, on_hold=True)
    answers: list[pb.Task] = []
    threads = [
        threading.Thread(target=lambda: answers.append(bus.call(SUBMIT, request, 5)))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {(a.id, a.state, a.on_hold) for a in answers} == {(ID, "queued", True)}
    assert [t.id for t in bus.call(LIST_TASKS, pb.Empty(), 5).tasks] == [ID]


def test_a_task_that_is_submitted_on_hold_starts_only_when_it_is_resumed(
    group: PlannerGroup,
) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    bus.call(SUBMIT, pb.SubmitRequest(instruction=GO, id=ID, on_hold=True), 5)
    other = submit(bus, GO).id
    ended(bus, other)
    held = task(bus, ID)
    assert (held.state, held.started_s) == ("queued", 0.0)
    assert held.message == "paused; resume or cancel it"
    bus.call(RESUME, pb.TaskRequest(id=ID), 5)
    assert ended(bus, ID).state == "succeeded"
    again = bus.call(SUBMIT, pb.SubmitRequest(instruction=GO, id=ID, on_hold=True), 5)
    assert again.state == "succeeded"


def test_an_id_that_is_no_word_of_digits_is_refused(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    for id in ("abc", "../../etc/passwd", "A" * 12, "0" * 33):
        with pytest.raises(InvalidInput, match="8 to 32 lower-case hexadecimal digits"):
            bus.call(SUBMIT, pb.SubmitRequest(instruction=GO, id=id), 5)


def test_a_check_names_the_thing_and_queues_nothing(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    draft = bus.call(CHECK, pb.SubmitRequest(instruction="find the mug"), 5)
    assert (draft.kind, draft.object) == ("find", "mug")
    with pytest.raises(InvalidInput, match="no verb was understood"):
        bus.call(CHECK, pb.SubmitRequest(instruction="dance"), 5)
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks
