"""Spans: nothing without tracing, and parents, ids and errors with it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core import span_recording, tracing
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.span_recording import KEPT_SPANS, KeptSpans, SpanRecording, is_requested
from helios_core.topics import GET_TASK
from hypothesis import given
from hypothesis import strategies as st

sdk = pytest.importorskip("opentelemetry.sdk.trace.export", reason="extra tracing is missing")
memory = pytest.importorskip("opentelemetry.sdk.trace.export.in_memory_span_exporter")

TRACE, SPAN = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"
TRACEPARENT = f"00-{TRACE}-{SPAN}-01"
SERVICES = (
    "helios_bridge",
    "helios_detector",
    "helios_map2d",
    "helios_objectmap",
    "helios_planner",
    "helios_recorder",
    "helios_sim",
)


@pytest.fixture
def exported() -> Iterator[Any]:
    """Exporter in memory; tracing is on during the test."""
    exporter = memory.InMemorySpanExporter()
    recording = SpanRecording("planner", "r", (sdk.SimpleSpanProcessor(exporter),))
    tracing.use(recording)
    yield exporter
    recording.close()


def named(exported: Any) -> dict[str, Any]:
    return {span.name: span for span in exported.get_finished_spans()}


def test_services_without_tracing_do_not_import_opentelemetry() -> None:
    imports = "".join(f"import {name}.service\n" for name in SERVICES)
    code = (
        "import sys, os\n"
        "for name in list(os.environ):\n"
        "    if name.startswith('OTEL_'): del os.environ[name]\n"
        f"{imports}"
        "from helios_core import span_recording, tracing\n"
        "assert span_recording.start('planner', 'r', False) is None\n"
        "with tracing.span('a', task='t'): assert tracing.attachment() is None\n"
        "print([m for m in sys.modules if m.startswith('opentelemetry')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_work_without_tracing_still_carries_ids_and_sends_no_attachment() -> None:
    assert not tracing.is_on()
    with tracing.span("outer", task="t"), tracing.span("inner", keyframe="k") as span:
        assert tracing.work_ids() == tracing.WorkIds("t", "k")
        assert tracing.attachment() is None
        span.set("a", 1)
        span.rename("b")
    assert tracing.work_ids() == tracing.WorkIds()


def test_a_span_belongs_to_the_one_around_it(exported: Any) -> None:
    with tracing.span("outer", task="t", keyframe="k"), tracing.span("inner", rule="eq. 10"):
        pass
    spans = named(exported)
    assert spans["inner"].parent.span_id == spans["outer"].context.span_id
    assert spans["outer"].parent is None
    assert dict(spans["outer"].attributes) == {"helios.task": "t", "helios.keyframe": "k"}
    assert dict(spans["inner"].attributes) == {"rule": "eq. 10"}
    assert dict(spans["outer"].resource.attributes)["service.name"] == "helios-planner"


def test_a_received_traceparent_is_the_parent(exported: Any) -> None:
    with tracing.received(b"traceparent=" + TRACEPARENT.encode()), tracing.span("work"):
        sent = tracing.attachment()
    work = named(exported)["work"]
    assert f"{work.context.trace_id:032x}" == TRACE
    assert f"{work.parent.span_id:016x}" == SPAN
    assert sent == f"traceparent=00-{TRACE}-{work.context.span_id:016x}-01".encode()


def test_an_error_is_recorded_and_goes_on(exported: Any) -> None:
    with pytest.raises(InvalidInput), tracing.span("work"):
        raise InvalidInput("the mug is no number")
    assert "the mug is no number" in named(exported)["work"].status.description


def test_a_request_is_a_span_only_within_a_trace(exported: Any) -> None:
    with tracing.served("planner/get", None):
        pass
    assert not exported.get_finished_spans()
    with tracing.served("planner/get", f"traceparent={TRACEPARENT}".encode()):
        pass
    assert list(named(exported)) == ["planner/get"]


def test_an_unsampled_trace_stays_unsampled(exported: Any) -> None:
    with tracing.span("work", parent=f"00-{TRACE}-{SPAN}-00"):
        sent = tracing.current_traceparent()
    assert sent.endswith("-00")
    assert not exported.get_finished_spans()


def test_the_memory_bus_passes_the_span_on(exported: Any) -> None:
    hub = MemoryHub()

    def get(request: pb.TaskRequest) -> pb.Task:
        with tracing.span("handler"):
            return pb.Task(id=request.id)

    MemoryBus(hub).serve(GET_TASK, get)
    with tracing.span("caller"):
        MemoryBus(hub).call(GET_TASK, pb.TaskRequest(id="a"), 5)
    spans = named(exported)
    assert spans["handler"].parent.span_id == spans["caller"].context.span_id


@given(st.binary(max_size=80))
def test_any_other_attachment_is_ignored(attached: bytes) -> None:
    found = tracing.traceparent_of(attached)
    assert not found or attached == b"traceparent=" + found.encode()


@given(st.integers(0, 2**128 - 1), st.integers(0, 2**64 - 1), st.integers(0, 255))
def test_a_traceparent_is_valid_unless_an_id_is_zero(trace: int, span: int, flags: int) -> None:
    text = f"00-{trace:032x}-{span:016x}-{flags:02x}"
    assert bool(tracing.valid(text)) == (trace > 0 and span > 0)
    if trace and span:
        assert tracing.trace_id_of(text) == f"{trace:032x}"
        assert tracing.span_id_of(text) == f"{span:016x}"


@pytest.mark.parametrize(
    ("setting", "environment", "on"),
    [
        (False, {}, False),
        (True, {}, True),
        (False, {"OTEL_EXPORTER_OTLP_ENDPOINT": "http://localhost:4318"}, True),
        (False, {"OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": "http://localhost/v1/traces"}, True),
        (False, {"OTEL_TRACES_EXPORTER": "console"}, True),
        (False, {"OTEL_TRACES_EXPORTER": "none", "OTEL_EXPORTER_OTLP_ENDPOINT": "http://a"}, False),
        (True, {"OTEL_SDK_DISABLED": "true"}, False),
        (False, {"OTEL_EXPORTER_OTLP_ENDPOINT": " "}, False),
    ],
)
def test_tracing_is_on_if_the_setting_or_a_standard_variable_asks_for_it(
    setting: bool, environment: dict[str, str], on: bool
) -> None:
    assert is_requested(setting, environment) is on


def test_a_missing_sdk_is_an_error_only_if_the_setting_asks_for_tracing(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(span_recording, "find_spec", lambda name: None)
    with pytest.raises(InvalidInput, match=r"pip install 'helios-ovmm\[tracing\]'"):
        span_recording.start("planner", "r", True)
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://localhost:4318")
    assert span_recording.start("planner", "r", False) is None
    assert "no span is exported" in caplog.text


def test_a_missing_exporter_is_an_error_only_if_the_setting_asks_for_tracing(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.exporter.otlp.proto.http.trace_exporter", None)
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://localhost:4318")
    with pytest.raises(InvalidInput, match=r"pip install 'helios-ovmm\[tracing\]'"):
        span_recording.start("planner", "r", True)
    assert span_recording.start("planner", "r", False) is None
    assert "no span is exported" in caplog.text


def test_the_process_hands_out_the_spans_of_one_trace(exported: Any) -> None:
    kept = KeptSpans()
    with tracing.span("other"):
        pass
    with tracing.span("work", parent=TRACEPARENT, task="t", frames=3):
        pass
    for span in exported.get_finished_spans():
        kept.add(span)
    reply = kept.answer(pb.SpansRequest(trace_id=TRACE))
    (work,) = reply.spans
    assert (work.name, work.trace_id, work.parent_id) == ("work", TRACE, SPAN)
    assert dict(work.attributes) == {"helios.task": "t", "frames": "3"}
    assert work.end_ns >= work.start_ns > 0
    assert reply.kept_since_ns == 0
    with pytest.raises(InvalidInput, match="32 hexadecimal digits"):
        kept.answer(pb.SpansRequest(trace_id="mug"))


def test_the_kept_spans_are_limited_and_say_since_when(exported: Any) -> None:
    kept = KeptSpans(most=3)
    for number in range(5):
        with tracing.span(f"work {number}", parent=TRACEPARENT):
            pass
    for span in exported.get_finished_spans():
        kept.add(span)
    reply = kept.answer(pb.SpansRequest(trace_id=TRACE))
    assert [span.name for span in reply.spans] == ["work 2", "work 3", "work 4"]
    assert reply.kept_since_ns == reply.spans[0].end_ns
    assert KEPT_SPANS >= 10_000
