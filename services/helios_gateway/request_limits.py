"""Limits on requests before they are handled: size, rate, concurrency and origin."""

from __future__ import annotations

import asyncio
import ipaddress
import re
from collections.abc import Collection
from dataclasses import dataclass
from urllib.parse import urlsplit

from helios_core.errors import HeliosError
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.api_keys import ApiKeys
from helios_gateway.api_keys import Scope as KeyScope
from helios_gateway.audit_log import SAFE_METHODS
from helios_gateway.dependencies import check, key_of
from helios_gateway.error_responses import problem, problem_of
from helios_gateway.request_rate import RequestRate

# Paths below the root of a robot.
UNLIMITED = ("/robot/stop",)  # no limit applies; the handler reads the body itself
LARGE = ("/frames",)  # image bodies; at most `MOST_LARGE` at a time
MOST_LARGE = 8
STALL_S = 3.0  # longest wait for the next bytes of a body
MAPS = ("/map.zip", "/map/ros.zip")  # large bodies of maps; one at a time
MAP_BODY_S = 60.0
STREAMS = (
    "/events",
    "/events/ws",
    "/frames/ws",
    "/robot/teleop",
)  # limited as open streams, not as concurrent requests
# Counted apart from all others, so that nobody who only reads can block them.
CONTROLS = re.compile(r"/robot/clear-stop|(?:/fleet)?/tasks/[^/]+/(?:cancel|pause|resume)")
_LARGE_BODIES = {("POST", "/frames"): KeyScope.ROBOT, ("PUT", "/map.zip"): KeyScope.ADMIN}
_ROBOT = re.compile(r"/v1(?:/robots/[^/]+)?(/.*)", re.DOTALL)


@dataclass(frozen=True)
class LimitSettings:
    """Limits for requests."""

    body_bytes: int
    large_bytes: int  # of an image body
    map_bytes: int  # of a map body
    body_s: float  # time limit for the arrival of a body
    requests_per_s: int  # per client
    requests: int  # concurrent, of all clients; as many again to `CONTROLS`
    origins: tuple[str, ...] = ()  # other sites whose pages may use the API

    def of_body(self, method: str, path: str) -> tuple[int, float]:
        """Limits of a body (bytes, seconds) for a method and a path below the root of a robot."""
        if (method, path) not in _LARGE_BODIES:
            return self.body_bytes, self.body_s
        return (self.map_bytes, MAP_BODY_S) if path in MAPS else (self.large_bytes, self.body_s)


