"""Driving by hand over the WebSocket: commands and their responses.

A command expires after 0.3 s: the robot stops if no newer one comes. Commands are repeated only
inside a call with `for_s`, so a program that hangs leaves the robot at rest.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Self

import httpx
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, InvalidInput, Unavailable

from helios_client.http.connection import Connection
from helios_client.http.errors import NoGateway, response_error

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection as AsyncSocket
    from websockets.sync.client import ClientConnection as Socket

REPEAT_S = 0.1  # period at which a held command is sent again
NOT_ALLOWED = 1008
_REFUSALS: dict[str, type[HeliosError]] = {
    "invalid": InvalidInput,
    "unavailable": Unavailable,
    "timeout": DeadlineExceeded,
}


@dataclass(frozen=True)
class TeleopState:
    """State of the drive, as the gateway reports it."""

    state: str  # standing, driving, blocked
    reason: str  # why it is blocked
    pose: dict[str, float] | None  # x_m, y_m, yaw_rad after the newest move

    @classmethod
    def from_json(cls, text: str | bytes) -> TeleopState:
        """State from a message. Raises Conflict if the robot may not be driven now, or the error
        type that a refusal names."""
        raw = json.loads(text)
        if raw["state"] == "refused":
            raise _REFUSALS.get(raw.get("kind", ""), Conflict)(raw["reason"])
        return cls(raw["state"], raw["reason"], raw["pose"])


class Teleop:
    """Connection for driving by hand: a context manager, called with each command. For use in one
    thread."""

    def __init__(self, to: Connection) -> None:
        self._to = to
        self._socket: Socket | None = None
        self._state = TeleopState("standing", "", None)

    def __call__(self, forward: float = 0.0, turn: float = 0.0, for_s: float = 0.0) -> TeleopState:
        """Send a command and return the newest state. The command is a share of each speed limit,
        -1 to 1; a positive turn goes left. It expires after 0.3 s: call again while the robot is to
        move. With `for_s` it is held for that many seconds and then released.

        Raises InvalidInput, before anything is sent, for a value that is not such a share; Conflict
        if the robot may not be driven (a task, stop-now, another client); and Unavailable if the
        connection has ended; the robot then stops.
        """
        _check(forward, turn, for_s)
        ends_s = time.monotonic() + for_s
        try:
            self._send(forward, turn)
            while (left_s := ends_s - time.monotonic()) > 0:
                time.sleep(min(REPEAT_S, left_s))
                self._send(forward, turn)
        finally:
            if for_s:
                self._send(0.0, 0.0)
        return self._state

    def __enter__(self) -> Self:
        from websockets.sync.client import connect

        try:
            self._socket = connect(**self._to.socket_request("/robot/teleop"))
            self._state = TeleopState.from_json(self._socket.recv(timeout=self._to.timeout_s))
        except BaseException as error:
            self._close()
            raise _error_for(error, self._to.url) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._close()

    def _send(self, forward: float, turn: float) -> None:
        socket = self._socket
        if socket is None:
            raise InvalidInput("this is no open connection; use it as: with helios.teleop() as …")
        try:
            socket.send(_command(forward, turn))
            while True:
                self._state = TeleopState.from_json(socket.recv(timeout=0))
        except TimeoutError:
            return
        except Exception as error:
            raise _error_for(error, self._to.url) from error

    def _close(self) -> None:
        socket, self._socket = self._socket, None
        if socket is not None:
            socket.close()


class AsyncTeleop:
    """`Teleop` with `async with` and `await drive(…)`. For use in one asyncio task."""

    def __init__(self, to: Connection) -> None:
        self._to = to
        self._socket: AsyncSocket | None = None
        self._state = TeleopState("standing", "", None)

    async def __call__(
        self, forward: float = 0.0, turn: float = 0.0, for_s: float = 0.0
    ) -> TeleopState:
        """See `Teleop.__call__`."""
        _check(forward, turn, for_s)
        ends_s = time.monotonic() + for_s
        try:
            await self._send(forward, turn)
            while (left_s := ends_s - time.monotonic()) > 0:
                await asyncio.sleep(min(REPEAT_S, left_s))
                await self._send(forward, turn)
        finally:
            if for_s:
                await self._send(0.0, 0.0)
        return self._state

    async def __aenter__(self) -> Self:
        from websockets.asyncio.client import connect

        try:
            self._socket = await connect(**self._to.socket_request("/robot/teleop"))
            async with asyncio.timeout(self._to.timeout_s):
                self._state = TeleopState.from_json(await self._socket.recv())
        except BaseException as error:
            await self._close()
            raise _error_for(error, self._to.url) from error
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self._close()

    async def _send(self, forward: float, turn: float) -> None:
        socket = self._socket
        if socket is None:
            raise InvalidInput("this is no open connection; use it as: async with … as drive")
        try:
            await socket.send(_command(forward, turn))
            while True:
                async with asyncio.timeout(0):
                    self._state = TeleopState.from_json(await socket.recv())
        except TimeoutError:
            return
        except Exception as error:
            raise _error_for(error, self._to.url) from error

    async def _close(self) -> None:
        socket, self._socket = self._socket, None
        if socket is not None:
            await socket.close()


def _check(forward: float, turn: float, for_s: float) -> None:
    """Raise InvalidInput for a command that the gateway would refuse."""
    for name, share in (("forward", forward), ("turn", turn)):
        if isinstance(share, bool) or not isinstance(share, int | float) or not abs(share) <= 1:
            raise InvalidInput(f"{name} is {share!r}; wanted a share of the limit, -1 to 1")
    if not 0 <= for_s < math.inf:
        raise InvalidInput(f"for_s is {for_s!r}; wanted seconds, 0 or more")


def _command(forward: float, turn: float) -> str:
    return json.dumps({"forward": forward, "turn": turn})


def _error_for(error: BaseException, url: str) -> BaseException:
    """Typed error for a connection failure; any other error unchanged."""
    from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus

    if isinstance(error, HeliosError):
        return error
    if isinstance(error, InvalidStatus):
        answer = error.response
        request = httpx.Request("GET", url)
        return response_error(
            httpx.Response(answer.status_code, content=bytes(answer.body), request=request)
        )
    if isinstance(error, ConnectionClosed):
        why = error.rcvd.reason if error.rcvd is not None else ""
        kind = InvalidInput if error.rcvd and error.rcvd.code == NOT_ALLOWED else Unavailable
        return kind(f"the connection to drive by ended ({why or 'it broke off'}); connect again")
    if isinstance(error, TimeoutError):
        return DeadlineExceeded(f"{url} gave no answer in time; see `helios status`")
    if isinstance(error, OSError):
        return NoGateway(f"nobody answers at {url}; start HELIOS with `helios up`")
    if isinstance(error, InvalidHandshake):
        return Unavailable(f"{url} opened no connection to drive by ({error}); is HELIOS there?")
    return error
