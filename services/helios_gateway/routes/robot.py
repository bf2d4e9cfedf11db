"""`/robot`, `/robot/stop` and `/robot/clear-stop`: the state of the robot, and stop-now."""

from __future__ import annotations

import asyncio
import contextlib
import functools

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

BODY_S = 0.2  # that stop-now waits for its reason
BODY_BYTES = 65536
REASON_CHARACTERS = 500
STOP_BODY = {
    "required": False,
    "content": {"application/json": {"schema": api_models.StopRequest.model_json_schema()}},
}
router = APIRouter(prefix="/robot", tags=["robot"], dependencies=secured(Scope.READ))


@router.get("", name="robot", summary="How the robot is, and what it is", responses=problems())
async def get_robot(robot: AddressedRobot) -> api_models.Robot:
    return robot.live.robot()


@router.post(
    "/stop",
    summary="Stop now",
    responses=problems(409),
    openapi_extra={"requestBody": STOP_BODY},
)
async def stop(robot: AddressedRobot, state: State, request: Request) -> api_models.Robot:
    """Goes to the bridge directly, latches, and refuses every motion until it is cleared.
    Any key may stop; requests are not counted. No body is refused: of one that cannot be read
    the reason alone is lost."""
    message = pb.StopRequest(reason=stop_reason(await _begun(request)))
    await anyio.to_thread.run_sync(
        functools.partial(robot.bus.call, STOP, message, state.settings.stop_timeout_s),
        limiter=state.stop_threads,
    )
    return robot.live.robot()


@router.post(
    "/clear-stop",
    summary="Lift stop-now",
    responses=problems(409, body=True),
    dependencies=secured(Scope.OPERATE),
)
def clear_stop(robot: AddressedRobot, timeout_s: CallTimeout) -> api_models.Robot:
    """A robot that somebody took must be free again: the answer says who or what holds it."""
    robot.bus.call(CLEAR_STOP, pb.Empty(), timeout_s)
    return robot.live.robot()


def stop_reason(body: bytes) -> str:
    """Why the robot shall stop: at most 500 printable characters, the default for what cannot be
    read. Control characters are replaced, not refused: nothing hinders a stop."""
    try:
        known = api_models.StopRequest.model_validate_json(body)
    except ValidationError:
        known = api_models.StopRequest()
    return printable(known.reason[:REASON_CHARACTERS])


async def _begun(request: Request) -> bytes:
    """What has come of the body, when it is whole, too long or late."""
    body = bytearray()
    with contextlib.suppress(TimeoutError, ClientDisconnect):
        async with asyncio.timeout(BODY_S):
            async for part in request.stream():
                body += part
                if len(body) > BODY_BYTES:
                    break
    return bytes(body)
