"""Every answer conforms to the OpenAPI description, whatever the request (schemathesis)."""

from __future__ import annotations

import functools
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
import schemathesis
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import spans_method
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.faults.findings import stop
from helios_gateway.fleet.records import FleetTask
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings as GatewaySettings
from helios_gateway.web_app import create_app
from hypothesis import HealthCheck, given, settings
from schemathesis.checks import not_a_server_error
from schemathesis.core.result import Ok
from schemathesis.schemas import APIOperation
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
    unsupported_method,
)

from tests.gateway_backend import Backend

HEALTHY = (HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large)


@schemathesis.serializer("application/zip")
def as_it_is(context: object, value: object) -> bytes:
    return value if isinstance(value, bytes) else str(value).encode()


def not_a_fault(
    ctx: schemathesis.CheckContext, response: schemathesis.Response, case: schemathesis.Case
) -> bool | None:
    """Accept 503, which reports a missing service: the fake backend lacks some services."""
    return None if response.status_code == 503 else not_a_server_error(ctx, response, case)


CHECKS = [
    not_a_fault,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    unsupported_method,
]
# A stream without an end; test_gateway_interface.py tests it.
ENDLESS = "^/v1/events$"
SPAN = pb.Span(span_id="b7ad6b7169203331", name="task", start_ns=10**18, end_ns=2 * 10**18)
RECORDING = "20260101T000000Z-robot-stopped.mcap"
NAMES = {  # that exist
    "id": "t1",
    "layer": "pick",
    "name": "planner",
    "fault": "robot-stopped",
    "recording": RECORDING,
}


class Rig:
    """The gateway of a robot whose services all answer; it requires keys."""

    def __init__(self) -> None:
        hub = MemoryHub()
        patient = ["--silent-after-s", "3600"]
        self._folder = tempfile.TemporaryDirectory()  # removed when the process ends
        folder = Path(self._folder.name)
        faults = folder / "faults"
        live = RobotMonitor(
            MemoryBus(hub), GatewaySettings.load([*patient, "--faults", str(faults)])
        )
        live.faults.observe([stop("a cat")])
        live.faults.observe([])
        (faults / "robot" / RECORDING).write_bytes(b"")
        self.backend = Backend(hub)
        self.backend.start()
        self.backend.serve_settings("planner", {"agent": "helios"})
        task = self.backend.submit("move the mug to the kitchen counter")
        task.traceparent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
        self.backend.bus.serve(spans_method("planner"), lambda _: pb.SpansReply(spans=[SPAN]))
        self.backend.decide()
        self.backend.publish_observation(self.backend.publish_frame())
        file = folder / "keys.toml"
        self.key = add_key(file, "tester", "admin")
        flags = [*patient, "--keys", str(file), "--requests-per-s", "1000000"]
        fleet = RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)})
        self.app = create_app(fleet, GatewaySettings.load(flags))
        asked = pb.SubmitRequest(instruction="move the mug to the kitchen counter")
        self.app.state.gateway.fleet.queue.add(FleetTask(NAMES["id"], asked, time.time()))
        self.answered: Counter[str] = Counter()


@functools.cache
def rig() -> Rig:
    return Rig()


schema = schemathesis.openapi.from_asgi("/openapi.json", rig().app).exclude(path_regex=ENDLESS)


def operations() -> Iterator[APIOperation]:
    for found in schema.get_all_operations():
        assert isinstance(found, Ok), f"the description of the interface is wrong: {found}"
        yield found.ok()


OPERATIONS = {operation.label: operation for operation in operations()}


@pytest.mark.parametrize("label", OPERATIONS)
def test_every_answer_conforms_to_its_description(label: str) -> None:
    @given(case=OPERATIONS[label].as_strategy())
    @settings(max_examples=30, deadline=None, suppress_health_check=HEALTHY)
    def asked(case: schemathesis.Case) -> None:
        ask(case)

    asked()


def ask(case: schemathesis.Case) -> None:
    """Send the case with its generated names, then with names that exist."""
    headers = {"authorization": f"Bearer {rig().key}"}
    rig().backend.reset()  # removes a stop or a cancelled task of the previous case
    case.call_and_validate(checks=CHECKS, headers=headers)
    for name in case.path_parameters or {}:
        case.path_parameters[name] = 1 if "objects" in case.path else NAMES[name]
    rig().backend.reset()
    response = case.call_and_validate(checks=CHECKS, headers=headers)
    rig().answered[case.operation.label] += response.status_code < 400


def test_every_operation_was_also_answered_successfully() -> None:
    """Otherwise the test above would have checked only refusals."""
    answered = rig().answered
    if not answered:
        pytest.skip("runs after the test of the answers")
    # Random input is never a valid key, instruction or image, and the queued task blocks
    # loading and resetting maps.
    assert {name for name, count in answered.items() if not count} <= {
        "POST /v1/session",
        "POST /v1/tasks",
        "POST /v1/frames",
        "PUT /v1/map.zip",
        "POST /v1/map/reset",
    }
