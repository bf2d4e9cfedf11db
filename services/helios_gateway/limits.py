"""What is refused before a request is looked at: bodies too large, pages of other sites."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.problems import problem


class Limits:
    """ASGI middleware. A body above the limit is never held; a browser's request that another
    site's page makes (its `Origin` is not this host) may not change anything."""

    def __init__(self, app: ASGIApp, body_limit_bytes: int) -> None:
        self._app = app
        self._limit = body_limit_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD", "OPTIONS"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != headers.get("host"):
            refusal = problem(
                403, "forbidden", "Forbidden",
                f"a page of {origin[:200]} asked; only the dashboard's own page may command",
            )  # fmt: skip
            await refusal(scope, receive, send)
            return
        body = await self._body(receive)
        if body is None:
            refusal = problem(
                413, "too-large", "Content Too Large",
                f"the body is larger than {self._limit} bytes; send less",
            )  # fmt: skip
            refusal.headers["connection"] = "close"
            await refusal(scope, receive, send)
            return

        pending: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def replay() -> Message:
            return pending.pop() if pending else await receive()

        await self._app(scope, replay, send)

    async def _body(self, receive: Receive) -> bytes | None:
        """The whole body, or None once it is above the limit."""
        body = bytearray()
        while True:
            message = await receive()
            if message["type"] != "http.request":
                return bytes(body)
            body += message.get("body", b"")
            if len(body) > self._limit:
                return None
            if not message.get("more_body", False):
                return bytes(body)
