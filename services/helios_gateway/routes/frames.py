"""`/frames` and `/frames/ws`: external frames, one per form or many over a WebSocket."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass
from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, File, Form, WebSocket, WebSocketDisconnect
from helios_core import proto as pb
from helios_core.errors import HeliosError, InvalidInput
from helios_core.topics import PUSH
from starlette.responses import JSONResponse

from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, GatewayState, State, check, secured
from helios_gateway.error_responses import Forbidden, Unauthorized, problem, problem_of, problems
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.uploaded_frames import FrameTaken, push_request, push_response, read_meta

MOST_SENDERS = 8  # concurrent sockets
BRIDGE_QUEUE_S = 12.0  # time for the bridge to process earlier frames
FAREWELL_S = 1.0  # time limit for sending the reason of a close
GOING_AWAY, NOT_ALLOWED = 1001, 1008
router = APIRouter(tags=["frames"])


@router.post(
    "/frames",
    summary="Send a frame to the maps",
    responses=problems(409, body=True),
    dependencies=secured(Scope.ROBOT),
)
async def post_frame(
    robot: AddressedRobot,
    state: State,
    meta: Annotated[str, Form(description="JSON object with K, T_world_cam and optional fields")],
    color: Annotated[bytes, File(description="colour image, JPEG or PNG")],
    depth: Annotated[
        bytes | None,
        File(description="depth image, PNG with one 16-bit channel, registered to color"),
    ] = None,
) -> FrameTaken:
    """Send a frame to the maps as a keyframe.

    For an external camera: `helios up --robot push`. The response comes when the maps have
    answered, and holds the acknowledgement of each map.

    `meta` is JSON: `K` (9 numbers) and `T_world_cam` (4 rows of 4); optional `T_world_base`,
    `stamp_ns`, `depth_scale_m` (0.001), `robot_boot_id`, `world_epoch`, `classes` (names to
    look for) and `wait_s` (5).

    For many frames the WebSocket `/v1/frames/ws` is faster. Send three messages per frame: the
    same `meta` as text, then the two files as binary (empty: no depth). The gateway answers
    each frame with one text: the response of this endpoint, or a problem.
    """
    return await _push(robot, state, meta, color, depth)


@router.websocket("/frames/ws")
async def socket(robot: AddressedRobot, state: State, socket: WebSocket) -> None:
    try:
        check(socket, Scope.ROBOT)
        slot = state.frame_sockets.taken()
    except HeliosError as error:
        await socket.send_denial_response(problem_of(error))
        return
    with contextlib.suppress(WebSocketDisconnect):
        with slot:
            end = await _answer_frames(robot, state, socket)
        # The slot is already free, so a sender that does not read blocks nobody.
        with contextlib.suppress(TimeoutError, RuntimeError):
            async with asyncio.timeout(FAREWELL_S):
                await socket.send_text(_as_text(end.problem))
                await socket.close(end.code, end.why)


async def _push(
    robot: RobotEndpoint, state: GatewayState, meta: str | bytes, color: bytes, depth: bytes | None
) -> FrameTaken:
    """Acknowledgements of the maps for one frame. Raises HeliosError."""

    def call() -> pb.PushReply:
        known = read_meta(meta)
        request = push_request(known, color, depth)
        timeout_s = known.wait_s + BRIDGE_QUEUE_S + state.settings.call_timeout_s
        return robot.bus.call(PUSH, request, timeout_s)

    return push_response(await anyio.to_thread.run_sync(call, limiter=state.frame_threads))


async def _answer_frames(robot: RobotEndpoint, state: GatewayState, socket: WebSocket) -> _End:
    """Answer frames until the sender is silent or its key is revoked; return the reason.

    Raises WebSocketDisconnect.
    """
    idle_s = state.settings.frame_idle_s
    await socket.accept()
    messages = _Messages(socket, idle_s)
    while True:
        try:
            frame = await messages.next_frame()
            check(socket, Scope.ROBOT)
            answer = (await _push(robot, state, *frame)).model_dump_json()
        except _Silent as silent:
            return _End.late(str(silent))
        except (Unauthorized, Forbidden) as error:
            return _End(problem_of(error), NOT_ALLOWED, "the key is not accepted any more")
        except HeliosError as error:
            answer = _as_text(problem_of(error))
        try:
            async with asyncio.timeout(idle_s):
                await socket.send_text(answer)
        except TimeoutError:
            return _End.late(f"the answer was not read for {idle_s:g} s; connect again")


@dataclass(frozen=True)
class _End:
    """Last message and close reason of a sender's socket."""

    problem: JSONResponse
    code: int  # of the close frame
    why: str  # of the close frame, at most 123 bytes

    @classmethod
    def late(cls, why: str) -> _End:
        return cls(problem(408, "late", "Request Timeout", why), GOING_AWAY, why)


class _Silent(Exception):
    """The next message of a sender did not arrive in time."""


def _as_text(problem: JSONResponse) -> str:
    return bytes(problem.body).decode()


class _Messages:
    """Groups a socket's messages into frames: one text, then two binary messages."""

    def __init__(self, socket: WebSocket, idle_s: float) -> None:
        """idle_s: time limit for the arrival of one whole message."""
        self._socket, self._idle_s = socket, idle_s
        self._text: str | None = None  # text that came too early

    async def next_frame(self) -> tuple[str, bytes, bytes]:
        """Next frame as (meta, color, depth).

        Raises WebSocketDisconnect at the end, _Silent after a timeout, and InvalidInput once for
        every message out of order. The frame after such a message is read normally.
        """
        meta, self._text = self._text, None
        if meta is None:
            meta = await self._receive()
        if isinstance(meta, bytes):
            raise InvalidInput(
                "a binary message came where a frame's meta was due; send it as text"
            )
        images: list[bytes] = []
        for name in ("color", "depth"):
            image = await self._receive()
            if isinstance(image, str):
                self._text = image
                raise InvalidInput(f"a text came where {name} was due; send its file as binary")
            images.append(image)
        return meta, images[0], images[1]

    async def _receive(self) -> str | bytes:
        try:
            async with asyncio.timeout(self._idle_s):
                message = await self._socket.receive()
        except TimeoutError:
            raise _Silent(
                f"no whole message came for {self._idle_s:g} s; connect again for the next frame"
            ) from None
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1000))
        text = message.get("text")
        return message.get("bytes") or b"" if text is None else text
