"""Pacing of teleoperation: selects the short move that is due at the commanded speed.

The robot accepts single moves: ahead or a turn. A sequence of short moves drives it smoothly
enough, and it stops after at most one of them. No I/O; the caller passes the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from helios_core.robot import Forward, Turn

from helios_gateway.api_models import RobotDescription

STEP_M = 0.1
STEP_RAD = math.radians(5)

Axis = Literal["forward", "turn"]
AXES: tuple[Axis, ...] = ("forward", "turn")


@dataclass(frozen=True)
class Command:
    """Drive command: shares of the speed limits, -1 to 1; a positive turn goes left."""

    forward: float = 0.0
    turn: float = 0.0

    @property
    def is_zero(self) -> bool:
        return self.forward == 0.0 and self.turn == 0.0

    def of(self, axis: Axis) -> float:
        return self.forward if axis == "forward" else self.turn


STAND = Command()


class LatestCommand:
    """Newest command. It expires `hold_s` after its arrival; then the robot stands."""

    def __init__(self, hold_s: float) -> None:
        self._hold_s = hold_s
        self._command, self._came_s = STAND, -math.inf

    def take(self, command: Command, now_s: float) -> None:
        self._command, self._came_s = command, now_s

    def now(self, now_s: float) -> Command:
        return self._command if now_s - self._came_s <= self._hold_s else STAND


@dataclass(frozen=True)
class MoveLimits:
    """Lengths of a robot's short moves, and its speed limits."""

    step_m: float
    back_m: float  # 0: the robot cannot drive back
    step_rad: float
    speed_m_s: float
    turn_rad_s: float

    @classmethod
    def of(cls, robot: RobotDescription, speed_m_s: float, turn_rad_s: float) -> MoveLimits:
        """Moves of about 0.1 m and 5°, within the robot's own limits."""
        low_m, low_rad = robot.min_forward_m or 0.0, robot.min_turn_rad or 0.0
        step_m = max(STEP_M, low_m)
        return cls(
            min(step_m, robot.max_forward_m or 0.0),
            min(step_m, robot.max_back_m or 0.0),
            min(max(STEP_RAD, low_rad), robot.max_turn_rad or 0.0),
            speed_m_s,
            turn_rad_s,
        )

    def step(self, axis: Axis, ahead: bool) -> float:
        """Length of one move in m or rad; 0 if the robot cannot make it."""
        if axis == "turn":
            return self.step_rad
        return self.step_m if ahead else self.back_m

    def why_not(self, axis: Axis, ahead: bool) -> str:
        """Reason why the robot cannot make this move; empty if it can."""
        if self.step(axis, ahead) > 0:
            return ""
        if axis == "turn":
            return "this robot cannot turn on the spot"
        back = "this robot cannot drive back (max_back_m is 0); turn round instead"
        return "this robot cannot drive ahead" if ahead else back

    def action(self, axis: Axis, ahead: bool) -> Forward | Turn:
        amount = math.copysign(self.step(axis, ahead), 1 if ahead else -1)
        return Forward(amount) if axis == "forward" else Turn(amount)

    def per_s(self, axis: Axis, ahead: bool) -> float:
        """Moves per second at the speed limit."""
        speed = self.speed_m_s if axis == "forward" else self.turn_rad_s
        return speed / self.step(axis, ahead)


@dataclass(frozen=True)
class DueMove:
    """Move to make now."""

    axis: Axis
    ahead: bool  # for a turn: to the left
    action: Forward | Turn


class Pacer:
    """Scheduler of short moves for the held command.

    Saves up at most one move per axis, so that quick key presses cannot exceed the speed limit.
    Does not retry a failed move before its command is released.
    """

    def __init__(self, moves: MoveLimits) -> None:
        self._moves = moves
        self._credits: dict[Axis, float] = dict.fromkeys(AXES, 1.0)  # moves that may start now
        self._at_s: float | None = None
        self._failed: dict[tuple[Axis, bool], str] = {}

    def due(self, command: Command, now_s: float) -> DueMove | None:
        """Move to make now; None if no move is due or possible."""
        self._save(command, now_s)
        ready = []
        for axis in AXES:
            share = command.of(axis)
            for ahead in (True, False):
                if share == 0 or (share > 0) is not ahead:
                    self._failed.pop((axis, ahead), None)
            if share == 0:
                continue
            ahead = share > 0
            if why_not := self._moves.why_not(axis, ahead):
                self._failed[axis, ahead] = why_not
            if (axis, ahead) not in self._failed and self._credits[axis] >= 1.0:
                ready.append((self._credits[axis], axis, ahead))
        if not ready:
            return None
        _, axis, ahead = max(ready, key=lambda r: r[0])
        self._credits[axis] -= 1.0
        return DueMove(axis, ahead, self._moves.action(axis, ahead))

    def failed(self, due: DueMove, reason: str) -> None:
        """Record that the robot did not make this move."""
        self._failed[due.axis, due.ahead] = reason

    def stuck(self, command: Command) -> bool:
        """True if a command is held and all of its moves have failed."""
        held = [(axis, command.of(axis) > 0) for axis in AXES if command.of(axis)]
        return bool(held) and all(kind in self._failed for kind in held)

    @property
    def blocked(self) -> str:
        """Reason why a part of the command does not move the robot; empty if nothing failed."""
        return next(iter(self._failed.values()), "")

    def _save(self, command: Command, now_s: float) -> None:
        passed_s = 0.0 if self._at_s is None else max(0.0, now_s - self._at_s)
        self._at_s = now_s
        for axis in AXES:
            share = command.of(axis)
            ahead = share >= 0
            if self._moves.step(axis, ahead) <= 0:
                continue
            rate = self._moves.per_s(axis, ahead) * (abs(share) or 1.0)
            # After a slow move at most one further move is due at once.
            self._credits[axis] = min(self._credits[axis] + rate * passed_s, 1.0)
