"""`/robot/teleop` and `/robot/drive`: driving by hand, over a WebSocket or by one short move."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated

import anyio
import anyio.to_thread
from fastapi import APIRouter, Body, Request, WebSocket, WebSocketDisconnect
from helios_core.errors import HeliosError, InvalidInput
from helios_core.printable_text import printable
from helios_core.robot import Forward, Turn
from pydantic import ValidationError
from starlette.requests import HTTPConnection

from helios_gateway.api_keys import Scope
from helios_gateway.dependencies import AddressedRobot, State, check, key_of, secured, state_of
from helios_gateway.error_responses import Forbidden, Unauthorized, problem_of, problems
from helios_gateway.message_conversion import finite, pose_of
from helios_gateway.request_validation import errors_text
from helios_gateway.robot_registry import Served
from helios_gateway.settings import Settings
from helios_gateway.teleop.driver import TeleopDriver, check_may_drive, described
from helios_gateway.teleop.limits import check_move
from helios_gateway.teleop.messages import DriveRequest, DriveResult, TeleopCommand
from helios_gateway.teleop.pacing import Command
from helios_gateway.teleop.session import TeleopSession

MOST_DRIVERS = 8  # sockets open at the same time
SEND_S = 2.0  # that a driver has for reading a state
GOING_AWAY, NOT_ALLOWED = 1001, 1008
router = APIRouter(prefix="/robot", tags=["robot"])


@router.post(
    "/drive",
    summary="Make one short move",
    responses=problems(409, body=True),
    dependencies=secured(Scope.OPERATE),
)
async def drive(
    robot: AddressedRobot,
    state: State,
    request: Request,
    asked: Annotated[DriveRequest, Body()],
) -> DriveResult:
    """At most 0.5 m or 0.6 rad, within the robot's own limits; answered when it is over. A
    move that the robot could not make is `succeeded: false` with its reason.

    Refused (409) while a task is running or paused, while the robot is stopped, while somebody
    else drives, and where the robot offers no motion.

    To drive for as long as a command is held: the WebSocket `/v1/robot/teleop`. Send
    `{"forward": -1..1, "turn": -1..1}` at least every 0.3 s while the robot shall move; it
    stands within one short move of the last one, of `{}`, and of the end of the connection.
    Each change is told as `{"state", "reason", "kind", "pose"}`; states are `standing`,
    `driving`, `blocked` and `refused`. The kind of a refusal is `invalid` for a wrong command
    and `conflict` where the robot is not to be driven now."""
    driver = TeleopDriver(robot, _who(request), state.settings.call_timeout_s)
    return await anyio.to_thread.run_sync(
        _one_move, robot, driver, asked, limiter=state.teleop_threads
    )


@router.websocket("/teleop")
async def socket(robot: AddressedRobot, state: State, socket: WebSocket) -> None:
    try:
        check(socket, Scope.OPERATE)
        slot = state.teleop_sockets.taken()
    except HeliosError as error:
        await socket.send_denial_response(problem_of(error))
        return
    settings = state.settings
    with slot:
        await socket.accept()
        driver = TeleopDriver(robot, _who(socket), settings.call_timeout_s)
        session = TeleopSession(driver, settings, state.teleop_threads)
        end = await _driven(robot, socket, session, settings)
    if end is not None:
        with contextlib.suppress(TimeoutError, RuntimeError):
            async with asyncio.timeout(SEND_S):
                await socket.close(*end)


def _one_move(robot: Served, driver: TeleopDriver, asked: DriveRequest) -> DriveResult:
    """Makes one move under the driver's lease, and gives the lease back. Raises HeliosError."""
    check_move(asked, described(robot))
    driver.acquire()
    try:
        action = Forward(asked.forward_m) if asked.forward_m else Turn(asked.turn_rad)
        result = driver.move(action, keyframe=True)
    finally:
        with contextlib.suppress(HeliosError):
            driver.release()
    return DriveResult(
        succeeded=result.succeeded, reason=printable(result.reason),
        moved_m=finite(result.moved_m), turned_rad=finite(result.turned_rad),
        collided=result.collided, pose=pose_of(result.T_world_base.rows),
    )  # fmt: skip


async def _driven(
    robot: Served, socket: WebSocket, session: TeleopSession, settings: Settings
) -> tuple[int, str] | None:
    """Serves a driver until it is gone, silent or not allowed any more; the robot stands then.

    Returns the code and the reason for closing the socket; None where the driver is gone.
    """
    async with anyio.create_task_group() as group:
        group.start_soon(session.run, lambda: check_may_drive(robot, settings.call_timeout_s))
        group.start_soon(_tell, socket, session)
        try:
            return await _commands(socket, session, settings)
        finally:
            group.cancel_scope.cancel()


async def _commands(
    socket: WebSocket, session: TeleopSession, settings: Settings
) -> tuple[int, str] | None:
    """Takes commands as they come. Returns what `_driven` returns."""
    while True:
        try:
            async with asyncio.timeout(settings.teleop_idle_s):
                message = await socket.receive()
        except TimeoutError:
            return GOING_AWAY, f"no command for {settings.teleop_idle_s:g} s; connect again"
        if message["type"] == "websocket.disconnect":
            return None
        try:
            check(socket, Scope.OPERATE)
        except (Unauthorized, Forbidden):
            return NOT_ALLOWED, "the key is not accepted any more"
        try:
            text = message.get("text") or message.get("bytes") or b""
            asked = TeleopCommand.model_validate_json(text)
        except ValidationError as error:
            session.refuse(InvalidInput(f"the command is wrong: {errors_text(error.errors())}"))
            continue
        session.command(Command(asked.forward, asked.turn))


async def _tell(socket: WebSocket, session: TeleopSession) -> None:
    """Sends each new state, and of several that came meanwhile the newest."""
    await session.checked.wait()
    while True:
        changed = session.changed
        try:
            async with asyncio.timeout(SEND_S):
                await socket.send_text(session.state.model_dump_json())
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            return  # gone, or not reading: its commands decide
        await changed.wait()


def _who(connection: HTTPConnection) -> str:
    """The name of the driver's key; empty where no key is asked for."""
    key = key_of(connection.scope, state_of(connection).keys)
    return key.name if key else ""
