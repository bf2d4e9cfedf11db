"""Tests of the bus interface, run against every implementation."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest
from helios_core import proto as pb
from helios_core.bus import Bus, Registration
from helios_core.errors import Conflict, DeadlineExceeded, Internal, InvalidInput, Unavailable
from helios_core.memory_bus import MemoryBus
from helios_core.topics import (
    ACT,
    ANY_STATUS,
    CONTEXT,
    DECISION,
    FRAME,
    GET_TASK,
    OBJECTMAP_ACK,
    SNAPSHOT,
    STOP,
    status_topic,
)
from helios_core.zenoh_bus import SERVE_THREADS, ZenohBus

from tests.support import wait_until

MakeBus = Callable[[str], Bus]


def _frame(seq: int, size: int = 0) -> pb.Frame:
    frame = pb.Frame(id=pb.FrameId(seq=seq))
    frame.raw_color.data = bytes(size)
    return frame


def test_a_published_message_arrives_whole_and_as_a_copy(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    got: list[pb.Decision] = []
    b.subscribe(DECISION, got.append)
    sent = pb.Decision(task_id="t", why="because")
    wait_until(lambda: a.publish(DECISION, sent) or bool(got), 60, "the decision arrives")
    assert got[0] == sent
    assert got[0] is not sent


def test_a_never_drop_topic_delivers_every_message_in_order(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    got: list[int] = []
    b.subscribe(OBJECTMAP_ACK, lambda m: got.append(m.version))
    wait_until(
        lambda: a.publish(OBJECTMAP_ACK, pb.Ack(version=0)) or bool(got), 60, "the two are joined"
    )
    got.clear()
    for i in range(1, 101):
        a.publish(OBJECTMAP_ACK, pb.Ack(version=i))
    wait_until(lambda: bool(got) and got[-1] == 100, 60, "the last one arrives")
    assert [v for v in got if v] == list(range(1, 101))


def test_a_slow_subscriber_of_a_latest_wins_topic_receives_the_newest_message(
    make_bus: MakeBus,
) -> None:
    a, b = make_bus("r"), make_bus("r")
    got: list[int] = []
    go = threading.Event()

    def slow(message: pb.Frame) -> None:
        got.append(message.id.seq)
        if isinstance(b, ZenohBus):
            go.wait(5)

    b.subscribe(FRAME, slow)
    wait_until(lambda: a.publish(FRAME, _frame(0)) or bool(got), 60, "the two are joined")
    for i in range(1, 31):
        a.publish(FRAME, _frame(i, 10_000))
    go.set()
    wait_until(lambda: got[-1] == 30, 60, "the newest frame arrives")


def test_a_late_joiner_gets_the_retained_message_once(make_bus: MakeBus) -> None:
    a = make_bus("r")
    a.publish(CONTEXT, pb.SearchContext(id="old"))
    a.publish(CONTEXT, pb.SearchContext(id="new"))
    early: list[str] = []
    late: list[str] = []
    make_bus("r").subscribe(CONTEXT, lambda m: early.append(m.id))
    wait_until(lambda: "new" in early, 60, "nothing is on its way any more")
    make_bus("r").subscribe(CONTEXT, lambda m: late.append(m.id))
    wait_until(lambda: "new" in late, 60, "the retained context arrives")
    assert late == ["new"]


def test_one_subscription_receives_the_status_of_all_services(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    a.publish(status_topic("map2d"), pb.ServiceStatus(service="map2d"))
    got: set[str] = set()
    b.subscribe(ANY_STATUS, lambda m: got.add(m.service))
    a.publish(status_topic("planner"), pb.ServiceStatus(service="planner"))
    wait_until(lambda: got == {"map2d", "planner"}, 60, "both statuses arrive")


def test_a_call_returns_the_handlers_value(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    b.serve(GET_TASK, lambda request: pb.Task(id=request.id, state="queued"))
    assert a.call(GET_TASK, pb.TaskRequest(id="7"), 5).id == "7"


@pytest.mark.parametrize("size", [0, 1000, 3_000_000])
def test_a_reply_of_any_size_arrives_whole(make_bus: MakeBus, size: int) -> None:
    a, b = make_bus("r"), make_bus("r")
    data = bytes(i % 251 for i in range(size))
    b.serve(SNAPSHOT, lambda _: pb.MapSnapshot(occupancy=data))
    assert a.call(SNAPSHOT, pb.SnapshotRequest(), 10).occupancy == data


@pytest.mark.parametrize("error", [InvalidInput, Conflict, Unavailable])
def test_a_typed_error_of_the_handler_reaches_the_caller(make_bus: MakeBus, error) -> None:
    a, b = make_bus("r"), make_bus("r")

    def refuse(_: pb.ActionRequest) -> pb.ActionResult:
        raise error("the lease is held by somebody else; ask for it")

    b.serve(ACT, refuse)
    with pytest.raises(error, match="the lease is held"):
        a.call(ACT, pb.ActionRequest(), 5)


def test_an_exception_in_a_handler_is_an_internal_error_and_the_server_keeps_serving(
    make_bus: MakeBus,
) -> None:
    a, b = make_bus("r"), make_bus("r")
    faults = iter([ZeroDivisionError("oops")])

    def handler(request: pb.TaskRequest) -> pb.Task:
        for fault in faults:
            raise fault
        return pb.Task(id=request.id)

    b.serve(GET_TASK, handler)
    with pytest.raises(Internal, match="oops"):
        a.call(GET_TASK, pb.TaskRequest(id="1"), 5)
    assert a.call(GET_TASK, pb.TaskRequest(id="2"), 5).id == "2"


def test_a_call_of_a_method_without_a_server_is_unavailable(make_bus: MakeBus) -> None:
    with pytest.raises(Unavailable, match="planner/get"):
        make_bus("r").call(GET_TASK, pb.TaskRequest(), 5)


def test_an_answer_after_the_deadline_is_a_timeout(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")

    def late(request: pb.TaskRequest) -> pb.Task:
        if request.id == "late":
            threading.Event().wait(0.6)
        return pb.Task()

    b.serve(GET_TASK, late)
    a.call(GET_TASK, pb.TaskRequest(), 60)  # the server is found
    with pytest.raises(DeadlineExceeded, match=r"0\.2"):
        a.call(GET_TASK, pb.TaskRequest(id="late"), 0.2)


def test_a_failing_subscriber_gets_the_next_message(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    got: list[int] = []

    def handler(message: pb.Ack) -> None:
        got.append(message.version)
        raise ValueError("bad day")

    b.subscribe(OBJECTMAP_ACK, handler)
    wait_until(
        lambda: a.publish(OBJECTMAP_ACK, pb.Ack(version=1)) or len(got) > 1, 60, "two arrive"
    )


def test_liveliness_reports_present_joining_and_leaving_services(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    a.announce("detector", "1")
    seen: list[tuple[str, str, bool]] = []
    b.watch(lambda *event: seen.append(event))
    wait_until(lambda: ("detector", "1", True) in seen, 60, "the present one is told")
    later = a.announce("planner", "2")
    wait_until(lambda: ("planner", "2", True) in seen, 60, "the newcomer is told")
    later.close()
    wait_until(lambda: ("planner", "2", False) in seen, 60, "the leaver is told")


def test_a_robot_does_not_receive_messages_of_another_robot(make_bus: MakeBus) -> None:
    a, b, c = make_bus("one"), make_bus("two"), make_bus("one")
    other: list[str] = []
    mine: list[str] = []
    b.subscribe(CONTEXT, lambda m: other.append(m.id))
    c.subscribe(CONTEXT, lambda m: mine.append(m.id))
    a.publish(CONTEXT, pb.SearchContext(id="x"))
    wait_until(lambda: mine == ["x"], 60, "the same robot hears it")
    assert other == []


def test_publishing_on_a_closed_bus_raises_unavailable(make_bus: MakeBus) -> None:
    bus = make_bus("r")
    bus.close()
    bus.close()
    with pytest.raises(Unavailable, match="closed"):
        bus.publish(CONTEXT, pb.SearchContext())


def test_slow_calls_of_one_method_do_not_delay_another_method(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    if not isinstance(b, ZenohBus):
        pytest.skip("calls run on the caller's thread")
    go = threading.Event()
    hanging: list[int] = []

    def slow(_: pb.ActionRequest) -> pb.ActionResult:
        hanging.append(1)
        go.wait(60)
        return pb.ActionResult()

    b.serve(ACT, slow)
    b.serve(STOP, lambda _: pb.Empty())
    askers = [
        threading.Thread(target=lambda: a.call(ACT, pb.ActionRequest(), 90)) for _ in range(12)
    ]
    try:
        for asker in askers:
            asker.start()
        wait_until(lambda: len(hanging) >= SERVE_THREADS, 60, "every thread of it hangs")
        assert a.call(STOP, pb.StopRequest(), 30) == pb.Empty()
    finally:
        go.set()
        for asker in askers:
            asker.join()


def _all_kinds(bus: Bus) -> list[Registration]:
    return [
        bus.subscribe(CONTEXT, lambda _: None),
        bus.serve(GET_TASK, lambda request: pb.Task(id=request.id)),
        bus.announce("planner", "1"),
        bus.watch(lambda *_: None),
    ]


def test_closed_registrations_leave_no_threads_and_no_entries(make_bus: MakeBus) -> None:
    asker, bus = make_bus("r"), make_bus("r")
    before = set(threading.enumerate())
    for _ in range(3):
        registrations = _all_kinds(bus)
        assert asker.call(GET_TASK, pb.TaskRequest(id="7"), 5).id == "7"
        for registration in registrations * 2:  # a second time does nothing
            registration.close()
    wait_until(lambda: set(threading.enumerate()) <= before, 60, "its threads end")
    assert isinstance(bus, ZenohBus | MemoryBus)
    assert len(bus._mine) == 0
    bus.subscribe(CONTEXT, lambda _: None)
    assert len(bus._mine) == 1
    if isinstance(bus, ZenohBus):
        assert len(bus._readers) == 1


def test_a_handler_may_close_its_own_registration(make_bus: MakeBus) -> None:
    a, b = make_bus("r"), make_bus("r")
    mine: list[Registration] = []
    heard: list[int] = []

    def once(message: pb.Ack) -> None:
        mine[0].close()
        heard.append(message.version)

    def last(request: pb.TaskRequest) -> pb.Task:
        mine[1].close()
        return pb.Task(id=request.id)

    mine += [b.subscribe(OBJECTMAP_ACK, once), b.serve(GET_TASK, last)]
    wait_until(lambda: a.publish(OBJECTMAP_ACK, pb.Ack()) or bool(heard), 60, "the two are joined")
    assert a.call(GET_TASK, pb.TaskRequest(id="7"), 5).id == "7"
    with pytest.raises(Unavailable, match="nobody serves"):
        a.call(GET_TASK, pb.TaskRequest(id="8"), 5)
    assert isinstance(b, ZenohBus | MemoryBus)
    assert len(b._mine) == 0


def test_registrations_and_their_bus_may_close_concurrently(make_bus: MakeBus) -> None:
    bus = make_bus("r")
    registrations = _all_kinds(bus)
    faults: list[BaseException] = []

    def run(close: Callable[[], None]) -> None:
        try:
            close()
        except BaseException as fault:
            faults.append(fault)

    closers = [threading.Thread(target=run, args=(it.close,)) for it in (*registrations, bus) * 2]
    for closer in closers:
        closer.start()
    for closer in closers:
        closer.join(10)
    assert faults == []
    assert not any(closer.is_alive() for closer in closers)
    for declare in (
        lambda: bus.subscribe(CONTEXT, lambda _: None),
        lambda: bus.serve(STOP, lambda _: pb.Empty()),
        lambda: bus.announce("planner", "1"),
        lambda: bus.watch(lambda *_: None),
    ):
        with pytest.raises(Unavailable, match="closed"):
            declare()
