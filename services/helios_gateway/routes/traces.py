"""`/tasks/{id}/trace`: the spans of a task, read from every service."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

from fastapi import APIRouter
from helios_core import proto as pb
from helios_core.bus_access import SERVICES
from helios_core.errors import HeliosError, Unavailable
from helios_core.printable_text import printable
from helios_core.topics import GET_TASK, spans_method
from helios_core.tracing import is_sampled, trace_id_of

from helios_gateway.api_keys import Scope
from helios_gateway.api_trace_models import Trace, TraceSource, TraceSpan
from helios_gateway.dependencies import AddressedRobot, CallTimeout, secured
from helios_gateway.error_responses import NotFound, invalid_as_not_found, problems
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.routes.tasks import TaskId

router = APIRouter(tags=["tasks"], dependencies=secured(Scope.READ))
NS = 1e-9
ONE_PROCESS = "services"  # spans that several services of one process answer with


@router.get("/tasks/{id}/trace", summary="Get the spans of a task", responses=problems(404))
def trace(robot: AddressedRobot, id: TaskId, timeout_s: CallTimeout) -> Trace:
    """Return what each service did for a task, as spans.

    Only a task that was submitted while tracing was on has a trace. Each service keeps its newest
    spans in memory; `sources` names the services whose spans are missing, and why.
    """
    with invalid_as_not_found():
        task = robot.bus.call(GET_TASK, pb.TaskRequest(id=id), timeout_s)
    trace_id = trace_id_of(task.traceparent)
    if not trace_id:
        raise NotFound(
            f"task {task.id} has no trace, because tracing was off when it was submitted; start "
            "HELIOS with `helios up --tracing`, then submit a task"
        )
    if not is_sampled(task.traceparent):
        raise NotFound(
            f"task {task.id} has no trace, because OTEL_TRACES_SAMPLER or the program that "
            "submitted it left it out; submit another, or let it sample all"
        )
    spans: dict[str, TraceSpan] = {}
    sources = []
    for service, reply, note in _replies(robot, trace_id, timeout_s):
        for span in reply.spans:
            name = ONE_PROCESS if span.span_id in spans else service
            spans[span.span_id] = _model(name, span)
        kept_since_s = reply.kept_since_ns * NS
        if not note and kept_since_s > task.created_s:
            since = datetime.fromtimestamp(kept_since_s, UTC).strftime("%H:%M:%S")
            note = f"its spans from before {since} UTC are no longer in memory"
        sources.append(TraceSource(service=service, spans=len(reply.spans), note=note))
    in_order = sorted(spans.values(), key=lambda span: span.start_s)
    return Trace(task_id=task.id, trace_id=trace_id, spans=in_order, sources=sources)


def _replies(
    robot: RobotEndpoint, trace_id: str, timeout_s: float
) -> Iterator[tuple[str, pb.SpansReply, str]]:
    """(service, its reply, why it gave none) of every live service."""
    for service in SERVICES:
        if not robot.monitor.services.is_alive(service):
            continue
        request = pb.SpansRequest(trace_id=trace_id)
        try:
            yield service, robot.bus.call(spans_method(service), request, timeout_s), ""
        except Unavailable as error:
            why = f"it does not answer, or runs without tracing: {printable(error.message)}"
            yield service, pb.SpansReply(), why
        except HeliosError as error:
            yield service, pb.SpansReply(), printable(error.message)


def _model(service: str, span: pb.Span) -> TraceSpan:
    return TraceSpan(
        service=service,
        id=span.span_id,
        parent_id=span.parent_id,
        name=printable(span.name),
        start_s=span.start_ns * NS,
        end_s=span.end_ns * NS,
        attributes=dict(sorted(span.attributes.items())),
        error=printable(span.error),
    )
