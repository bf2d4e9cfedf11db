"""The state that requests share, and the FastAPI dependencies that pass it to endpoints.

Every dependency is asynchronous: FastAPI runs others in the shared threads, and stop-now must
never wait for one of those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends
from starlette.requests import HTTPConnection

from helios_gateway.api_keys import ApiKeys
from helios_gateway.connection_slots import ConnectionSlots
from helios_gateway.error_responses import NotFound
from helios_gateway.map_cache import MapCache
from helios_gateway.prometheus_metrics import Metrics
from helios_gateway.robot_registry import RobotRegistry, Served
from helios_gateway.settings import Settings


@dataclass(frozen=True)
class GatewayState:
    """The state of one application; `app.state.gateway` holds it.

    The thread limiters keep blocking calls of these requests out of the threads that all other
    requests share.
    """

    robots: RobotRegistry
    settings: Settings
    keys: ApiKeys
    metrics: Metrics
    stop_threads: CapacityLimiter
    frame_threads: CapacityLimiter
    frame_sockets: ConnectionSlots
    teleop_threads: CapacityLimiter
    teleop_sockets: ConnectionSlots


def state_of(connection: HTTPConnection) -> GatewayState:
    """The state of the application that serves this request or socket."""
    return connection.app.state.gateway


async def _gateway_state(connection: HTTPConnection) -> GatewayState:
    return state_of(connection)


async def _addressed_robot(connection: HTTPConnection) -> Served:
    robots = state_of(connection).robots.robots
    name = connection.path_params.get("robot")
    if name is None:
        return next(iter(robots.values()))
    if name not in robots:
        known = ", ".join(robots)
        raise NotFound(f"there is no robot {name[:80]!r} here; there are: {known}")
    return robots[name]


async def _call_timeout_s(connection: HTTPConnection) -> float:
    return state_of(connection).settings.call_timeout_s


State = Annotated[GatewayState, Depends(_gateway_state)]
# The robot that the path names (`/v1/robots/{robot}/...`), or the first one (`/v1/...`).
# Raises NotFound for an unknown name.
AddressedRobot = Annotated[Served, Depends(_addressed_robot)]
CallTimeout = Annotated[float, Depends(_call_timeout_s)]  # seconds that a service may take


async def _maps(robot: AddressedRobot) -> MapCache:
    return robot.live.maps


Maps = Annotated[MapCache, Depends(_maps)]  # of the addressed robot
