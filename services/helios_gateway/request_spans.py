"""Spans of HTTP requests, for those that change something or bring a W3C `traceparent`.

A dashboard reads images and maps all the time; these reads would bury the traces of tasks.
"""

from __future__ import annotations

from helios_core import tracing
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.audit_log import SAFE_METHODS
from helios_gateway.prometheus_metrics import route_pattern


class RequestSpans:
    """ASGI middleware that records a span per request, if this process traces."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not tracing.is_on():
            await self._app(scope, receive, send)
            return
        parent = tracing.valid(Headers(scope=scope).get("traceparent", "").strip())
        if scope["method"] in SAFE_METHODS and not parent:
            await self._app(scope, receive, send)
            return
        with tracing.span(scope["method"], parent=parent) as span:

            async def named(message: Message) -> None:
                if message["type"] == "http.response.start":
                    route = route_pattern(scope)
                    span.rename(f"{scope['method']} {route}")
                    span.set("http.route", route)
                    span.set("http.response.status_code", message["status"])
                await send(message)

            await self._app(scope, receive, named)
