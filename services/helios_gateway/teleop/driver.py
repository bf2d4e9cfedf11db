"""Robot under teleoperation: the lease, and single moves under it."""

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
from helios_gateway.robot_registry import RobotEndpoint

HAND_OVER_S = 1.5  # for the previous driver's last keyframe and release
MOVE_S = 20.0  # time limit of one move; the bridge stops the robot after it
KEYFRAME_M, KEYFRAME_RAD = 0.5, math.radians(30)  # longest drive and turn between two keyframes


def require_drivable(at: RobotEndpoint) -> RobotDescription:
    """Description of the robot.

    Raises Unavailable before the bridge has sent one, and Conflict for a robot that cannot drive.
    """
    robot = at.monitor.robot().description
    if robot is None:
        raise Unavailable("the bridge has not described the robot yet; see /v1/status")
    if not robot.can_move:
        raise Conflict(f"the robot {robot.name!r} offers no motion; it cannot be driven by hand")
    return robot


def check_may_drive(at: RobotEndpoint, timeout_s: float) -> RobotDescription:
    """Description of the robot, if a person may drive it now.

    Raises the errors of `require_drivable`, and Conflict if the robot is stopped or a task holds
    it.
    """
    robot = require_drivable(at)
    if at.monitor.stopped:
        why = at.monitor.stop_reason
        raise Conflict(f"the robot is stopped ({why}); clear the stop first")
    for task in at.bus.call(LIST_TASKS, pb.Empty(), timeout_s).tasks:
        if task.state in HOLDS_ROBOT:
            raise Conflict(
                f"task {task.id} is {task.state} and has the robot; cancel it or wait for its end, "
                "then drive by hand"
            )
    return robot


class TeleopLease:
    """Lease of one driver on the robot, and moves under it.

    For one thread at a time. Every call waits for the robot and raises HeliosError.
    """

    def __init__(self, at: RobotEndpoint, who: str, timeout_s: float) -> None:
        """who: driver's name, shown to others who request the lease. timeout_s: of one bus call."""
        self._at, self._timeout_s = at, timeout_s
        own = uuid.uuid4().hex
        self._holder = f"teleop {own[:4]}" + (f" ({who})" if who else "")
        self._prefix, self._number = f"teleop-{own}", 0
        self._token = 0
        self._since_m = self._since_rad = 0.0  # driven since the last keyframe

    @property
    def holds(self) -> bool:
        """True from `acquire` to `release`; the lease may have expired meanwhile."""
        return self._token != 0

    def acquire(self) -> RobotDescription:
        """Acquire the lease; retry for `HAND_OVER_S` while another client holds it.

        Checks again under the lease: a task that started before keeps the robot, and a later task
        waits for the lease. Raises the errors of `check_may_drive`, and Conflict if another client
        drives.
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
            with contextlib.suppress(HeliosError):  # the lease expires anyway
                self.release()
            raise

    def move(self, action: Action, keyframe: bool = False) -> pb.ActionResult:
        """Make one move, with a keyframe if requested or if the newest one is too far away."""
        ahead_m = abs(action.distance_m) if isinstance(action, Forward) else 0.0
        turn_rad = abs(action.angle_rad) if isinstance(action, Turn) else 0.0
        keyframe = (
            keyframe
            or self._since_m + ahead_m > KEYFRAME_M
            or self._since_rad + turn_rad > KEYFRAME_RAD
        )
        self._number += 1
        request = pb.ActionRequest(
            action_id=f"{self._prefix}-{self._number}",
            lease_token=self._token,
            time_remaining_s=MOVE_S,
            action=action_to_proto(action),
            no_keyframe=not keyframe,
        )
        try:
            result = self._at.bus.call(ACT, request, MOVE_S + self._timeout_s)
        except HeliosError:
            self._since_m = self._since_rad = math.inf  # the outcome is unknown
            raise
        if keyframe:
            self._since_m = self._since_rad = 0.0
        else:
            self._since_m += abs(result.moved_m)
            self._since_rad += abs(result.turned_rad)
        return result

    def take_keyframe(self) -> None:
        """Take a keyframe at the current pose if the robot moved since the last one."""
        if self._since_m or self._since_rad:
            self.move(Observe(), keyframe=True)

    def release(self) -> None:
        """Release the lease, so that a waiting client gets it at once."""
        token, self._token = self._token, 0
        if token:
            self._at.bus.call(LEASE, pb.LeaseRequest(release_token=token), self._timeout_s)
