"""The robot: how it is, and stop-now."""

from __future__ import annotations

import functools

import anyio.to_thread
from anyio import CapacityLimiter
from fastapi import APIRouter
from helios_core import proto as pb
from helios_core.topics import CLEAR_STOP, STOP

from helios_gateway import models
from helios_gateway.access import secured
from helios_gateway.fleet import At
from helios_gateway.keys import Scope
from helios_gateway.problems import problems
from helios_gateway.settings import Settings


def robot_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/robot…`"""
    routes = APIRouter(prefix=f"{prefix}/robot", tags=["robot"], dependencies=secured(Scope.READ))
    own_threads = CapacityLimiter(8)  # stop-now never waits behind other requests' threads

    @routes.get("", summary="How the robot is, and what it is", responses=problems())
    async def robot(at: At) -> models.Robot:
        return at.live.robot()

    @routes.post("/stop", summary="Stop now", responses=problems(409, body=True))
    async def stop(at: At, request: models.StopRequest | None = None) -> models.Robot:
        """Goes to the bridge directly, latches, and refuses every motion until it is cleared.
        Any key may stop; requests are not counted."""
        message = pb.StopRequest(reason=(request or models.StopRequest()).reason)
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
    def clear_stop(at: At) -> models.Robot:
        """A robot that somebody took must be free again: the answer says who or what holds it."""
        at.bus.call(CLEAR_STOP, pb.Empty(), settings.call_timeout_s)
        return at.live.robot()

    return routes
