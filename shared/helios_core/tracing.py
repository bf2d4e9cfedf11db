"""Pieces of work with the ids that their log lines carry, and, if tracing is on, their spans.

    with span("detection", keyframe=str(id), task=context.id):
        ...

The log lines of the block then name its task and keyframe (`log_format`). If `span_recording` has
turned tracing on in this process, the block is also recorded as a span, and the bus attaches the
span's W3C `traceparent` to every message and request that the block sends. Without tracing nothing
here imports OpenTelemetry, and the bus attaches nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol

ATTACHED = b"traceparent="  # begins an attachment that carries a traceparent
# Version 00 of the W3C recommendation. All zeros are not a valid id.
TRACEPARENT = re.compile(r"00-(?!0{32})[0-9a-f]{32}-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}")


@dataclass(frozen=True)
class WorkIds:
    """Task and keyframe that the present work belongs to; empty if there is none."""

    task: str = ""
    keyframe: str = ""


class Span(Protocol):
    """One recorded piece of work."""

    def rename(self, name: str) -> None: ...

    def set(self, name: str, value: str | float) -> None:
        """Set an attribute."""
        ...


class Recorder(Protocol):
    """Records spans. `span_recording` implements it with OpenTelemetry."""

    def span(
        self, name: str, parent: str, attributes: dict[str, str | float]
    ) -> AbstractContextManager[Span]:
        """Record the block. parent: a traceparent; empty: the span around it, if there is one."""
        ...

    def continuing(self, traceparent: str) -> AbstractContextManager[object]:
        """Make the span of another process the parent of the spans in the block."""
        ...

    def current(self) -> str:
        """Traceparent of the present span; empty without one."""
        ...

    def present(self) -> Span: ...


class _NoSpan:
    def rename(self, name: str) -> None:
        pass

    def set(self, name: str, value: str | float) -> None:
        pass


NO_SPAN: Span = _NoSpan()
_NOTHING = nullcontext()
_NO_IDS = WorkIds()
_ids: ContextVar[WorkIds] = ContextVar("work ids", default=_NO_IDS)
_recorder: Recorder | None = None


def use(recorder: Recorder | None) -> None:
    """Turn tracing on in this process; None turns it off."""
    global _recorder
    _recorder = recorder


def is_on() -> bool:
    """True if this process records spans."""
    return _recorder is not None


def work_ids() -> WorkIds:
    """Task and keyframe of the present work."""
    return _ids.get()


@contextmanager
def span(
    name: str, *, task: str = "", keyframe: str = "", parent: str = "", **attributes: str | float
) -> Iterator[Span]:
    """A piece of work: its log lines carry the ids, and it is recorded if tracing is on.

    parent: traceparent of the span that it belongs to; empty: the present one.
    """
    before = _ids.get()
    token = _ids.set(WorkIds(task or before.task, keyframe or before.keyframe))
    try:
        if _recorder is None:
            yield NO_SPAN
        else:
            given = {"helios.task": task, "helios.keyframe": keyframe, **attributes}
            known = {key: value for key, value in given.items() if value != ""}
            with _recorder.span(name, parent, known) as recorded:
                yield recorded
    finally:
        _ids.reset(token)


def present_span() -> Span:
    """The span of the present work."""
    return NO_SPAN if _recorder is None else _recorder.present()


def current_traceparent() -> str:
    """Traceparent of the present span; empty without one, and if tracing is off."""
    return "" if _recorder is None else _recorder.current()


def attachment() -> bytes | None:
    """Attachment for a message or request of the present work; None if nothing is to be sent."""
    current = current_traceparent()
    return ATTACHED + current.encode() if current else None


def received(attached: bytes | None) -> AbstractContextManager[object]:
    """Context for the handler of a message with this attachment; others change nothing."""
    return _NOTHING if _recorder is None else continuing(traceparent_of(attached))


def continuing(traceparent: str) -> AbstractContextManager[object]:
    """Context whose spans belong to that span; no change for an empty text."""
    return _recorder.continuing(traceparent) if _recorder and traceparent else _NOTHING


@contextmanager
def served(method: str, attached: bytes | None) -> Iterator[None]:
    """Context for the handler of a request: a span, if the request belongs to a trace."""
    traceparent = traceparent_of(attached) if _recorder is not None else ""
    if not traceparent:
        yield
        return
    with span(method, parent=traceparent):
        yield


def traceparent_of(attached: bytes | None) -> str:
    """Traceparent in an attachment; empty if it has none."""
    if not attached or not attached.startswith(ATTACHED):
        return ""
    text = attached[len(ATTACHED) :].decode("ascii", "replace")
    return valid(text)


def valid(traceparent: str) -> str:
    """The traceparent, or an empty text if it is not one of version 00."""
    return traceparent if TRACEPARENT.fullmatch(traceparent) else ""


def trace_id_of(traceparent: str) -> str:
    """Trace id in a traceparent; empty for an empty one."""
    return traceparent.split("-")[1] if valid(traceparent) else ""


def span_id_of(traceparent: str) -> str:
    """Span id in a traceparent; empty for an empty one."""
    return traceparent.split("-")[2] if valid(traceparent) else ""


def is_sampled(traceparent: str) -> bool:
    """True if the spans of a trace are recorded."""
    return bool(valid(traceparent)) and bool(int(traceparent.split("-")[3], 16) & 1)
