"""Traces across processes: the span of a sender is the parent of the receiver's spans."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh
from helios_core import proto as pb
from helios_core import tracing
from helios_core.span_recording import SpanRecording
from helios_core.topics import CONTEXT, FRAME, GET_TASK, KEYFRAME, Topic
from helios_core.zenoh_bus import ZenohBus

from tests.support import wait_until

export = pytest.importorskip("opentelemetry.sdk.trace.export", reason="extra tracing is missing")
memory = pytest.importorskip("opentelemetry.sdk.trace.export.in_memory_span_exporter")

MESSAGES: dict[Topic, Callable[[], Any]] = {
    KEYFRAME: lambda: pb.Frame(keyframe=True),
    CONTEXT: lambda: pb.SearchContext(id="c"),
}


@pytest.fixture
def exported() -> Iterator[Any]:
    exporter = memory.InMemorySpanExporter()
    recording = SpanRecording("planner", "r", (export.SimpleSpanProcessor(exporter),))
    tracing.use(recording)
    yield exporter
    recording.close()


@pytest.fixture
def other_bus(router: str) -> Iterator[ZenohBus]:
    bus = ZenohBus(router, "r")
    yield bus
    bus.close()


def parent_of(exported: Any, child: str, parent: str) -> bool:
    spans = {span.name: span for span in exported.get_finished_spans()}
    return spans[child].parent.span_id == spans[parent].context.span_id


@pytest.mark.parametrize("topic", MESSAGES, ids=lambda topic: topic.name)
def test_a_message_carries_the_senders_span(
    topic: Topic, zenoh_bus: ZenohBus, other_bus: ZenohBus, exported: Any
) -> None:
    came = threading.Event()

    def take(_: Any) -> None:
        with tracing.span("handler"):
            pass
        if tracing.current_traceparent():
            came.set()

    zenoh_bus.subscribe(topic, take)

    def sent_and_received() -> bool:
        with tracing.span("sender"):
            other_bus.publish(topic, MESSAGES[topic]())
        return came.wait(0.1)

    wait_until(sent_and_received, 60, "a message came with its span")
    spans = exported.get_finished_spans()
    senders = {span.context.span_id for span in spans if span.name == "sender"}
    parents = {span.parent.span_id for span in spans if span.name == "handler"}
    assert parents
    assert parents <= senders


def test_a_request_carries_the_callers_span(
    zenoh_bus: ZenohBus, other_bus: ZenohBus, exported: Any
) -> None:
    zenoh_bus.serve(GET_TASK, lambda request: pb.Task(id=request.id))
    with tracing.span("caller"):
        assert other_bus.call(GET_TASK, pb.TaskRequest(id="a"), 10).id == "a"
    wait_until(lambda: len(exported.get_finished_spans()) == 2, 60, "both spans have ended")
    assert parent_of(exported, "planner/get", "caller")


def test_a_client_that_knows_nothing_of_traces_is_served(
    zenoh_bus: ZenohBus, session: zenoh.Session, exported: Any
) -> None:
    zenoh_bus.serve(GET_TASK, lambda request: pb.Task(id=request.id))
    key, payload = GET_TASK.key("r"), pb.TaskRequest(id="a").SerializeToString()

    def answered(attachment: str | None) -> bool:
        replies = session.get(key, payload=payload, attachment=attachment)
        return [r.ok is not None for r in replies] == [True]

    wait_until(lambda: answered(None), 60, "it serves")
    assert answered("traceparent=broken")
    assert answered("anything else")
    assert not exported.get_finished_spans()


def test_latest_wins_messages_keep_their_own_attachment(
    zenoh_bus: ZenohBus, session: zenoh.Session, exported: Any
) -> None:
    subscriber = session.declare_subscriber(FRAME.key("r"), zenoh.handlers.FifoChannel(8))

    def attached() -> list[str]:
        with tracing.span("sender"):
            zenoh_bus.publish(FRAME, pb.Frame())
        samples = iter(subscriber.try_recv, None)
        return [s.attachment.to_string() for s in samples if s.attachment is not None]

    found: list[str] = []
    wait_until(lambda: found.extend(attached()) or found, 60, "a frame came")
    assert all(text.count("/") == 1 and "traceparent" not in text for text in found)
