"""How the backend is, for people, for orchestrators and for Prometheus."""

from __future__ import annotations

from fastapi import APIRouter, Response

from helios_gateway import models
from helios_gateway.live import Live
from helios_gateway.metrics import Metrics


def health_routes(live: Live, metrics: Metrics) -> APIRouter:
    """`/v1/status`, `/healthz`, `/readyz`, `/metrics`."""
    routes = APIRouter(tags=["health"])

    @routes.get("/v1/status", summary="Every service")
    async def status() -> models.Status:
        return live.status()

    @routes.get("/healthz", summary="Is the gateway itself well?")
    async def healthz() -> models.Healthy:
        return models.Healthy()

    @routes.get(
        "/readyz",
        summary="Would a task start now?",
        responses={503: {"model": models.Readiness, "description": "no, for these reasons"}},
    )
    async def readyz(response: Response) -> models.Readiness:
        reasons = live.roster.reasons()
        response.status_code = 503 if reasons else 200
        return models.Readiness(ready=not reasons, reasons=reasons)

    @routes.get(
        "/metrics",
        summary="Figures in Prometheus' text form",
        response_class=Response,
        responses={200: {"content": {"text/plain": {}}}},
    )
    async def prometheus() -> Response:
        text, media_type = metrics.text()
        return Response(text, headers={"content-type": media_type})

    return routes
