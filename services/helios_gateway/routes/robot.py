"""`/robot`, `/robot/stop` and `/robot/clear-stop`: state and emergency stop (stop-now)."""

from __future__ import annotations

import asyncio
import contextlib

import anyio.to_thread
from fastapi import APIRouter, Request
from helios_core import proto as pb
from helios_core.printable_text import printable
from helios_core.topics import CLEAR_STOP, STOP
from pydantic import ValidationError
from starlette.requests import ClientDisconnect

from helios_gateway import api_models
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, CallTimeout, State, secured
from helios_gateway.error_responses import problems

BODY_S = 0.2  # longest wait of stop-now for its body
BODY_BYTES = 65536
REASON_CHARACTERS = 500
STATE_WITHIN_S = 0.5  # longest wait for the state that the bridge published before its answer
STOP_BODY = {
    "required": False,
    "content": {"application/json": {"schema": api_models.StopRequest.model_json_schema()}},
}
router = APIRouter(prefix="/robot", tags=["robot"], dependencies=secured(Scope.READ))


@router.get(
    "", name="robot", summary="Get the state and the description of the robot", responses=problems()
)
async def get_robot(robot: AddressedRobot) -> api_models.Robot:
    return robot.monitor.robot()


@router.post(
    "/stop",
    summary="Stop the robot (emergency stop)",
    responses=problems(409),
    openapi_extra={"requestBody": STOP_BODY},
)
async def stop(robot: AddressedRobot, state: State, request: Request) -> api_models.Robot:
    """Stop the robot now.

    The stop goes directly to the bridge, latches, and refuses every motion until
    `/v1/robot/clear-stop`. Any key may stop, and no limit on requests applies; but while
    `max_connections` connections are open, a stop returns 503, too. An unreadable body does not
    prevent the stop; only its reason is lost.
    """
    message = pb.StopRequest(reason=stop_reason(await _begun(request)))

    def stop_and_hear() -> api_models.Robot:
        robot.bus.call(STOP, message, state.settings.stop_timeout_s)
        return robot.monitor.robot_when(stopped=True, within_s=STATE_WITHIN_S)

    return await anyio.to_thread.run_sync(stop_and_hear, limiter=state.stop_threads)


@router.post(
    "/clear-stop",
    summary="Clear the emergency stop",
    responses=problems(409, body=True),
    dependencies=secured(Scope.ROBOT),
)
async def clear_stop(
    robot: AddressedRobot, state: State, timeout_s: CallTimeout
) -> api_models.Robot:
    """Allow the robot to move again after an emergency stop.

    If a person or a program has taken over the robot, it must be free again: the error names
    the holder.
    """

    def clear_and_hear() -> api_models.Robot:
        robot.bus.call(CLEAR_STOP, pb.Empty(), timeout_s)
        return robot.monitor.robot_when(stopped=False, within_s=STATE_WITHIN_S)

    return await anyio.to_thread.run_sync(clear_and_hear, limiter=state.control_threads)


def stop_reason(body: bytes) -> str:
    """Reason of a stop: at most 500 printable characters; the default for an unreadable body.

    Control characters are replaced, so that they cannot prevent a stop.
    """
    try:
        known = api_models.StopRequest.model_validate_json(body)
    except ValidationError:
        known = api_models.StopRequest()
    return printable(known.reason[:REASON_CHARACTERS])


async def _begun(request: Request) -> bytes:
    """Body received until its end, its size limit or its time limit."""
    body = bytearray()
    with contextlib.suppress(TimeoutError, ClientDisconnect):
        async with asyncio.timeout(BODY_S):
            async for part in request.stream():
                body += part
                if len(body) > BODY_BYTES:
                    break
    return bytes(body)
