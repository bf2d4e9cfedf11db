"""Web application: routes, error responses, limits and the dashboard's files."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from anyio import CapacityLimiter
from fastapi import APIRouter, FastAPI
from fastapi.middleware.cors import CORSMiddleware
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles
from fastapi_offline import FastAPIOffline
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.api_keys import ApiKeys
from helios_gateway.audit_log import AuditLog, AuditMiddleware
from helios_gateway.connection_slots import ConnectionSlots
from helios_gateway.dependencies import GatewayState
from helios_gateway.error_responses import add_problems
from helios_gateway.fleet.dispatcher import Dispatcher
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.openapi_schema import correct_error_responses
from helios_gateway.prometheus_metrics import Metrics, RequestMetrics
from helios_gateway.request_limits import MOST_LARGE, LimitSettings, RequestLimits
from helios_gateway.request_spans import RequestSpans
from helios_gateway.robot_registry import API_ROOT, ROBOT_ROOT, RobotRegistry
from helios_gateway.routes import (
    events,
    faults,
    fleet,
    frames,
    health,
    map_file,
    map_reset,
    moves,
    objects,
    past_views,
    robot,
    robot_checks,
    session,
    tasks,
    teleop,
    traces,
    view3d,
)
from helios_gateway.routes import map as map_routes
from helios_gateway.settings import Settings

STATIC = Path(__file__).parent / "static"
UNFRAMED = "frame-ancestors 'none'"  # prevents clickjacking
OWN_PAGE = f"default-src 'self'; img-src 'self' blob: data:; {UNFRAMED}"
POLICIES = {
    "/": OWN_PAGE,
    "/fleet": OWN_PAGE,
    "/docs": UNFRAMED,
}


MOST_STOPS = 16  # concurrent stop-now requests
CONTROL_THREADS = 16  # for clear-stop, and to cancel, pause and resume tasks
ROBOT_ROUTERS = (  # each mounted below `/v1` and below `/v1/robots/{robot}`
    tasks.router, events.router, objects.router, map_routes.router, map_file.router,
    map_reset.router, past_views.router, view3d.router, frames.router, robot.router,
    robot_checks.router, moves.router, teleop.router, traces.router, faults.router,
    health.service_router,
)  # fmt: skip
METRICS_THREADS = 2
pages = APIRouter(include_in_schema=False)


def create_app(
    robots: RobotRegistry,
    settings: Settings,
    keys: ApiKeys | None = None,
    audit: AuditLog | None = None,
    dispatcher: Dispatcher | None = None,
) -> FastAPI:
    """HTTP application for the robots.

    keys: None reads the file that the settings name. audit: record of changes; None: none is kept.
    dispatcher: queue of the fleet; None: a queue in memory that nobody empties.
    """
    app = FastAPIOffline(
        redoc_url=None,
        title="HELIOS",
        version=_version(),
        description="Control of a robot by tasks in natural language: submit and follow "
        "tasks, read the reasons for decisions, stop the robot. Lengths are in metres, angles "
        "in radians, times in seconds; the world's z axis points up. Errors are "
        "`application/problem+json`. Every address below `/v1`, except `/v1/session`, "
        "`/v1/fleet` and `/v1/robots` itself, also exists below `/v1/robots/NAME`, for one of "
        "several robots.",
        swagger_ui_parameters={"validatorUrl": None},
    )
    dispatcher = dispatcher or Dispatcher(robots, FleetQueue(None), settings.call_timeout_s)
    state = _state(robots, settings, keys or ApiKeys(settings.keys), dispatcher)
    app.state.gateway = state
    add_problems(app)
    correct_error_responses(app)
    _add_middleware(app, state, audit)
    app.include_router(health.robots_router)
    app.include_router(fleet.router)
    for root in (API_ROOT, ROBOT_ROOT):
        for router in ROBOT_ROUTERS:
            app.include_router(router, prefix=root, include_in_schema=root == API_ROOT)
    app.include_router(session.router)
    app.include_router(health.router)
    app.include_router(pages)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    return app


def _state(
    robots: RobotRegistry, settings: Settings, keys: ApiKeys, dispatcher: Dispatcher
) -> GatewayState:
    """State of a new application."""
    return GatewayState(
        robots=robots,
        fleet=dispatcher,
        settings=settings,
        keys=keys,
        metrics=Metrics(robots, dispatcher.queue),
        stop_threads=CapacityLimiter(MOST_STOPS),
        control_threads=CapacityLimiter(CONTROL_THREADS),
        metrics_threads=CapacityLimiter(METRICS_THREADS),
        frame_threads=CapacityLimiter(frames.MOST_SENDERS + MOST_LARGE),
        frame_sockets=ConnectionSlots(frames.MOST_SENDERS, "sockets for frames"),
        teleop_threads=CapacityLimiter(2 * teleop.MOST_DRIVERS),
        teleop_sockets=ConnectionSlots(teleop.MOST_DRIVERS, "sockets for driving"),
    )


def _add_middleware(app: FastAPI, state: GatewayState, audit: AuditLog | None) -> None:
    """Add the middleware; the last one added handles a request first."""
    settings = state.settings
    bounds = LimitSettings(
        settings.body_limit_bytes,
        settings.frame_limit_bytes,
        settings.map_limit_bytes,
        settings.body_timeout_s,
        settings.requests_per_s,
        settings.max_requests,
        settings.other_origins,
    )
    app.add_middleware(RequestLimits, bounds=bounds, keys=state.keys)
    if settings.other_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=settings.other_origins,
            allow_methods=["*"],
            allow_headers=["authorization", "content-type", "last-event-id", "if-none-match"],
            expose_headers=["etag", "x-map-version", "x-frame-id"],
        )
    app.add_middleware(RequestSpans)
    app.add_middleware(RequestMetrics, metrics=state.metrics)
    app.add_middleware(PageMiddleware)
    if audit is not None:  # the last one: it records refusals by the others, too
        app.add_middleware(AuditMiddleware, audit=audit, keys=state.keys)


@pages.get("/")
async def dashboard() -> FileResponse:
    return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})


@pages.get("/fleet")
async def fleet_page() -> FileResponse:
    return FileResponse(STATIC / "fleet.html", headers={"cache-control": "no-cache"})


class PageMiddleware:
    """ASGI middleware that sets the content security policy of the HTML pages.

    The policy limits the resources that a page may load, and no other page may frame it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        policy = POLICIES.get(scope.get("path", ""))
        if policy is None:
            await self._app(scope, receive, send)
            return

        async def with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["content-security-policy"] = policy
                headers["x-frame-options"] = "DENY"
            await send(message)

        await self._app(scope, receive, with_policy)


def _version() -> str:
    try:
        return version("helios-ovmm")
    except PackageNotFoundError:
        return "0"
