"""Limits on requests before they are handled: size, rate, concurrency and origin."""

from __future__ import annotations

import asyncio
import ipaddress
import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from urllib.parse import urlsplit

from helios_core.errors import HeliosError
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.api_keys import ApiKey, ApiKeys
from helios_gateway.api_keys import Scope as KeyScope
from helios_gateway.audit_log import SAFE_METHODS
from helios_gateway.dependencies import check_scope, key_of
from helios_gateway.error_responses import problem, problem_of
from helios_gateway.request_rate import RequestRate

PROBES = ("/healthz", "/readyz")  # no limit applies; they read no body
SIGN_IN = "/v1/session"  # needs no key: it brings one in its body, or removes the cookie
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
CLEAR_STOP = "/robot/clear-stop"
CONTROLS = re.compile(rf"{CLEAR_STOP}|(?:/fleet)?/tasks/[^/]+/(?:cancel|pause|resume)")
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
    requests: int  # concurrent; as many again to `CONTROLS`, and as many again without a key
    origins: tuple[str, ...] = ()  # other sites whose pages may use the API

    def of_body(self, method: str, path: str) -> tuple[int, float]:
        """Limits of a body (bytes, seconds) for a method and a path below the root of a robot."""
        if (method, path) not in _LARGE_BODIES:
            return self.body_bytes, self.body_s
        return (self.map_bytes, MAP_BODY_S) if path in MAPS else (self.large_bytes, self.body_s)


class RequestLimits:
    """ASGI middleware that enforces `LimitSettings` and checks host and origin.

    A body above the limit is never kept in memory. If keys are required, no body is awaited before
    its key is checked, and requests without a known key have places of their own: they cannot
    occupy those of the others. A page of another site (its `Origin` is neither this host nor in the
    list) may change nothing and open no socket. If no key is required, the `Host` header must name
    this machine; this prevents DNS rebinding.
    """

    def __init__(self, app: ASGIApp, bounds: LimitSettings, keys: ApiKeys) -> None:
        self._app, self._bounds, self._keys = app, bounds, keys
        self._rate = RequestRate(bounds.requests_per_s)
        self._running: Counter[str] = Counter()  # by the names of `_places`

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._foreign(scope)
        if refusal is not None:
            await _refuse(refusal, scope, receive, send)
            return
        if scope["path"] in PROBES or _below_robot(scope) in UNLIMITED:
            await self._app(scope, receive, send)
            return
        key = key_of(scope, self._keys) if self._keys.required else None
        client = f"key {key.name}" if key else f"host {(scope.get('client') or ('',))[0]}"
        if not self._rate.allows(client):
            await _refuse(self._too_many(), scope, receive, send)
            return
        try:
            self._check_key(scope, key)
        except HeliosError as error:
            await _refuse_body(problem_of(error), scope, receive, send)
            return
        places = self._places(scope, key)
        for place in places:
            most = {"large": MOST_LARGE, "maps": 1}.get(place, self._bounds.requests)
            if self._running[place] >= most:
                await _refuse(_busy(self._running[place]), scope, receive, send)
                return
        self._running.update(places)
        try:
            await self._with_body(scope, receive, send)
        finally:
            self._running.subtract(places)

    def _check_key(self, scope: Scope, key: ApiKey | None) -> None:
        """Check the key of a request with a body. Raises Unauthorized and Forbidden.

        The endpoints check the scope again, and that of all other requests.
        """
        if not self._keys.required or not _has_body(scope) or scope["path"].rstrip("/") == SIGN_IN:
            return
        path = _below_robot(scope)
        needed = _LARGE_BODIES.get((scope["method"], path), KeyScope.READ)
        if CONTROLS.fullmatch(path):
            needed = KeyScope.ROBOT if path == CLEAR_STOP else KeyScope.TASK
        check_scope(key, needed)

    def _places(self, scope: Scope, key: ApiKey | None) -> list[str]:
        """Names of the limits on concurrent requests to which this one counts."""
        path = _below_robot(scope)
        if path in STREAMS:
            return []
        if scope["type"] == "http" and CONTROLS.fullmatch(path):
            return ["controls"]
        out = ["keyless" if self._keys.required and key is None else "requests"]
        if path in LARGE:
            out.append("large")
        if path in MAPS:
            out.append("maps")
        return out

    def _foreign(self, scope: Scope) -> JSONResponse | None:
        """Refusal of a foreign host or origin; None if both may ask."""
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
        return None

    def _too_many(self) -> JSONResponse:
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
        if not _has_body(scope):
            await self._app(scope, receive, send)
            return
        limit, within_s = self._bounds.of_body(scope["method"], _below_robot(scope))
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


def _has_body(scope: Scope) -> bool:
    """True for a request that may change something; the body of another one is not read."""
    return scope["type"] == "http" and scope["method"] not in SAFE_METHODS


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
