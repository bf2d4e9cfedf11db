"""Recording of spans with the OpenTelemetry SDK: turned on by a setting or by `OTEL_…` variables.

The newest spans of a process stay in its memory, and `<service>/spans` hands them out. They are
also exported if `OTEL_EXPORTER_OTLP_ENDPOINT`, `OTEL_EXPORTER_OTLP_TRACES_ENDPOINT` or
`OTEL_TRACES_EXPORTER` is set. The SDK itself reads the other standard variables (headers, timeout,
sampler, batch sizes).
"""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

from helios_core import proto as pb
from helios_core import tracing
from helios_core.bus import Bus
from helios_core.errors import InvalidInput
from helios_core.topics import spans_method

if TYPE_CHECKING:  # the SDK is imported only if tracing is on
    from opentelemetry.context import Context
    from opentelemetry.sdk.trace import ReadableSpan, SpanProcessor, TracerProvider
    from opentelemetry.trace import Span as OtelSpan

log = logging.getLogger(__name__)

ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
EXPORTER = "OTEL_TRACES_EXPORTER"
NOT_INSTALLED = "tracing needs the OpenTelemetry SDK: pip install 'helios-ovmm[tracing]'"
KEPT_SPANS = 20_000  # per process; about a thousand steps
FLUSH_WITHIN_S = 0.5  # at the end of a process, which has two seconds in all

_running: SpanRecording | None = None  # of this process


def is_requested(setting: bool, environment: Mapping[str, str]) -> bool:
    """True if the setting or a standard variable asks for tracing."""
    if environment.get("OTEL_SDK_DISABLED", "").strip().lower() == "true":
        return False
    return setting or _is_exported(environment)


def _is_exported(environment: Mapping[str, str]) -> bool:
    chosen = environment.get(EXPORTER, "").strip().lower()
    if chosen:
        return chosen != "none"
    return any(environment.get(name, "").strip() for name in ENDPOINTS)


def start(service: str, robot: str, setting: bool) -> SpanRecording | None:
    """Turn tracing on if it is requested; None if it is not.

    Raises InvalidInput if the setting asks for it and the SDK is not installed. A variable may be
    meant for other programs: then one warning says so.
    """
    if not is_requested(setting, os.environ):
        return None
    if find_spec("opentelemetry") is None or find_spec("opentelemetry.sdk") is None:
        if setting:
            raise InvalidInput(f"{NOT_INSTALLED}, or leave out --tracing")
        log.warning("no span is exported, although OTEL_… variables ask for it: %s", NOT_INSTALLED)
        return None
    try:
        exporters = _exporting(os.environ)
    except ImportError as error:  # the SDK is there without this exporter
        if setting:
            raise InvalidInput(f"{NOT_INSTALLED}, or leave out --tracing ({error})") from error
        log.warning("no span is exported, although OTEL_… variables ask for it: %s", error)
        return None
    global _running
    _running = SpanRecording(service, robot, exporters)
    tracing.use(_running)
    return _running


def serve(bus: Bus, service: str) -> None:
    """Let others read this process's spans as those of a service; nothing if tracing is off."""
    if _running is not None:
        bus.serve(spans_method(service), _running.kept.answer)


class SpanRecording(tracing.Recorder):
    """Spans of one process: kept in memory, and given to exporters."""

    def __init__(self, service: str, robot: str, exporters: tuple[SpanProcessor, ...] = ()) -> None:
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider

        about = {"service.namespace": "helios", "helios.robot": robot}
        named = os.environ.get("OTEL_SERVICE_NAME", "")  # of one deployment, not of one service
        about |= {"service.name": f"{named}-{service}" if named else f"helios-{service}"}
        self.kept = KeptSpans()
        self._provider: TracerProvider = TracerProvider(
            resource=Resource.create(about), shutdown_on_exit=False
        )
        for processor in (_processor(self.kept), *exporters):
            self._provider.add_span_processor(processor)
        self._tracer = self._provider.get_tracer("helios")

    @contextmanager
    def span(
        self, name: str, parent: str, attributes: dict[str, str | float]
    ) -> Iterator[tracing.Span]:
        from opentelemetry import context, trace

        begun = self._tracer.start_span(name, _remote(parent), attributes=attributes)
        token = context.attach(trace.set_span_in_context(begun))
        try:
            yield _Span(begun)
        except BaseException as error:
            begun.set_status(trace.StatusCode.ERROR, f"{type(error).__name__}: {error}"[:200])
            raise
        finally:
            context.detach(token)
            begun.end()

    @contextmanager
    def continuing(self, traceparent: str) -> Iterator[None]:
        from opentelemetry import context

        remote = _remote(traceparent)
        assert remote is not None
        token = context.attach(remote)
        try:
            yield
        finally:
            context.detach(token)

    def current(self) -> str:
        from opentelemetry import trace

        at = trace.get_current_span().get_span_context()
        if not at.is_valid:
            return ""
        return f"00-{at.trace_id:032x}-{at.span_id:016x}-{at.trace_flags:02x}"

    def present(self) -> tracing.Span:
        from opentelemetry import trace

        return _Span(trace.get_current_span())

    def close(self) -> None:
        """Turn tracing off, and export what is left within `FLUSH_WITHIN_S`."""
        global _running
        tracing.use(None)
        _running = None
        ending = threading.Thread(target=self._provider.shutdown, name="last spans", daemon=True)
        ending.start()
        ending.join(FLUSH_WITHIN_S)
        if ending.is_alive():
            log.warning("the last spans were not exported: the collector does not answer")


