"""Traces across processes: the span of a sender is the parent of the receiver's spans."""

from __future__ import annotations

import gzip
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
import zenoh
from helios_core import proto as pb
from helios_core import tracing
from helios_core.span_recording import SpanRecording
from helios_core.topics import CONTEXT, FRAME, GET_TASK, KEYFRAME, Topic
from helios_core.zenoh_bus import ZenohBus

from tests.helios_up import started
from tests.support import free_port, wait_until

export = pytest.importorskip("opentelemetry.sdk.trace.export", reason="extra tracing is missing")
memory = pytest.importorskip("opentelemetry.sdk.trace.export.in_memory_span_exporter")
otlp = pytest.importorskip("opentelemetry.proto.collector.trace.v1.trace_service_pb2")

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

    wait_until(sent_and_received, 10, "a message came with its span")
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
    wait_until(lambda: len(exported.get_finished_spans()) == 2, 10, "both spans have ended")
    assert parent_of(exported, "planner/get", "caller")


def test_a_client_that_knows_nothing_of_traces_is_served(
    zenoh_bus: ZenohBus, session: zenoh.Session, exported: Any
) -> None:
    zenoh_bus.serve(GET_TASK, lambda request: pb.Task(id=request.id))
    key, payload = GET_TASK.key("r"), pb.TaskRequest(id="a").SerializeToString()

    def answered(attachment: str | None) -> bool:
        replies = session.get(key, payload=payload, attachment=attachment)
        return [r.ok is not None for r in replies] == [True]

    wait_until(lambda: answered(None), 10, "it serves")
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
    wait_until(lambda: found.extend(attached()) or found, 10, "a frame came")
    assert all(text.count("/") == 1 and "traceparent" not in text for text in found)


class Collector:
    """Receiver of OTLP over HTTP, as a collector's, that keeps what it was sent."""

    def __init__(self) -> None:
        self.requests: list[Any] = []
        collector = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                assert self.path == "/v1/traces"
                body = self.rfile.read(int(self.headers["content-length"]))
                if self.headers.get("content-encoding") == "gzip":
                    body = gzip.decompress(body)
                collector.requests.append(otlp.ExportTraceServiceRequest.FromString(body))
                self.send_response(200)
                self.send_header("content-type", "application/x-protobuf")
                self.end_headers()

            def log_message(self, format: str, *args: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.endpoint = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def spans(self) -> dict[str, tuple[str, Any]]:
        """(service, span) by the span's name."""
        out = {}
        for request in self.requests:
            for resource in request.resource_spans:
                about = {a.key: a.value.string_value for a in resource.resource.attributes}
                for scope in resource.scope_spans:
                    out |= {span.name: (about["service.name"], span) for span in scope.spans}
        return out

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


def test_processes_export_one_trace_to_a_collector(router: str, tmp_path: Path) -> None:
    """HTTP request -> gateway -> planner, in two processes, with standard variables only."""
    collector, port = Collector(), free_port()
    environment = {
        "OTEL_EXPORTER_OTLP_ENDPOINT": collector.endpoint, "OTEL_BSP_SCHEDULE_DELAY": "200",
    }  # fmt: skip
    bus = ("--router", router, "--robot", "traced")
    with ExitStack() as stack:
        stack.callback(collector.close)
        for module, *flags in (
            ("helios_gateway", "--port", str(port)),
            ("helios_planner", "--state-dir", str(tmp_path)),
        ):
            argv = [sys.executable, "-m", module, *bus, *flags]
            stack.enter_context(started(argv, tmp_path / f"{module}.log", environment))
        headers = {"traceparent": "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"}

        def submitted() -> bool:
            try:
                answer = httpx.post(
                    f"http://127.0.0.1:{port}/v1/tasks", json={"instruction": "explore the home"},
                    headers=headers, timeout=10, trust_env=False,
                )  # fmt: skip
            except httpx.TransportError:
                return False
            return answer.status_code == 202

        wait_until(submitted, 120, "the task is taken")
        wait_until(lambda: "planner/submit" in collector.spans(), 30, "the planner's span came")
        wait_until(lambda: "POST /v1/tasks" in collector.spans(), 30, "the gateway's span came")
    spans = collector.spans()
    who, request = spans["POST /v1/tasks"]
    assert who == "helios-gateway"
    assert request.trace_id.hex() == "0af7651916cd43dd8448eb211c80319c"
    assert request.parent_span_id.hex() == "b7ad6b7169203331"
    who, submit = spans["planner/submit"]
    assert who == "helios-planner"
    assert submit.trace_id == request.trace_id
