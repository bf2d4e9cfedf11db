"""The application: routes, errors, limits, the dashboard's files."""

from __future__ import annotations

import logging
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.middleware.cors import CORSMiddleware
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles
from fastapi_offline import FastAPIOffline
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.api_keys import ApiKeys
from helios_gateway.authorization import session_routes
from helios_gateway.error_responses import add_problems, problem
from helios_gateway.openapi_schema import describe_truly
from helios_gateway.prometheus_metrics import Metrics, RequestMetrics
from helios_gateway.request_limits import Bounds, RequestLimits
from helios_gateway.robot_registry import RobotRegistry
from helios_gateway.routes.events import event_routes
from helios_gateway.routes.frames import frame_routes
from helios_gateway.routes.health import fleet_routes, health_routes, service_routes
from helios_gateway.routes.map import map_routes
from helios_gateway.routes.map_file import map_file_routes
from helios_gateway.routes.map_reset import map_reset_routes
from helios_gateway.routes.moves import move_routes
from helios_gateway.routes.objects import object_routes
from helios_gateway.routes.past_views import seen_routes
from helios_gateway.routes.robot import robot_routes
from helios_gateway.routes.tasks import task_routes
from helios_gateway.routes.teleop import teleop_routes
from helios_gateway.routes.view3d import view3d_routes
from helios_gateway.settings import Settings

log = logging.getLogger(__name__)

STATIC = Path(__file__).parent / "static"
UNFRAMED = "frame-ancestors 'none'"  # else a page of another site could lead a hand to a button
POLICIES = {
    "/": f"default-src 'self'; img-src 'self' blob: data:; {UNFRAMED}",
    "/docs": UNFRAMED,
}


def create_app(fleet: RobotRegistry, settings: Settings, keys: ApiKeys | None = None) -> FastAPI:
    """The HTTP interface over the robots' buses and what is known from them."""
    app = FastAPIOffline(
        redoc_url=None,
        title="HELIOS",
        version=_version(),
        description="Language tasks for a robot: submit, watch, understand, stop. "
        "Lengths are metres, angles radians, times seconds; the world is z up. "
        "Errors are `application/problem+json`. Every address below `/v1` is also there below "
        "`/v1/robots/NAME`, for one robot of several.",
        swagger_ui_parameters={"validatorUrl": None},
    )
    keys = keys or ApiKeys(settings.keys)
    app.state.fleet, app.state.keys = fleet, keys
    metrics = Metrics(fleet)
    add_problems(app)
    describe_truly(app)
    bounds = Bounds(
        settings.body_limit_bytes, settings.frame_limit_bytes, settings.map_limit_bytes,
        settings.body_timeout_s, settings.requests_per_s, settings.max_requests,
        settings.other_origins,
    )  # fmt: skip
    app.add_middleware(RequestLimits, bounds=bounds, keys=keys)
    if settings.other_origins:
        app.add_middleware(
            CORSMiddleware, allow_origins=settings.other_origins, allow_methods=["*"],
            allow_headers=["authorization", "content-type", "last-event-id", "if-none-match"],
            expose_headers=["etag", "x-map-version", "x-frame-id"],
        )  # fmt: skip
    app.add_middleware(RequestMetrics, metrics=metrics)
    app.add_middleware(PageMiddleware)
    app.include_router(fleet_routes())
    for prefix in ("/v1", "/v1/robots/{robot}"):
        for routes in (
            task_routes(prefix, settings),
            event_routes(prefix, settings),
            object_routes(prefix, settings),
            map_routes(prefix),
            map_file_routes(prefix, settings),
            map_reset_routes(prefix, settings),
            seen_routes(prefix),
            view3d_routes(prefix),
            frame_routes(prefix, settings),
            robot_routes(prefix, settings),
            move_routes(prefix, settings),
            teleop_routes(prefix, settings),
            service_routes(prefix, settings),
        ):
            app.include_router(routes, include_in_schema=prefix == "/v1")
    app.include_router(session_routes())
    app.include_router(health_routes(metrics))

    @app.exception_handler(Exception)
    async def unforeseen(request: Request, error: Exception) -> JSONResponse:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return problem(
            500, "internal", "A fault in the gateway", "the gateway's log says what went wrong"
        )

    @app.get("/", include_in_schema=False)
    async def dashboard() -> FileResponse:
        return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})

    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    return app


class PageMiddleware:
    """ASGI middleware: what the pages for people may load, and that no other shows them inside."""

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
