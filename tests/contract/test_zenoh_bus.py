"""Tests of the Zenoh bus only: its threads, and foreign clients on its router."""

from __future__ import annotations

import gc
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core import zenoh_messages
from helios_core.bus import arrival_s
from helios_core.errors import Internal, InvalidInput, Unavailable, error_from_proto
from helios_core.topics import CONTEXT, FRAME, GET_TASK, KEYFRAME, STOP
from helios_core.zenoh_bus import SERVE_THREADS, ZenohBus

from tests.support import wait_until

GET = GET_TASK.key("r")


def _task(request: pb.TaskRequest) -> pb.Task:
    return pb.Task(id=request.id)


def test_an_undecodable_request_is_invalid_input(
    zenoh_bus: ZenohBus, session: zenoh.Session
) -> None:
    bus = zenoh_bus
    bus.serve(GET_TASK, _task)
    wait_until(lambda: bus.call(GET_TASK, pb.TaskRequest(id="a"), 5).id == "a", 60, "it serves")
    (reply,) = session.get(GET, payload=b"\xff" * 50)
    assert reply.err is not None
    error = error_from_proto(pb.Error.FromString(reply.err.payload.to_bytes()))
    assert isinstance(error, InvalidInput)
    assert "50 bytes" in error.message


def test_a_damaged_message_is_left_out_in_one_line_and_the_next_one_comes(
    zenoh_bus: ZenohBus, session: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    heard: list[str] = []
    zenoh_bus.subscribe(CONTEXT, lambda context: heard.append(context.id))
    key = CONTEXT.key("r")
    sender: Any = session.declare_publisher(key)
    wait_until(lambda: sender.matching_status.matching, 60, "the bus listens")
    with caplog.at_level(logging.WARNING):
        sender.put(b"\xff" * 50)
        sender.put(pb.SearchContext(id="whole").SerializeToString())
        wait_until(lambda: heard, 60, "the next message comes")
    assert heard == ["whole"]
    [record] = [r for r in caplog.records if "planner/context" in r.getMessage()]
    assert "is left out" in record.getMessage()
    assert record.exc_info is None


def test_a_new_session_waits_longer_for_a_server(
    zenoh_bus: ZenohBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new session does not know the servers yet; an older session fails at once without one."""
    monkeypatch.setattr("helios_core.zenoh_bus.DISCOVERY_S", 0.0)
    monkeypatch.setattr("helios_core.zenoh_bus.MEETING_S", 20.0)
    asked = threading.Event()
    monkeypatch.setattr(
        "helios_core.zenoh_bus.assembled",
        lambda *given: asked.set() or zenoh_messages.assembled(*given),
    )
    threading.Thread(target=lambda: asked.wait(20) and zenoh_bus.serve(GET_TASK, _task)).start()
    assert zenoh_bus.call(GET_TASK, pb.TaskRequest(id="a"), 20).id == "a"
    monkeypatch.setattr("helios_core.zenoh_bus.MEETING_S", 0.0)
    with pytest.raises(Unavailable, match="nobody serves"):
        zenoh_bus.call(STOP, pb.StopRequest(), 20)


@pytest.mark.parametrize(
    "head", ["", "x", "1/2", "a/b/c", "0/1/-/-", "3/2/-", "0/0/-", b"\xff/1/-"]
)
def test_a_reply_without_a_valid_piece_header_is_an_internal_error(
    zenoh_bus: ZenohBus, session: zenoh.Session, head: str | bytes
) -> None:
    session.declare_queryable(GET, lambda query: query.reply(GET, b"", attachment=head))
    with pytest.raises(Internal, match="index/count/hash"):
        zenoh_bus.call(GET_TASK, pb.TaskRequest(), 5)


def test_an_undecodable_reply_is_an_internal_error(
    zenoh_bus: ZenohBus, session: zenoh.Session
) -> None:
    session.declare_queryable(GET, lambda query: query.reply(GET, b"\xff" * 50))
    with pytest.raises(Internal, match=r"50 bytes that planner/get answered"):
        zenoh_bus.call(GET_TASK, pb.TaskRequest(), 5)


def test_replies_that_cannot_be_sent_are_reported_once(
    zenoh_bus: ZenohBus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    asked: list[bytes] = []

    def no_way(data: bytes) -> list[tuple[bytes, str]]:
        asked.append(data)
        raise zenoh.ZError("no way out")

    monkeypatch.setattr(zenoh_messages, "pieces_of", no_way)
    zenoh_bus.serve(GET_TASK, _task)
    with caplog.at_level(logging.WARNING), pytest.raises(Unavailable, match="nobody serves"):
        zenoh_bus.call(GET_TASK, pb.TaskRequest(), 5)
    assert len(asked) > 1
    reported = [record.getMessage() for record in caplog.records]
    assert reported == ["a reply of planner/get could not be sent: no way out"]


def test_calls_that_wait_for_a_thread_are_limited_answered_and_know_when_they_arrived(
    zenoh_bus: ZenohBus, session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_core.zenoh_bus.MOST_WAITING", 2)
    running: list[str] = []
    arrivals_s: dict[str, float] = {}
    go_on = threading.Event()

    def hang(request: pb.TaskRequest) -> pb.Task:
        running.append(request.id)
        arrivals_s[request.id] = arrival_s()
        go_on.wait(30)
        return pb.Task(id=request.id)

    def ask(id: str) -> Any:
        return session.get(GET, payload=pb.TaskRequest(id=id).SerializeToString(), timeout=30)

    zenoh_bus.serve(GET_TASK, hang)
    server: Any = session.declare_querier(GET)
    wait_until(lambda: server.matching_status.matching, 60, "it serves")
    try:
        taken = [ask(str(n)) for n in range(SERVE_THREADS)]
        wait_until(lambda: len(running) == SERVE_THREADS, 60, "every thread of it hangs")
        taken += [ask("waits"), ask("waits, too")]
        (refused,) = ask("one too many")
        assert not go_on.is_set()
        error = error_from_proto(pb.Error.FromString(refused.err.payload.to_bytes()))
        assert isinstance(error, Unavailable)
        assert error.message == "2 calls of planner/get already wait; try again"
    finally:
        served_s = time.monotonic()
        go_on.set()
    answers = [pb.Task.FromString(only.ok.payload.to_bytes()).id for (only,) in taken]
    assert answers == [*map(str, range(SERVE_THREADS)), "waits", "waits, too"]
    assert max(arrivals_s["waits"], arrivals_s["waits, too"]) < served_s
    assert zenoh_bus.call(GET_TASK, pb.TaskRequest(id="later"), 20).id == "later"
    assert arrivals_s["later"] > served_s


def test_a_retained_topic_also_receives_messages_of_an_ordinary_publisher(
    zenoh_bus: ZenohBus, session: zenoh.Session
) -> None:
    got: list[pb.SearchContext] = []
    zenoh_bus.subscribe(CONTEXT, got.append)
    data = pb.SearchContext(id="plain").SerializeToString()
    wait_until(lambda: session.put(CONTEXT.key("r"), data) or bool(got), 60, "the message is heard")
    assert got[0].id == "plain"


def test_closing_waits_for_every_thread_that_a_bus_started(zenoh_bus: ZenohBus) -> None:
    """Also threads declared on a daemon thread: they are daemons and would be killed otherwise."""
    before, bus = set(threading.enumerate()), zenoh_bus

    def declare() -> None:
        bus.serve(STOP, lambda _: pb.Empty())
        bus.subscribe(FRAME, lambda _: None)
        bus.watch(lambda *_: None)

    declarer = threading.Thread(target=declare, daemon=True)
    declarer.start()
    declarer.join(10)
    started = set(threading.enumerate()) - before
    assert len(started) == 3
    assert started <= set(bus._readers)
    bus.close()
    wait_until(lambda: not any(thread.is_alive() for thread in started), 60, "they end")


def test_a_bus_that_closes_during_a_declaration_undoes_the_declaration(
    zenoh_bus: ZenohBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, before = zenoh_bus._start_reader, set(threading.enumerate())

    def closes_meanwhile(name: str, read: Callable[[], None]) -> None:
        start(name, read)
        zenoh_bus.close()

    monkeypatch.setattr(zenoh_bus, "_start_reader", closes_meanwhile)
    with pytest.raises(Unavailable, match="closed"):
        zenoh_bus.serve(STOP, lambda _: pb.Empty())
    assert len(zenoh_bus._mine) == 0
    wait_until(lambda: set(threading.enumerate()) <= before, 60, "its threads end")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for the memory")
def test_closed_buses_hold_no_shared_memory(router: str) -> None:
    """Each bus that sends frames takes 16 MB."""

    def sends_frames() -> None:
        bus = ZenohBus(router, "r")
        heard = threading.Event()
        bus.subscribe(KEYFRAME, lambda _: heard.set())
        frame = pb.Frame(raw_color=RawImage(data=bytes(1_500_000)))
        wait_until(lambda: bus.publish(KEYFRAME, frame) or heard.is_set(), 60, "a frame is heard")
        bus.close()

    before_mb = _shared_memory_mb()
    for _ in range(8):
        sends_frames()
    wait_until(
        lambda: gc.collect() >= 0 and _shared_memory_mb() < before_mb + 40, 60, "it is freed"
    )


def _shared_memory_mb() -> float:
    status = Path("/proc/self/status").read_text()
    return int(status.partition("RssShmem:")[2].split()[0]) / 1024
