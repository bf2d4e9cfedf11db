"""No task starts while the maps are replaced; the queue's lock decides which was first."""

from __future__ import annotations

import threading

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput
from helios_core.topics import CANCEL, RESERVE, TASK
from helios_planner.tasks.registry import LONGEST_RESERVATION_S, Reservation
from planner_bus import Start, ended, submit, task

from tests.support import wait_until

WHY = "the maps are being loaded"
ASK = pb.ReserveRequest(why=WHY, for_s=60.0)


def test_a_task_submitted_during_a_reservation_waits_and_reports_the_reason(start: Start) -> None:
    service, bus, peers = start()
    reported: list[str] = []
    bus.subscribe(TASK, lambda t: reported.append(t.state))
    token = bus.call(RESERVE, ASK, 5).token
    id = submit(bus, "find the mug").id
    assert WHY in task(bus, id).message
    with service._wake:
        service._wake.notify_all()  # the worker checks, and starts nothing
    wait_until(service._described.is_set, 60, "the robot is known")
    assert not peers.acting.wait(0.7)  # the worker checks every 0.5 s
    assert set(reported) == {"queued"}
    bus.call(RESERVE, pb.ReserveRequest(token=token), 5)
    assert ended(bus, id).state == "succeeded"


def test_a_reservation_is_refused_while_a_task_is_queued_or_running(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    first, second = submit(bus, "find the mug").id, submit(bus, "find the mug").id
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(CANCEL, pb.TaskRequest(id=second), 5)
    with pytest.raises(Conflict, match=f"task {first} is running"):
        bus.call(RESERVE, ASK, 5)
    bus.call(CANCEL, pb.TaskRequest(id=first), 5)
    peers.gate.set()
    ended(bus, first)
    assert bus.call(RESERVE, ASK, 5).token


def test_a_reservation_expires_by_itself() -> None:
    now_s = [0.0]
    reservation = Reservation(lambda: now_s[0])
    first = reservation.begin("a", 60.0)
    with pytest.raises(Conflict, match="a at this moment"):
        reservation.begin("b", 60.0)
    now_s[0] = 60.0
    assert reservation.why == ""
    reservation.begin("b", 60.0)
    reservation.end(first)  # the first reservation is over
    assert reservation.why == "b"


@pytest.mark.parametrize(
    "for_s", [0.0, -1.0, float("nan"), float("inf"), LONGEST_RESERVATION_S + 1]
)
def test_a_reservation_with_an_invalid_duration_is_refused(for_s: float) -> None:
    with pytest.raises(InvalidInput, match="for_s is"):
        Reservation().begin("a", for_s)
