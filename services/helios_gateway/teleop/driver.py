"""The robot as somebody drives it by hand: the lease, and single moves under it."""

from __future__ import annotations

import contextlib
import math
import time
import uuid

from helios_core import proto as pb
from helios_core.codec import action_to_proto
from helios_core.errors import Conflict, HeliosError, Unavailable
from helios_core.robot import Action, Forward, Observe, Turn
from helios_core.task_states import HOLDS_ROBOT
from helios_core.topics import ACT, LEASE, LIST_TASKS

from helios_gateway.api_models import RobotDescription
from helios_gateway.robot_registry import Served

HAND_OVER_S = 1.5  # that who drove before has for a last image and giving the robot back
MOVE_S = 20.0  # longest time of one move; the bridge stops the robot after it
KEYFRAME_M, KEYFRAME_RAD = 0.5, math.radians(30)  # driven at most between two keyframes


def described(at: Served) -> RobotDescription:
    """What the robot is. Raises Conflict where it offers no motion, and Unavailable where that is
    not known."""
    robot = at.live.robot().description
    if robot is None:
        raise Unavailable("the bridge has not described the robot yet; see /v1/status")
    if not robot.can_move:
        raise Conflict(f"the robot {robot.name!r} offers no motion; it cannot be driven by hand")
    return robot


def check_may_drive(at: Served, timeout_s: float) -> RobotDescription:
    """What the robot is, where somebody may drive it by hand now.

    Raises what `described` raises, and Conflict where the robot is stopped, or a task has it.
    """
    robot = described(at)
    if at.live.stopped:
        why = at.live.stop_reason
        raise Conflict(f"the robot is stopped ({why}); clear the stop first")
    for task in at.bus.call(LIST_TASKS, pb.Empty(), timeout_s).tasks:
        if task.state in HOLDS_ROBOT:
            raise Conflict(
                f"task {task.id} is {task.state} and has the robot; cancel it or wait for its end, "
                "then drive by hand"
            )
    return robot


class TeleopDriver:
    """One driver's hold on the robot. Used by one thread at a time; every call waits for the
    robot and raises HeliosError."""

    def __init__(self, at: Served, who: str, timeout_s: float) -> None:
        """who: told to others who want the robot meanwhile. timeout_s: of one answer."""
        self._at, self._timeout_s = at, timeout_s
        own = uuid.uuid4().hex
        self._holder = f"teleop {own[:4]}" + (f" ({who})" if who else "")
        self._prefix, self._number = f"teleop-{own}", 0
        self._token = 0
        self._since_m = self._since_rad = 0.0  # driven since the last keyframe

    @property
    def holds(self) -> bool:
        """It has the lease, or had it a moment ago."""
        return self._token != 0

    def acquire(self) -> RobotDescription:
        """Get the lease. Raises what `check_may_drive` raises, and Conflict where somebody else
        drives.

        It is checked again under the lease: a task that began before has the robot, and one that
        begins afterwards waits for the lease.
        """
        check_may_drive(self._at, self._timeout_s)
        request = pb.LeaseRequest(holder=self._holder)
        deadline_s = time.monotonic() + HAND_OVER_S
        while True:
            try:
                self._token = self._at.bus.call(LEASE, request, self._timeout_s).token
                break
            except Conflict:
                if time.monotonic() > deadline_s:
                    raise
            time.sleep(HAND_OVER_S / 20)
        try:
            return check_may_drive(self._at, self._timeout_s)
        except HeliosError:
            with contextlib.suppress(HeliosError):  # it runs out by itself
                self.release()
            raise

    def move(self, action: Action, keyframe: bool = False) -> pb.ActionResult:
        """One move; without a keyframe while the newest one is near enough."""
        ahead_m = abs(action.distance_m) if isinstance(action, Forward) else 0.0
        turn_rad = abs(action.angle_rad) if isinstance(action, Turn) else 0.0
        keyframe = (
            keyframe
            or self._since_m + ahead_m > KEYFRAME_M
            or self._since_rad + turn_rad > KEYFRAME_RAD
        )
        self._number += 1
        request = pb.ActionRequest(
            action_id=f"{self._prefix}-{self._number}", lease_token=self._token,
            time_remaining_s=MOVE_S, action=action_to_proto(action), no_keyframe=not keyframe,
        )  # fmt: skip
        try:
            result = self._at.bus.call(ACT, request, MOVE_S + self._timeout_s)
        except HeliosError:
            self._since_m = self._since_rad = math.inf  # what it did is not known
            raise
        if keyframe:
            self._since_m = self._since_rad = 0.0
        else:
            self._since_m += abs(result.moved_m)
            self._since_rad += abs(result.turned_rad)
        return result

    def look(self) -> None:
        """A keyframe from where the robot stands, if it moved since the last one."""
        if self._since_m or self._since_rad:
            self.move(Observe(), keyframe=True)

    def release(self) -> None:
        """The lease; whoever waits for the robot has it at once."""
        token, self._token = self._token, 0
        if token:
            self._at.bus.call(LEASE, pb.LeaseRequest(release_token=token), self._timeout_s)
