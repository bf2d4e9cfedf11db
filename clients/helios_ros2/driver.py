"""RobotDriver of any ROS 2 robot: `helios up --robot ros2`.

A failed action is a result. A silent robot raises Unavailable, which names topic, type, quality of
service and last stamp. All times are of the robot's own clock.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable

from helios_core.errors import HeliosError, Internal, Unavailable
from helios_core.geometry import invert, tilt_of, wrap_angle, yaw_of
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    Forward,
    Observe,
    Pick,
    Place,
    RobotDriver,
    Show,
    Tilt,
    Turn,
)
from helios_core.robot_checks.watching import watched
from helios_core.types import RobotDescription, RobotState
from helios_replay.ros_images import Lens

from helios_ros2.camera_tilt import CameraTilt
from helios_ros2.captures import capture_of
from helios_ros2.earlier_goals import end_earlier
from helios_ros2.manipulation import Manipulation
from helios_ros2.nav2_motion import Nav2Motion
from helios_ros2.robot_input import BasePose, RobotInput
from helios_ros2.ros_node import RosNode
from helios_ros2.settings import Ros2Settings
from helios_ros2.stop_latch import NotDone, StopLatch
from helios_ros2.velocity_motion import VelocityMotion
from helios_ros2.zenoh_node import ZenohNode

log = logging.getLogger(__name__)

REMEMBERED = 256
CONNECT_WITHIN_S = 3.0
REST_WITHIN_S = 3.0
CANCEL_WITHIN_S = 0.5  # wait for cancelled goals at the end; the bridge allows 1.2 s for all
EARLIER_WITHIN_S = 2.0  # wait for the end of the goals of an earlier bridge
NODE = "helios_bridge"


class Ros2Driver(RobotDriver):
    """Driver of one ROS 2 robot (see the module)."""

    def __init__(self, settings: Ros2Settings | None = None) -> None:
        """Raises InvalidInput for wrong settings, and without rclpy."""
        self._s = settings or Ros2Settings.read()
        self._ros: RosNode | ZenohNode = (
            RosNode(NODE) if self._s.transport == "rclpy" else ZenohNode(NODE, self._s.zenoh_router)
        )
        self._latch = StopLatch()
        self._senses = RobotInput(self._ros, self._s)
        self._velocity = VelocityMotion(self._ros, self._s, self._senses, self._latch)
        by_rclpy = self._ros if isinstance(self._ros, RosNode) else None
        self._nav2 = Nav2Motion.of(by_rclpy, self._s, self._latch)
        self._tilt = CameraTilt(self._ros, self._s, self._senses, self._latch)
        self._manipulation = Manipulation(by_rclpy, self._s, self._senses, self._latch)
        self._results: OrderedDict[str, ActionResult] = OrderedDict()
        self._steps = 0
        self._moves_by = ""
        self._rested_after = 0  # actions after the end of whose earlier goals the base came to rest
        self._connecting = threading.Lock()
        self._lens: Lens | None = None
        self._description: RobotDescription | None = None
        self._ros.start()

    # --- description and state ----------------------------------------------------------------
    def describe(self) -> RobotDescription:
        """The robot's description; waits for its camera and poses, and for a while until the goals
        of an earlier bridge have ended and the base rests. Raises Unavailable."""
        with self._connecting:
            if self._description is None:
                lens = self._senses.connect(CONNECT_WITHIN_S)
                try:
                    self._end_earlier_goals(time.sleep)
                except NotDone as error:  # each motion waits for it again
                    log.warning("the robot may move: %s", error)
                self._description = self._describe(lens)
                self._lens = lens
            return self._description

    def _describe(self, lens: Lens) -> RobotDescription:
        s, here = self._s, self._senses.here()
        base, T_world_cam = self._senses.poses_at(here.stamp_ns)
        T_base_cam = invert(base) @ T_world_cam
        tilt_rad = tilt_of(T_base_cam)
        return RobotDescription(
            name=s.name,
            footprint_radius_m=s.footprint_radius_m,
            height_m=s.height_m,
            camera=lens.camera,
            camera_height_m=float(T_base_cam[2, 3]),
            camera_forward_m=float(T_base_cam[0, 3]),
            reach_m=s.reach_m,
            max_depth_m=s.max_depth_m,
            max_back_m=s.max_back_m,
            tilt_range_rad=self._tilt.range_rad or (tilt_rad, tilt_rad),
            can_move=s.motion != "none",
            can_pick=self._manipulation.can_pick,
            can_place=self._manipulation.can_place,
            show_base_m=s.show_base_m if self._manipulation.can_show else None,
            world_frame=self._senses.world_frame,
        )

    def state(self) -> RobotState:
        here = self._senses.here()
        _, T_world_cam = self._senses.poses_at(here.stamp_ns)
        return RobotState(
            here.T_world_base,
            tilt_of(T_world_cam),
            held=self._manipulation.held,
            stopped=bool(self._latch.reason),
            world_epoch=self._senses.world_epoch,
            message=self._latch.reason,
            origin_id=self._s.origin,
            battery=self._senses.battery,
        )

    def capture(self) -> Capture:
        """Newest image, later than the one before and than the robot's rest after a motion."""
        lens = self._lens
        if lens is None:
            raise Unavailable("the robot is not connected yet; ask for its description first")
        return capture_of(self._senses.image(self._s.image_wait_s), self._senses, lens)

    # --- actions ------------------------------------------------------------------------------
    def act(self, action: Action, action_id: str) -> ActionResult:
        known = self._results.get(action_id)
        if known is not None:
            return known
        start = self._senses.here()
        try:
            why = self._reason_not_done(action)
            if not isinstance(action, Observe):
                self._come_to_rest()
        except HeliosError as error:  # the same id does not start it again
            self._remember(action_id, start, error.message)
            raise
        return self._remember(action_id, start, why)

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        return watched(lambda: self.act(action, action_id), self.capture, hz)

    def stop(self, reason: str) -> None:
        """End every kind of motion, also after another could not be ended. Then raises what came;
        for several errors Internal with all their texts."""
        self._latch.stop(reason)
        failed = _all_called(self._halts())
        if len(failed) > 1:
            texts = "; ".join(f"{type(error).__name__}: {error}" for error in failed)
            raise Internal(f"{len(failed)} kinds of motion could not be ended: {texts}") from (
                failed[0]
            )
        if failed:
            raise failed[0]

    def clear_stop(self) -> None:
        self._latch.clear()

    def close(self) -> None:
        """End the running motion and the node. A ROS that does not answer delays it by at most
        `CANCEL_WITHIN_S`."""
        self._latch.stop("the driver has ended")
        until_s = time.monotonic() + CANCEL_WITHIN_S
        for error in _all_called(self._halts(until_s)):
            log.warning("a motion could not be ended before the driver: %s", error)
        self._ros.close()

    def _halts(self, until_s: float = 0.0) -> list[Callable[[], None]]:
        """Calls that end each motion that may run, and wait for the answer until a monotonic
        time."""
        behaviours = [] if self._nav2 is None else self._nav2.cancels(until_s)
        return [self._velocity.halt, *self._manipulation.cancels(until_s), *behaviours]

    # --- one action ---------------------------------------------------------------------------
    def _reason_not_done(self, action: Action) -> str:
        """Do an action. Returns why the robot did not do it, "" if it did."""
        try:
            self._latch.begin()
            if not isinstance(action, Observe):
                self._end_earlier_goals(self._latch.rest)
            self._do(action)
        except NotDone as error:
            return str(error)
        return ""

    def _end_earlier_goals(self, rest: Callable[[float], object]) -> None:
        """Wait until no goal of an earlier bridge runs, and after that for the base's rest.

        rest: waits the given seconds. Raises NotDone, Unavailable.
        """
        goals = self._manipulation.earlier_goals()
        if self._nav2 is not None:
            goals += self._nav2.earlier_goals()
        end_earlier(goals, EARLIER_WITHIN_S, rest)
        ended = sum(each.ended for each in goals)
        if ended > self._rested_after:
            self._come_to_rest()
            self._rested_after = ended

    def _do(self, action: Action) -> None:
        if isinstance(action, Forward | Turn):
            self._manipulation.draw_in()
        match action:
            case Forward() | Turn() if self._s.motion == "none":
                raise NotDone("this robot does not move; HELIOS_ROS2_MOTION says so")
            case Forward(distance_m) if distance_m < -self._s.max_back_m:
                raise NotDone("it never drives back so far; turn, and drive ahead")
            case Forward(distance_m):
                self._motion().forward(distance_m)
            case Turn(angle_rad):
                self._motion().turn(angle_rad)
            case Tilt(angle_rad):
                self._tilt.move(angle_rad)
            case Pick(point, name):
                self._manipulation.pick(point, name)
            case Place(point):
                self._manipulation.place(point)
            case Show(angle_rad):
                self._manipulation.show(angle_rad)
            case Observe():
                pass

    def _motion(self) -> VelocityMotion | Nav2Motion:
        by_nav2 = self._nav2
        if by_nav2 is not None and self._s.motion == "auto" and not by_nav2.is_there():
            by_nav2 = None
        name = "velocities" if by_nav2 is None else "Nav2's behaviours"
        if name != self._moves_by:
            log.info("the base moves by %s", name)
            self._moves_by = name
        return by_nav2 or self._velocity

    def _come_to_rest(self) -> None:
        """Wait until the base rests by its own poses; the next image is later than that."""
        end_s = time.monotonic() + REST_WITHIN_S
        while not self._senses.rests():
            here = self._senses.here()
            if time.monotonic() > end_s:
                log.warning("the base does not come to rest after the motion")
                break
            self._senses.wait_newer(here.stamp_ns, 0.1)
        self._senses.after_ns = max(self._senses.after_ns, self._senses.here().stamp_ns)

    def _remember(self, action_id: str, start: BasePose, why: str) -> ActionResult:
        self._steps += 1
        moved_m = turned_rad = 0.0
        try:
            now = self._senses.here()
            if now.world_epoch == start.world_epoch:
                moved_m = math.hypot(*(now.T_world_base - start.T_world_base)[:2, 3])
                turned_rad = wrap_angle(yaw_of(now.T_world_base) - yaw_of(start.T_world_base))
            else:
                log.warning("how far it came is not known: the robot's poses jumped meanwhile")
        except HeliosError as error:
            log.warning("how far it came is not known: %s", error.message)
        result = ActionResult(not why, why, moved_m, turned_rad, steps=self._steps)
        self._results[action_id] = result
        while len(self._results) > REMEMBERED:
            self._results.popitem(last=False)
        return result


def _all_called(calls: Iterable[Callable[[], None]]) -> list[Exception]:
    """Make each call, also after another has raised. Returns what they raised, in their order."""
    raised: list[Exception] = []
    for call in calls:
        try:
            call()
        except Exception as error:
            raised.append(error)
    return raised
