"""Address, headers and deadlines of a gateway, shared by the blocking and the asynchronous
client."""

from __future__ import annotations

import math
from typing import Any
from urllib.parse import quote

import httpx
from helios_core.errors import InvalidInput

from helios_client.http.address import base_url as full_url
from helios_client.http.requests import Call, event_query

POLL_S = 0.3
SILENCE_S = 30.0  # a gateway is restarted within seconds
EVENT_RETRY_S = 0.5
CONNECT_S = 3.0


class Connection:
    """Address, deadlines and headers of a gateway; no I/O."""

    def __init__(self, base_url: str, timeout_s: float, key: str | None, robot: str | None) -> None:
        """Raises InvalidInput for an invalid address or key."""
        try:
            self.url = full_url(base_url)
        except ValueError as error:
            raise InvalidInput(str(error)) from error
        if key and not (key.isascii() and key.isprintable()):
            raise InvalidInput(
                "the API key has letters that no key has; give it as `helios key` printed it"
            )
        self._prefix = f"/v1/robots/{quote(robot, safe='')}" if robot else "/v1"
        self._timeout_s = timeout_s
        self._headers = {"authorization": f"Bearer {key}"} if key else {}

    def options(self) -> dict[str, Any]:
        """Arguments of `httpx.Client` and `httpx.AsyncClient`."""
        return {
            "base_url": self.url,
            "headers": self._headers,
            "timeout": httpx.Timeout(self._timeout_s, connect=min(CONNECT_S, self._timeout_s)),
            "trust_env": False,  # a proxy from the environment cannot reach loopback
        }

    def request(self, call: Call[Any]) -> dict[str, Any]:
        """Arguments of the client's `request`. Raises InvalidInput for a number that is not
        finite."""
        for name, value in (call.body or {}).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise InvalidInput(f"{name} is {value}; wanted a finite number")
        out: dict[str, Any] = {
            "method": call.verb,
            "json": call.body,
            "url": ("/v1" if call.of_all else self._prefix) + call.path,
            "params": dict(call.query),
        }
        if call.content is not None:
            out |= {"content": call.content, "headers": {"content-type": "application/zip"}}
        if call.timeout_s is not None:
            connect_s = min(CONNECT_S, self._timeout_s)
            out["timeout"] = httpx.Timeout(call.timeout_s, connect=connect_s)
        return out

    @property
    def timeout_s(self) -> float:
        return self._timeout_s

    def socket_request(self, path: str) -> dict[str, Any]:
        """Arguments of `connect` of websockets."""
        scheme, _, rest = self.url.partition("://")
        secure = "s" if scheme == "https" else ""
        return {
            "uri": f"ws{secure}://{rest}{self._prefix}{path}",
            "additional_headers": self._headers,
            "open_timeout": self._timeout_s,
            "proxy": None,
        }

    def event_request(
        self, types: tuple[str, ...], task_id: str | None, last_id: str, silence_s: float
    ) -> dict[str, Any]:
        """Arguments of the client's `stream`, for events."""
        return {
            "method": "GET",
            "url": f"{self._prefix}/events",
            "params": event_query(types, task_id),
            "headers": {"last-event-id": last_id} if last_id else {},
            "timeout": httpx.Timeout(self._timeout_s, read=silence_s),
        }
