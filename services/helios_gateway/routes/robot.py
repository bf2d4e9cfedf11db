"""The robot: how it is, and stop-now."""

from __future__ import annotations

import asyncio
import contextlib
import functools

import anyio.to_thread
from anyio import CapacityLimiter
from fastapi import APIRouter, Request
from helios_core import proto as pb
from helios_core.printable_text import printable
from helios_core.topics import CLEAR_STOP, STOP
from pydantic import ValidationError
from starlette.requests import ClientDisconnect

from helios_gateway import api_models
from helios_gateway.api_keys import Scope
from helios_gateway.authorization import secured
from helios_gateway.error_responses import problems
from helios_gateway.robot_registry import At
from helios_gateway.settings import Settings

BODY_S = 0.2  # that stop-now waits for its reason
BODY_BYTES = 65536
REASON_CHARACTERS = 500
STOP_BODY = {
    "required": False,
    "content": {"application/json": {"schema": api_models.StopRequest.model_json_schema()}},
}


def robot_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/robot…`"""
    routes = APIRouter(prefix=f"{prefix}/robot", tags=["robot"], dependencies=secured(Scope.READ))
    own_threads = CapacityLimiter(8)  # stop-now never waits behind other requests' threads

    @routes.get("", summary="How the robot is, and what it is", responses=problems())
    async def robot(at: At) -> api_models.Robot:
        return at.live.robot()

    @routes.post(
        "/stop",
        summary="Stop now",
        responses=problems(409),
        openapi_extra={"requestBody": STOP_BODY},
    )
    async def stop(at: At, request: Request) -> api_models.Robot:
        """Goes to the bridge directly, latches, and refuses every motion until it is cleared.
        Any key may stop; requests are not counted. No body is refused: of one that cannot be read
        the reason alone is lost."""
        message = pb.StopRequest(reason=stop_reason(await _begun(request)))
        await anyio.to_thread.run_sync(
            functools.partial(at.bus.call, STOP, message, settings.stop_timeout_s),
            limiter=own_threads,
        )
        return at.live.robot()

    @routes.post(
        "/clear-stop",
        summary="Lift stop-now",
        responses=problems(409, body=True),
        dependencies=secured(Scope.OPERATE),
    )
    def clear_stop(at: At) -> api_models.Robot:
        """A robot that somebody took must be free again: the answer says who or what holds it."""
        at.bus.call(CLEAR_STOP, pb.Empty(), settings.call_timeout_s)
        return at.live.robot()

    return routes


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
