"""Teleoperation session of one driver: receives commands, sends short moves, reports states.

Commands and moves run concurrently on the event loop; every wait for the robot is in a thread.
The robot moves only under a command that has not expired.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import anyio
import anyio.to_thread
from anyio import CapacityLimiter
from helios_core import proto as pb
from helios_core.errors import HeliosError
from helios_core.printable_text import printable

from helios_gateway.api_models import RobotDescription, RobotPose
from helios_gateway.error_responses import kind_of
from helios_gateway.message_conversion import pose_of
from helios_gateway.settings import Settings
from helios_gateway.teleop.driver import TeleopLease
from helios_gateway.teleop.messages import StateName, TeleopState
from helios_gateway.teleop.pacing import Command, DueMove, LatestCommand, MoveLimits, Pacer

POLL_S = 0.02
SETTLE_S = 0.4  # standing time before a last keyframe and the release of the lease
FAREWELL_S = 30.0  # time limit of the last keyframe and the release

T = TypeVar("T")


class TeleopSession:
    """Session of one driver.

    The socket calls `command`, `run` executes concurrently, and `changed` signals a new `state`.
    """

    def __init__(
        self,
        driver: TeleopLease,
        settings: Settings,
        threads: CapacityLimiter,
    ) -> None:
        """threads: limiter of the threads in which moves wait."""
        self._driver, self._settings, self._threads = driver, settings, threads
        self._latest = LatestCommand(settings.teleop_hold_s)
        self._pacer: Pacer | None = None
        self._refused = ""  # reason; cleared when the command is released
        self._moved_s = -1e9  # end of the last move, monotonic
        self._state = TeleopState(state="standing")
        self.changed = anyio.Event()
        # Set once `state` includes the first permission check.
        self.permission_checked = anyio.Event()

    @property
    def state(self) -> TeleopState:
        return self._state

    def command(self, command: Command) -> None:
        """Set the command that the driver holds now."""
        self._latest.take(command, time.monotonic())

    def refuse(self, error: HeliosError) -> None:
        """Stop the robot and report the error as the state `refused`."""
        self._latest.take(Command(), time.monotonic())
        self._tell_refusal(error)

    async def run(self, may_drive: Callable[[], RobotDescription]) -> None:
        """Run until cancelled, then take a last keyframe and release the lease.

        may_drive: raises HeliosError if driving is impossible.
        """
        try:
            await self._in_thread(may_drive)
        except HeliosError as error:
            self._tell_refusal(error)
        self.permission_checked.set()
        try:
            while True:
                await self._step()
        finally:
            with anyio.move_on_after(FAREWELL_S, shield=True):
                await self._leave()

    async def _step(self) -> None:
        """Make one move, or wait a moment."""
        now_s = time.monotonic()
        command = self._latest.now(now_s)
        if command.is_zero:
            await self._stand(now_s)
            return
        if self._refused:
            await anyio.sleep(POLL_S)
            return
        try:
            if not self._driver.holds or self._pacer is None:
                self._pacer = self._pacer_of(await self._in_thread(self._driver.acquire))
                return  # the command may have expired meanwhile
            due = self._pacer.due(command, now_s)
            if due is None:
                if self._pacer.stuck(command):
                    self._tell("blocked", self._pacer.blocked)
                await anyio.sleep(POLL_S)
                return
            self._tell("driving", self._pacer.blocked)
            result = await self._in_thread(lambda: self._move(due))
        except HeliosError as error:
            await self._give_up(error)
            return
        if result is None:
            return
        self._moved_s = time.monotonic()
        self._after(due, result, self._pacer)

    def _move(self, due: DueMove) -> pb.ActionResult | None:
        """Result of a move; None if the command was released before a thread was free."""
        share = self._latest.now(time.monotonic()).of(due.axis)
        if share == 0 or (share > 0) is not due.ahead:
            return None
        return self._driver.move(due.action)

    def _after(self, due: DueMove, result: pb.ActionResult, pacer: Pacer) -> None:
        pose = pose_of(result.T_world_base.rows)
        if not result.succeeded:
            pacer.failed(due, printable(result.reason) or "the robot did not say why")
        self._tell("driving", pacer.blocked, pose)

    async def _stand(self, now_s: float) -> None:
        if self._refused or self._state.state in ("driving", "blocked"):
            self._refused = ""
            self._tell("standing", pose=self._state.pose)
        if self._pacer is not None:
            self._pacer.due(Command(), now_s)  # clears the failed moves
        if self._driver.holds and now_s - self._moved_s >= SETTLE_S:
            await self._leave()
        await anyio.sleep(POLL_S)

    async def _give_up(self, error: HeliosError) -> None:
        self._refused = error.message
        self._tell_refusal(error)
        await self._leave()

    async def _leave(self) -> None:
        """Take a last keyframe and release the lease; ignore errors."""
        for last in (self._driver.take_keyframe, self._driver.release):
            try:
                await self._in_thread(last)
            except HeliosError:
                continue

    def _pacer_of(self, robot: RobotDescription) -> Pacer:
        s = self._settings
        return self._pacer or Pacer(MoveLimits.of(robot, s.teleop_speed_m_s, s.teleop_turn_rad_s))

    def _tell(self, state: StateName, reason: str = "", pose: RobotPose | None = None) -> None:
        self._tell_state(TeleopState(state=state, reason=reason, pose=pose or self._state.pose))

    def _tell_refusal(self, error: HeliosError) -> None:
        self._tell_state(
            TeleopState(
                state="refused", reason=error.message, kind=kind_of(error), pose=self._state.pose
            )
        )

    def _tell_state(self, state: TeleopState) -> None:
        if state != self._state:
            self._state = state
            changed, self.changed = self.changed, anyio.Event()
            changed.set()

    async def _in_thread(self, call: Callable[[], T]) -> T:
        return await anyio.to_thread.run_sync(call, limiter=self._threads)
