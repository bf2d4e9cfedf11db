"""The application: routes, errors, limits, the dashboard's files."""

from __future__ import annotations

import logging
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles
from fastapi_offline import FastAPIOffline
from helios_core.bus import Bus

from helios_gateway.limits import Limits
from helios_gateway.live import Live
from helios_gateway.metrics import CountRequests, Metrics
from helios_gateway.problems import Problem, add_problems, problem
from helios_gateway.routes_health import health_routes
from helios_gateway.routes_map import map_routes
from helios_gateway.routes_robot import robot_routes
from helios_gateway.routes_tasks import task_routes
from helios_gateway.settings import Settings

log = logging.getLogger(__name__)

STATIC = Path(__file__).parent / "static"
_PROBLEMS: dict[int | str, dict] = {
    status: {"model": Problem, "description": words}
    for status, words in {
        400: "the request is wrong",
        404: "there is no such thing",
        409: "refused in the present state",
        503: "a service cannot answer now",
        504: "a service did not answer in time",
    }.items()
}


def create_app(bus: Bus, live: Live, settings: Settings) -> FastAPI:
    """The HTTP interface over a bus and what is known from it."""
    app = FastAPIOffline(
        redoc_url=None,
        title="HELIOS",
        version=_version(),
        description="Language tasks for a robot: submit, watch, understand, stop. "
        "Lengths are metres, angles radians, times seconds; the world is z up. "
        "Errors are `application/problem+json`.",
        swagger_ui_parameters={"validatorUrl": None},
    )
    metrics = Metrics(live)
    add_problems(app)
    app.add_middleware(Limits, body_limit_bytes=settings.body_limit_bytes)
    app.add_middleware(CountRequests, metrics=metrics)
    for routes in (
        task_routes(bus, live, settings),
        map_routes(live),
        robot_routes(bus, live, settings),
    ):
        app.include_router(routes, responses=_PROBLEMS)
    app.include_router(health_routes(live, metrics))

    @app.exception_handler(Exception)
    async def unforeseen(request: Request, error: Exception) -> JSONResponse:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return problem(
            500, "internal", "A fault in the gateway", "the gateway's log says what went wrong"
        )

    @app.get("/", include_in_schema=False)
    async def dashboard() -> FileResponse:
        return FileResponse(
            STATIC / "index.html",
            headers={
                "cache-control": "no-cache",
                "content-security-policy": "default-src 'self'; img-src 'self' blob: data:",
            },
        )

    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    return app


def _version() -> str:
    try:
        return version("helios-ovmm")
    except PackageNotFoundError:
        return "0"
