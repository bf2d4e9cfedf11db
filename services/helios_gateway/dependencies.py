"""Dependencies of endpoints: the shared state, the addressed robot, and the check of the key.

Every dependency is asynchronous: FastAPI runs others in the shared threads, and stop-now must
never wait for one of those. A browser cannot send a key with every image, so `routes/session.py`
stores it in a cookie.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends
from fastapi.security import HTTPBearer
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, cookie_parser
from starlette.types import Scope as AsgiScope

from helios_gateway.api_keys import ApiKey, ApiKeys, Scope
from helios_gateway.connection_slots import ConnectionSlots
from helios_gateway.error_responses import Forbidden, NotFound, Unauthorized
from helios_gateway.fleet.dispatcher import Dispatcher
from helios_gateway.map_cache import MapCache
from helios_gateway.prometheus_metrics import Metrics
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings

COOKIE = "helios_key"
_bearer = HTTPBearer(auto_error=False, description="an API key; none is asked for on loopback")


@dataclass(frozen=True)
class GatewayState:
    """State of one application; `app.state.gateway` holds it.

    The thread limiters keep blocking calls of these requests out of the threads that all other
    requests share.
    """

    robots: RobotRegistry
    fleet: Dispatcher
    settings: Settings
    keys: ApiKeys
    metrics: Metrics
    stop_threads: CapacityLimiter
    control_threads: CapacityLimiter
    metrics_threads: CapacityLimiter
    frame_threads: CapacityLimiter
    frame_sockets: ConnectionSlots
    teleop_threads: CapacityLimiter
    teleop_sockets: ConnectionSlots


def state_of(connection: HTTPConnection) -> GatewayState:
    """State of the application that serves this request or socket."""
    return connection.app.state.gateway


async def _gateway_state(connection: HTTPConnection) -> GatewayState:
    return state_of(connection)


async def _addressed_robot(connection: HTTPConnection) -> RobotEndpoint:
    robots = state_of(connection).robots.robots
    name = connection.path_params.get("robot")
    if name is None:
        return next(iter(robots.values()))
    if name not in robots:
        known = ", ".join(robots)
        raise NotFound(f"there is no robot {name[:80]!r} here; there are: {known}")
    return robots[name]


async def _fleet(connection: HTTPConnection) -> Dispatcher:
    return state_of(connection).fleet


async def _call_timeout_s(connection: HTTPConnection) -> float:
    return state_of(connection).settings.call_timeout_s


State = Annotated[GatewayState, Depends(_gateway_state)]
# The robot that the path names (`/v1/robots/{robot}/...`), or the first one (`/v1/...`).
# Raises NotFound for an unknown name.
AddressedRobot = Annotated[RobotEndpoint, Depends(_addressed_robot)]
Fleet = Annotated[Dispatcher, Depends(_fleet)]
CallTimeout = Annotated[float, Depends(_call_timeout_s)]  # time limit of a service call, seconds


async def _maps(robot: AddressedRobot) -> MapCache:
    return robot.monitor.maps


Maps = Annotated[MapCache, Depends(_maps)]  # cache of the addressed robot


# --- keys -----------------------------------------------------------------------------------------
def key_of(scope: AsgiScope, keys: ApiKeys) -> ApiKey | None:
    """Known key of a request, from its bearer token or its cookie; None if it has none."""
    headers = Headers(scope=scope)
    kind, _, secret = headers.get("authorization", "").partition(" ")
    if kind.lower() != "bearer":
        secret = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
    return keys.find(secret.strip()) if secret else None


def check(connection: HTTPConnection, needed: Scope) -> None:
    """Check that the request's key has the needed scope.

    Raises Unauthorized without a known key, Forbidden if the scope is too low. Checks nothing if
    the gateway requires no keys.
    """
    keys = state_of(connection).keys
    if keys.required:
        check_scope(key_of(connection.scope, keys), needed)


def check_scope(key: ApiKey | None, needed: Scope) -> None:
    """Check that a key, as `key_of` found it, has the needed scope. Raises like `check`."""
    if key is None:
        raise Unauthorized(
            "no known API key came with the request; send Authorization: Bearer KEY, made with "
            "helios key"
        )
    if key.scope < needed:
        raise Forbidden(
            f"the key {key.name!r} has scope {key.scope.label}; this needs one of scope "
            f"{needed.label}"
        )


def needs(scope: Scope) -> Callable[..., Awaitable[None]]:
    """Dependency that calls `check`."""

    async def checked(connection: HTTPConnection) -> None:
        check(connection, scope)

    return checked


def secured(scope: Scope) -> list:
    """Value for `dependencies` of a router or an endpoint that needs a key of this scope.

    The second one only declares the bearer token in the OpenAPI description.
    """
    return [Depends(needs(scope)), Depends(_bearer)]
