"""Form of a service's log lines: text for people, or one JSON object per line for programs."""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator

from helios_core import tracing

LOG_FORMATS = ("text", "json")


def _known(name: str) -> str:
    if name.lower() not in LOG_FORMATS:
        raise ValueError(
            f"no log format is called {name!r}; choose one of {', '.join(LOG_FORMATS)}"
        )
    return name.lower()


LogFormat = Annotated[str, AfterValidator(_known)]


def configure(service: str | logging.Filter, robot: str, level: str, form: str) -> None:
    """Send the log of this process to standard error in the given form.

    service: the name of the service, or a filter that sets it on each record.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(OneService(service) if isinstance(service, str) else service)
    if form == "json":
        handler.setFormatter(JsonLines(robot))
    else:
        text = "%(asctime)s %(service)s %(levelname)s %(message)s"
        handler.setFormatter(logging.Formatter(text))
    logging.basicConfig(level=level.upper(), handlers=[handler])


class OneService(logging.Filter):
    """Sets the same service on every record."""

    def __init__(self, service: str) -> None:
        super().__init__()
        self._service = service

    def filter(self, record: logging.LogRecord) -> bool:
        record.service = self._service
        return True


class JsonLines(logging.Formatter):
    """Formatter of one JSON object per line.

    Always: time (ISO 8601, UTC), level, service, robot, logger, message. Where known: task,
    keyframe, trace_id and span_id as in OpenTelemetry, exception (the traceback).
    """

    def __init__(self, robot: str) -> None:
        super().__init__()
        self._robot = robot

    def format(self, record: logging.LogRecord) -> str:
        ids, traceparent = tracing.work_ids(), tracing.current_traceparent()
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "service": getattr(record, "service", ""),
            "robot": self._robot,
            "logger": record.name,
            "message": record.getMessage(),
        }
        more = {
            "task": ids.task,
            "keyframe": ids.keyframe,
            "trace_id": tracing.trace_id_of(traceparent),
            "span_id": tracing.span_id_of(traceparent),
            "exception": self.formatException(record.exc_info) if record.exc_info else "",
        }
        known = {name: value for name, value in more.items() if value}
        return json.dumps(line | known, ensure_ascii=False)
