"""`/robot/teleop` and `/robot/drive`: teleoperation over a WebSocket, or by one short move."""

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
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.settings import Settings
from helios_gateway.teleop.driver import TeleopLease, check_may_drive, require_drivable
from helios_gateway.teleop.limits import check_move
from helios_gateway.teleop.messages import DriveRequest, DriveResult, TeleopCommand
from helios_gateway.teleop.pacing import Command
from helios_gateway.teleop.session import TeleopSession

MOST_DRIVERS = 8  # concurrent sockets
SEND_S = 2.0  # time limit for sending one state
GOING_AWAY, NOT_ALLOWED = 1001, 1008
router = APIRouter(prefix="/robot", tags=["robot"])


@router.post(
    "/drive",
    summary="Make one short move",
    responses=problems(409, body=True),
    dependencies=secured(Scope.ROBOT),
)
async def drive(
    robot: AddressedRobot,
    state: State,
    request: Request,
    asked: Annotated[DriveRequest, Body()],
) -> DriveResult:
    """Make one short move of at most 0.5 m or 0.6 rad, within the robot's own limits.

    The response comes when the move is over. If the robot could not make it, `succeeded` is
    false and `reason` says why.

    Returns 409 while a task is running or paused, while the robot is stopped, while another
    client drives, and for a robot that cannot drive.

    To drive while a command is held, use the WebSocket `/v1/robot/teleop`. Send
    `{"forward": -1..1, "turn": -1..1}` at least every 0.3 s while the robot shall move. It
    stops within one short move after the last command, after `{}`, and after the connection
    ends. The gateway reports each change as `{"state", "reason", "kind", "pose"}`; states are
    `standing`, `driving`, `blocked` and `refused`. The kind of a refusal is `invalid` for a
    wrong command and `conflict` if the robot cannot be driven now.
    """
    driver = TeleopLease(robot, _who(request), state.settings.call_timeout_s)
    return await anyio.to_thread.run_sync(
        _one_move, robot, driver, asked, limiter=state.teleop_threads
    )


@router.websocket("/teleop")
async def socket(robot: AddressedRobot, state: State, socket: WebSocket) -> None:
    try:
        check(socket, Scope.ROBOT)
        slot = state.teleop_sockets.taken()
    except HeliosError as error:
        await socket.send_denial_response(problem_of(error))
        return
    settings = state.settings
    with slot:
        await socket.accept()
        driver = TeleopLease(robot, _who(socket), settings.call_timeout_s)
        session = TeleopSession(driver, settings, state.teleop_threads)
        end = await _driven(robot, socket, session, settings)
    if end is not None:
        with contextlib.suppress(TimeoutError, RuntimeError):
            async with asyncio.timeout(SEND_S):
                await socket.close(*end)


def _one_move(robot: RobotEndpoint, driver: TeleopLease, asked: DriveRequest) -> DriveResult:
    """Make one move under the driver's lease, then release the lease. Raises HeliosError."""
    check_move(asked, require_drivable(robot))
    driver.acquire()
    try:
        action = Forward(asked.forward_m) if asked.forward_m else Turn(asked.turn_rad)
        result = driver.move(action, keyframe=True)
    finally:
        with contextlib.suppress(HeliosError):
            driver.release()
    return DriveResult(
        succeeded=result.succeeded,
        reason=printable(result.reason),
        moved_m=finite(result.moved_m),
        turned_rad=finite(result.turned_rad),
        collided=result.collided,
        pose=pose_of(result.T_world_base.rows),
    )


async def _driven(
    robot: RobotEndpoint, socket: WebSocket, session: TeleopSession, settings: Settings
) -> tuple[int, str] | None:
    """Serve a driver until it disconnects, falls silent or loses its permission; the robot stops.

    Returns the code and the reason for closing the socket; None if the driver disconnected.
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
    """Pass on commands as they arrive. Returns the close code and reason, as `_driven` does."""
    while True:
        try:
            async with asyncio.timeout(settings.teleop_idle_s):
                message = await socket.receive()
        except TimeoutError:
            return GOING_AWAY, f"no command for {settings.teleop_idle_s:g} s; connect again"
        if message["type"] == "websocket.disconnect":
            return None
        try:
            check(socket, Scope.ROBOT)
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
    """Send each new state; skip those that a newer one has already replaced."""
    await session.permission_checked.wait()
    while True:
        changed = session.changed
        try:
            async with asyncio.timeout(SEND_S):
                await socket.send_text(session.state.model_dump_json())
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            return  # gone, or not reading: `_commands` decides when to end
        await changed.wait()


def _who(connection: HTTPConnection) -> str:
    """Name of the driver's key; empty if no key is required."""
    key = key_of(connection.scope, state_of(connection).keys)
    return key.name if key else ""
