"""The robot: how it is, and stop-now."""

from __future__ import annotations

import functools

import anyio.to_thread
from anyio import CapacityLimiter
from fastapi import APIRouter
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import CLEAR_STOP, STOP

from helios_gateway import models
from helios_gateway.live import Live
from helios_gateway.settings import Settings


def robot_routes(bus: Bus, live: Live, settings: Settings) -> APIRouter:
    """`/v1/robot…`"""
    routes = APIRouter(prefix="/v1/robot", tags=["robot"])
    own_threads = CapacityLimiter(8)  # stop-now never waits behind other requests' threads

    @routes.get("", summary="How the robot is, and what it is")
    async def robot() -> models.Robot:
        return live.robot()

    @routes.post("/stop", summary="Stop now")
    async def stop(request: models.StopRequest | None = None) -> models.Robot:
        """Goes to the bridge directly, latches, and refuses every motion until it is cleared."""
        message = pb.StopRequest(reason=(request or models.StopRequest()).reason)
        await anyio.to_thread.run_sync(
            functools.partial(bus.call, STOP, message, settings.stop_timeout_s),
            limiter=own_threads,
        )
        return live.robot()

    @routes.post("/clear-stop", summary="Lift stop-now")
    async def clear_stop() -> models.Robot:
        await anyio.to_thread.run_sync(
            functools.partial(bus.call, CLEAR_STOP, pb.Empty(), settings.stop_timeout_s),
            limiter=own_threads,
        )
        return live.robot()

    return routes