class RequestLimits:
    """ASGI middleware that enforces `LimitSettings` and checks host and origin.

    A body above the limit is never kept in memory, and a large one only with a sufficient key. A
    page of another site (its `Origin` is neither this host nor in the list) may change nothing and
    open no socket. If no key is required, the `Host` header must name this machine; this prevents
    DNS rebinding.
    """

    def __init__(self, app: ASGIApp, bounds: LimitSettings, keys: ApiKeys) -> None:
        self._app, self._bounds, self._keys = app, bounds, keys
        self._rate = RequestRate(bounds.requests_per_s)
        self._running = self._controls = self._large = self._maps = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(refusal, scope, receive, send)
            return
        path = _below_robot(scope)
        control = scope["type"] == "http" and CONTROLS.fullmatch(path) is not None
        counted = not control and path not in (*STREAMS, *UNLIMITED)
        large = path in LARGE
        a_map = path in MAPS
        for refused, running in (
            (counted and self._running >= self._bounds.requests, self._running),
            (control and self._controls >= self._bounds.requests, self._controls),
            (large and self._large >= MOST_LARGE, self._large),
            (a_map and self._maps >= 1, self._maps),
        ):
            if refused:
                await _refuse(_busy(running), scope, receive, send)
                return
        self._running += counted
        self._controls += control
        self._large += large
        self._maps += a_map
        try:
            await self._with_body(scope, receive, send)
        finally:
            self._running -= counted
            self._controls -= control
            self._large -= large
            self._maps -= a_map

    def _refusal(self, scope: Scope) -> JSONResponse | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._keys.required and not _is_this_machine(host):
            return problem(
                403,
                "forbidden",
                "Forbidden",
                f"the host {host[:200]!r} is not this machine; ask localhost, or set up API keys",
            )
        origin = headers.get("origin")
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if origin is not None and changes and not self._is_own(origin, host):
            return problem(
                403,
                "forbidden",
                "Forbidden",
                f"a page of {origin[:200]} asked; only the dashboard's own page may, and those of "
                "--origins",
            )
        if _below_robot(scope) in UNLIMITED:
            return None
        key = key_of(scope, self._keys) if self._keys.required else None
        client = f"key {key.name}" if key else f"host {(scope.get('client') or ('',))[0]}"
        if self._rate.allows(client):
            return None
        out = problem(
            429,
            "too-many",
            "Too Many Requests",
            f"more than {self._bounds.requests_per_s} requests a second; ask less often, or watch "
            "/v1/events",
        )
        out.headers["retry-after"] = "1"
        return out

    def _is_own(self, origin: str, host: str) -> bool:
        try:
            site = urlsplit(origin).netloc
        except ValueError:  # unbalanced brackets
            return False
        return site == host or origin in self._bounds.origins

    async def _with_body(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = _below_robot(scope)
        if scope["type"] == "websocket" or scope["method"] in SAFE_METHODS or path in UNLIMITED:
            await self._app(scope, receive, send)
            return
        needed = _LARGE_BODIES.get((scope["method"], path))
        if needed is not None:  # without the key the body is not kept
            try:
                check(HTTPConnection(scope), needed)
            except HeliosError as error:
                await _refuse_body(problem_of(error), scope, receive, send)
                return
        limit, within_s = self._bounds.of_body(scope["method"], path)
        try:
            async with asyncio.timeout(within_s):
                body = await _body(receive, limit)
        except ClientDisconnect:  # nobody waits for an answer
            return
        except TimeoutError as late:
            said = str(late) or f"the body did not arrive within {within_s:g} s"
            refusal = problem(408, "late", "Request Timeout", f"{said}; send it at once")
            await _refuse_body(refusal, scope, receive, send)
            return
        if body is None:
            refusal = problem(
                413,
                "too-large",
                "Content Too Large",
                f"the body is larger than {limit} bytes; send less",
            )
            await _refuse_body(refusal, scope, receive, send)
            return
        pending: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def replay() -> Message:
            return pending.pop() if pending else await receive()

        await self._app(scope, replay, send)


async def _body(receive: Receive, limit: int) -> bytes | None:
    """Whole body, or None once it exceeds the limit in bytes.

    Raises TimeoutError when it stops arriving: an idle sender occupies a slot that others need.
    Raises ClientDisconnect if the client leaves before its end.
    """
    body = bytearray()
    while True:
        try:
            async with asyncio.timeout(STALL_S):
                message = await receive()
        except TimeoutError:
            raise TimeoutError(f"no byte of the body came for {STALL_S:g} s") from None
        if message["type"] != "http.request":
            raise ClientDisconnect
        body += message.get("body", b"")
        if len(body) > limit:
            return None
        if not message.get("more_body", False):
            return bytes(body)


def _below_robot(scope: Scope) -> str:
    """Path of a request without the root of its robot."""
    path: str = scope["path"]
    found = _ROBOT.fullmatch(path)
    return found[1] if found else path


async def _refuse_body(refusal: JSONResponse, scope: Scope, receive: Receive, send: Send) -> None:
    """Refuse a request and close its connection without waiting for the rest of the body."""
    refusal.headers["connection"] = "close"
    await refusal(scope, receive, send)


async def _refuse(refusal: JSONResponse, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket" and "websocket.http.response" not in _extensions(scope):
        await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
        return
    await refusal(scope, receive, send)


def _extensions(scope: Scope) -> Collection[str]:
    return scope.get("extensions") or {}


def _busy(running: int) -> JSONResponse:
    out = problem(
        503,
        "busy",
        "Service Unavailable",
        f"{running} such requests are being answered; try again in a second",
    )
    out.headers["retry-after"] = "1"
    return out


def _is_this_machine(host: str) -> bool:
    """True for a loopback name or a numeric address: no foreign DNS can assign either."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        if name == "localhost" or name.endswith(".localhost"):
            return True
        ipaddress.ip_address(name)
    except ValueError:  # a foreign name, or none
        return False
    return True
