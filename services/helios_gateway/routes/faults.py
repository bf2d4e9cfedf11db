"""`/faults...`: faults with their states and counts, and the recordings around them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path
from fastapi.responses import FileResponse

from helios_gateway import api_fault_models
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, secured
from helios_gateway.error_responses import NotFound, problems
from helios_gateway.faults.messages import fault_list, fault_model

MCAP = "application/octet-stream"
router = APIRouter(tags=["health"])


@router.get(
    "/faults",
    summary="List the faults and their recordings",
    responses=problems(),
    dependencies=secured(Scope.READ),
)
def faults(robot: AddressedRobot) -> api_fault_models.FaultList:
    """List every fault that is known, also cleared ones, with the number of its occurrences.

    A recording holds the 20 s before a confirmed fault or failed task and the 5 s after it. The
    oldest recordings are removed.
    """
    return fault_list(robot.monitor.faults)


@router.post(
    "/faults/{fault}/clear",
    summary="Clear a fault",
    responses=problems(404, 409, body=True),
    dependencies=secured(Scope.TASK),
)
def clear(
    robot: AddressedRobot,
    fault: Annotated[str, Path(max_length=200, description="id of the fault")],
) -> api_fault_models.Fault:
    """Clear a fault, such as that of a failed task.

    One that is still present is refused.
    """
    return fault_model(robot.monitor.faults.clear(fault), robot.monitor.faults.recordings())


@router.get(
    "/faults/recordings/{recording}",
    summary="Get a recording",
    response_class=FileResponse,
    responses={200: {"content": {MCAP: {"schema": {"type": "string", "format": "binary"}}}}}
    | problems(404),
    dependencies=secured(Scope.READ),
)
def get_recording(
    robot: AddressedRobot,
    recording: Annotated[str, Path(max_length=200, description="name of the recording")],
) -> FileResponse:
    """Return the MCAP file of a recording, for `helios view`, Foxglove or Rerun."""
    path = robot.monitor.faults.path(recording)
    if path is None:
        raise NotFound(
            f"there is no recording {recording[:100]!r}; list them with GET /v1/faults, and wait "
            "for one that is still being made"
        )
    return FileResponse(path, media_type=MCAP, filename=recording)
