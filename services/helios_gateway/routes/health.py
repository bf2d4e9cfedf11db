"""State of the services, for people, orchestrators and Prometheus.

`/healthz`, `/readyz` and `/metrics`; `/v1/robots`; `/status` and `/services/{name}/settings`.
"""

from __future__ import annotations

import json
from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Path, Request, Response
from helios_core import proto as pb
from helios_core.errors import Internal, Unavailable
from helios_core.topics import settings_method

from helios_gateway import api_models
from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, CallTimeout, State, key_of, secured
from helios_gateway.error_responses import NotFound, problems

ROUTER = "router"
KEY_NEEDED = "send an API key to get the reasons"
ServiceName = Annotated[
    str,
    Path(
        max_length=50,
        pattern="^[a-z][a-z0-9_-]*$",
        description="name of the service, as listed by `/v1/status`",
    ),
]
router = APIRouter(tags=["health"])
service_router = APIRouter(tags=["health"], responses=problems())
robots_router = APIRouter(prefix="/v1/robots", tags=["robot"], responses=problems())


@router.head("/healthz", include_in_schema=False)
@router.get("/healthz", summary="Liveness check of the gateway", responses=problems())
async def healthz() -> api_models.HealthAnswer:
    return api_models.HealthAnswer()


@router.head("/readyz", include_in_schema=False)
@router.get(
    "/readyz",
    summary="Readiness check",
    responses=problems()
    | {
        503: {
            "model": api_models.Readiness,
            "description": "a robot cannot do a task now, with the reasons",
        }
    },
)
async def readyz(state: State, request: Request, response: Response) -> api_models.Readiness:
    """Report if every robot of this gateway can do a task now, and the reasons if not.

    Reasons are a service that a task needs and that handles no requests, and a stopped robot. A
    `degraded` service that still handles requests is no reason. If keys are required, only a
    request with a key gets the reasons.
    """
    reasons = state.robots.not_ready_reasons()
    served = state.robots.robots.values()
    stopped = any(one.monitor.stopped for one in served)
    response.status_code = 503 if reasons else 200
    said = [one.monitor.stop_reason for one in served if one.monitor.stop_reason]
    if reasons and state.keys.required and key_of(request.scope, state.keys) is None:
        reasons, said = [KEY_NEEDED], []
    return api_models.Readiness(
        ready=not reasons, stopped=stopped, stop_reason="; ".join(said), reasons=reasons
    )


@router.get(
    "/metrics",
    summary="Metrics in Prometheus text format",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}}}} | problems(),
    dependencies=secured(Scope.READ),
)
async def prometheus(state: State) -> Response:
    text, media_type = await anyio.to_thread.run_sync(
        state.metrics.text, limiter=state.metrics_threads
    )
    return Response(text, headers={"content-type": media_type})


@service_router.get(
    "/status",
    summary="Get the readiness and the health of every service",
    dependencies=secured(Scope.READ),
)
async def status(robot: AddressedRobot) -> api_models.Status:
    return robot.monitor.status()


@service_router.get(
    "/services/{name}/settings",
    summary="Get the settings of a running service",
    responses=problems(404),
    dependencies=secured(Scope.ADMIN),
)
def service_settings(
    robot: AddressedRobot, name: ServiceName, timeout_s: CallTimeout
) -> api_models.ServiceSettings:
    """Return the settings that a service was started with, their defaults and their meaning."""
    known = [service.name for service in robot.monitor.status().services]
    if name not in known:
        raise NotFound(f"there is no service {name!r}; there are: {', '.join(known)}")
    if name == ROUTER:
        raise NotFound(f"{name} is Zenoh's and tells no settings; ask another service")
    try:
        reply = robot.bus.call(settings_method(name), pb.Empty(), timeout_s)
    except Unavailable as error:
        raise Unavailable(
            f"{name} does not tell its settings: {error.message} (/v1/status says how it is)"
        ) from error
    try:
        values = json.loads(reply.json)
    except ValueError as error:
        raise Internal(f"{name} told settings that are no JSON") from error
    return api_models.ServiceSettings(service=name, settings=values)


@robots_router.get("", summary="List the robots", dependencies=secured(Scope.READ))
async def robots(state: State) -> api_models.RobotList:
    """List the robots of this gateway.

    Every address below `/v1`, except `/v1/session`, `/v1/fleet` and `/v1/robots` itself, also
    exists below `/v1/robots/NAME`, for that robot.
    """
    return api_models.RobotList(
        robots=[
            api_models.RobotEntry(
                name=name,
                connected=served.monitor.robot().connected,
                ready=not served.monitor.not_ready_reasons(),
                stopped=served.monitor.stopped,
            )
            for name, served in state.robots.robots.items()
        ]
    )
