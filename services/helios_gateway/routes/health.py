"""How the backend is, for people, for orchestrators and for Prometheus."""

from __future__ import annotations

import json
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from helios_core import proto as pb
from helios_core.errors import Internal, Unavailable
from helios_core.topics import settings_method

from helios_gateway import api_models
from helios_gateway.api_keys import Scope
from helios_gateway.authorization import secured
from helios_gateway.error_responses import NotFound, problems
from helios_gateway.prometheus_metrics import Metrics
from helios_gateway.robot_registry import At, RobotRegistry
from helios_gateway.settings import Settings

ROUTER = "router"
ServiceName = Annotated[
    str, Path(max_length=50, pattern="^[a-z][a-z0-9_-]*$", description="as /v1/status lists it")
]


def health_routes(metrics: Metrics) -> APIRouter:
    """`/healthz`, `/readyz`, `/metrics`: without a key, but for the figures."""
    routes = APIRouter(tags=["health"])

    @routes.get("/healthz", summary="Is the gateway itself well?", responses=problems())
    async def healthz() -> api_models.HealthAnswer:
        return api_models.HealthAnswer()

    @routes.get(
        "/readyz",
        summary="Would a task start now?",
        responses=problems()
        | {503: {"model": api_models.Readiness, "description": "no, for these reasons"}},
    )
    async def readyz(request: Request, response: Response) -> api_models.Readiness:
        """A stopped robot is a reason, too."""
        fleet: RobotRegistry = request.app.state.fleet
        reasons = fleet.reasons()
        stopped = any(served.live.stopped for served in fleet.robots.values())
        response.status_code = 503 if reasons else 200
        said = [s.live.stop_reason for s in fleet.robots.values() if s.live.stop_reason]
        return api_models.Readiness(
            ready=not reasons, stopped=stopped, stop_reason="; ".join(said), reasons=reasons
        )

    @routes.get(
        "/metrics",
        summary="Figures in Prometheus' text form",
        response_class=Response,
        responses={200: {"content": {"text/plain": {}}}} | problems(),
        dependencies=secured(Scope.READ),
    )
    async def prometheus() -> Response:
        text, media_type = metrics.text()
        return Response(text, headers={"content-type": media_type})

    return routes


def service_routes(prefix: str, settings: Settings) -> APIRouter:
    """`/status` and `/services/{name}/settings`."""
    routes = APIRouter(prefix=prefix, tags=["health"], responses=problems())

    @routes.get("/status", summary="Every service", dependencies=secured(Scope.READ))
    async def status(at: At) -> api_models.Status:
        return at.live.status()

    @routes.get(
        "/services/{name}/settings",
        summary="The settings of a running service",
        responses=problems(404),
        dependencies=secured(Scope.ADMIN),
    )
    def service_settings(at: At, name: ServiceName) -> api_models.ServiceSettings:
        """What it was started with, each with its default and what it means."""
        known = [service.name for service in at.live.status().services]
        if name not in known:
            raise NotFound(f"there is no service {name!r}; there are: {', '.join(known)}")
        if name == ROUTER:
            raise NotFound(f"{name} is Zenoh's and tells no settings; ask another service")
        try:
            reply = at.bus.call(settings_method(name), pb.Empty(), settings.call_timeout_s)
        except Unavailable as error:
            raise Unavailable(
                f"{name} does not tell its settings; /v1/status says how it is"
            ) from error
        try:
            values = json.loads(reply.json)
        except ValueError as error:
            raise Internal(f"{name} told settings that are no JSON") from error
        return api_models.ServiceSettings(service=name, settings=values)

    return routes


def fleet_routes() -> APIRouter:
    """`/v1/robots`."""
    routes = APIRouter(prefix="/v1/robots", tags=["robot"], responses=problems())

    @routes.get("", summary="The robots served here", dependencies=secured(Scope.READ))
    async def robots(request: Request) -> api_models.RobotList:
        """Every address below `/v1` is also there below `/v1/robots/NAME`, for that robot."""
        fleet: RobotRegistry = request.app.state.fleet
        return api_models.RobotList(robots=[
            api_models.RobotEntry(
                name=name, connected=served.live.robot().connected,
                ready=not served.live.reasons(), stopped=served.live.stopped,
            )
            for name, served in fleet.robots.items()
        ])  # fmt: skip

    return routes