class _Span:
    def __init__(self, begun: OtelSpan) -> None:
        self._begun = begun

    def rename(self, name: str) -> None:
        self._begun.update_name(name)

    def set(self, name: str, value: str | float) -> None:
        self._begun.set_attribute(name, value)


class KeptSpan(NamedTuple):
    """What is kept of an ended span; times in nanoseconds since 1970."""

    trace_id: int
    span_id: int
    parent_id: int  # 0: none
    name: str
    start_ns: int
    end_ns: int
    attributes: tuple[tuple[str, object], ...]
    error: str


class KeptSpans:
    """The newest ended spans of this process. Thread-safe."""

    def __init__(self, most: int = KEPT_SPANS) -> None:
        self._spans: deque[KeptSpan] = deque(maxlen=most)
        self._dropped = False
        self._lock = threading.Lock()

    def add(self, span: ReadableSpan) -> None:
        assert span.context is not None
        kept = KeptSpan(
            span.context.trace_id,
            span.context.span_id,
            span.parent.span_id if span.parent is not None else 0,
            span.name,
            span.start_time or 0,
            span.end_time or 0,
            tuple((span.attributes or {}).items()),
            span.status.description or "",
        )
        with self._lock:
            self._dropped |= len(self._spans) == self._spans.maxlen
            self._spans.append(kept)

    def answer(self, request: pb.SpansRequest) -> pb.SpansReply:
        """Spans of one trace, in the order in which they ended."""
        with self._lock:
            spans, dropped = list(self._spans), self._dropped
        oldest_ns = spans[0].end_ns if spans and dropped else 0
        try:
            wanted = int(request.trace_id, 16)
        except ValueError:
            raise InvalidInput(
                f"trace_id is {request.trace_id[:40]!r}; wanted 32 hexadecimal digits"
            ) from None
        return pb.SpansReply(
            spans=[_to_proto(s) for s in spans if s.trace_id == wanted], kept_since_ns=oldest_ns
        )


def _to_proto(span: KeptSpan) -> pb.Span:
    return pb.Span(
        trace_id=f"{span.trace_id:032x}",
        span_id=f"{span.span_id:016x}",
        parent_id=f"{span.parent_id:016x}" if span.parent_id else "",
        name=span.name,
        start_ns=span.start_ns,
        end_ns=span.end_ns,
        attributes={name: str(value) for name, value in span.attributes},
        error=span.error,
    )


def _processor(kept: KeptSpans) -> SpanProcessor:
    from opentelemetry.sdk.trace import SpanProcessor

    class Keeper(SpanProcessor):
        def on_end(self, span: ReadableSpan) -> None:
            kept.add(span)

    return Keeper()


def _exporting(environment: Mapping[str, str]) -> tuple[SpanProcessor, ...]:
    """Processors of the exporters that the standard variables name."""
    if not _is_exported(environment):
        return ()
    from opentelemetry.sdk.trace.export import BatchSpanProcessor, ConsoleSpanExporter

    out: list[SpanProcessor] = []
    for name in (environment.get(EXPORTER, "").strip() or "otlp").lower().split(","):
        if name.strip() == "otlp":
            from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter

            out.append(BatchSpanProcessor(OTLPSpanExporter()))
        elif name.strip() == "console":
            out.append(BatchSpanProcessor(ConsoleSpanExporter()))
        else:
            log.warning("%s names %r; HELIOS exports to otlp or console", EXPORTER, name.strip())
    return tuple(out)


def _remote(traceparent: str) -> Context | None:
    """Context with the span of another process; None: the present context."""
    if not traceparent:
        return None
    from opentelemetry import trace

    _, trace_id, span_id, flags = traceparent.split("-")
    sampled = trace.TraceFlags(int(flags, 16))
    at = trace.SpanContext(int(trace_id, 16), int(span_id, 16), True, sampled)
    return trace.set_span_in_context(trace.NonRecordingSpan(at))
