"""RobotDriver of Spot: connects in `describe`, stands up at the first action.

A failed action is a result. Faults that a person must correct (lease, e-stop, motors, link) are
raised as typed errors. In both cases the robot stands still before `act` returns, or its command
expires within `command_s`.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from helios_core.bus import Bus
from helios_core.errors import Conflict, HeliosError
from helios_core.geometry import tilt_of
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    Forward,
    Pick,
    Place,
    RobotDriver,
    Tilt,
    Turn,
)
from helios_core.types import RobotDescription, RobotState

from helios_spot.arm_poses import TILT_RANGE_RAD, looking_pose
from helios_spot.frame_transforms import NOMINAL_BODY_HEIGHT_M
from helios_spot.grasping import SpotArm
from helios_spot.halt_conditions import Halt, Halted
from helios_spot.motion import CannotDo, Motion
from helios_spot.posed_images import SpotCameras
from helios_spot.robot_connection import RobotConnection
from helios_spot.robot_control import Control
from helios_spot.settings import SpotSettings
from helios_spot.waypoints import Waypoint, between, goal_of

log = logging.getLogger(__name__)

REMEMBERED = 256
PLANNER = "planner"
MANIPULATION = "manipulation"  # the service of a Spot with an arm


class SpotDriver(RobotDriver):
    """Driver of one Spot (see the module). `bus`: for planner liveliness and depth requests."""

    def __init__(
        self, bus: Bus | None = None, address: str = "", settings: SpotSettings | None = None
    ) -> None:
        """address: of the robot; overrides the settings. Raises InvalidInput for wrong settings."""
        self._s = settings or SpotSettings.read(address)
        self._halt = Halt()
        self._link = RobotConnection(self._s)
        self._cameras = SpotCameras(self._link, bus)
        self._motion = Motion(self._link, self._halt)
        self._control = Control(self._link, self._motion, self._halt)
        self._hand = SpotArm(self._link, self._cameras, self._motion, self._halt)
        self._connecting = threading.Lock()
        self._results: OrderedDict[str, ActionResult] = OrderedDict()
        self._steps = 0
        self._tilt_rad = self._s.tilt_rad
        self._hand_raised = False
        self._held_as = ""
        self._trouble = ""
        self._planners: set[str] = set()  # instances that are alive
        self._watch = bus.watch(self._on_liveliness) if bus else None

    # --- description and state ----------------------------------------------------------------
    def describe(self) -> RobotDescription:
        """The robot's description; connects first if necessary. Raises Unavailable while the robot
        is unreachable, InvalidInput for faults of the settings."""
        with self._connecting:
            if not self._link.connected:
                self._link.connect()
                try:
                    self._cameras.open()
                except BaseException:
                    self._link.close()
                    raise
        by_hand = self._s.camera == "hand"
        has_arm = MANIPULATION in self._link.services and self._cameras.has_hand
        fixed_rad = tilt_of(self._cameras.T_body_cam)
        return RobotDescription(
            name="Spot",
            footprint_radius_m=self._s.footprint_radius_m,
            footprint_box_m=(self._s.length_m, self._s.width_m),
            height_m=self._s.hand_height_m + 0.1 if by_hand else 0.8,
            camera=self._cameras.mount.camera,
            camera_height_m=self._s.hand_height_m
            if by_hand
            else NOMINAL_BODY_HEIGHT_M + float(self._cameras.T_body_cam[2, 3]),
            camera_forward_m=self._s.hand_forward_m
            if by_hand
            else float(self._cameras.T_body_cam[0, 3]),
            reach_m=self._s.reach_m,
            max_depth_m=self._s.max_depth_m,
            can_pick=has_arm and self._cameras.hand_is_pinhole,
            can_place=has_arm,
            tilt_range_rad=TILT_RANGE_RAD if by_hand else (fixed_rad, fixed_rad),
        )

    def state(self) -> RobotState:
        reading = self._link.read()
        stopped = self._halt.stopped
        return RobotState(
            T_world_base=reading.T_world_base,
            tilt_rad=self._tilt_rad
            if self._s.camera == "hand"
            else tilt_of(self._cameras.T_body_cam),
            held=(self._held_as or "thing") if reading.holding else "",
            stopped=bool(stopped),
            robot_boot_id=self._link.boot_id,
            message=stopped or self._trouble,
            battery=reading.battery,
        )

    def capture(self) -> Capture:
        return self._cameras.capture(self._link.read())

    # --- actions ------------------------------------------------------------------------------
    def act(self, action: Action, action_id: str) -> ActionResult:
        known = self._results.get(action_id)
        if known is not None:
            return known
        self._halt.begin()
        start: Waypoint | None = None
        try:
            self._take()
            start = self._here()  # from here on the robot may move
            self._get_ready()
            start = self._here()  # start of the action itself
            result = self._do(action, start)
            self._trouble = ""
        except CannotDo as why:
            result = ActionResult(False, str(why))
        except Halted as halted:
            result = ActionResult(False, halted.reason)
            self._motion.stop_if_heard()
            if halted.error is not None:
                self._fail(action_id, start, halted.error)
                raise halted.error from None
        except HeliosError as error:
            self._fail(action_id, start, error)
            raise
        finally:
            self._halt.end()
        return self._remember(action_id, start, result)

    def stop(self, reason: str) -> None:
        self._halt.stop(reason)
        if self._control.held:  # otherwise another client controls it, or it lies on the floor
            self._motion.stop()

    def clear_stop(self) -> None:
        """Clear the stop. Raises Conflict, which names the remaining cause; the stop then stays."""
        self._control.clear()
        self._trouble = ""

    def close(self) -> None:
        if self._watch is not None:
            self._watch.close()
        self._halt.stop("the driver has ended")
        if self._control.held:
            self._motion.stop_if_heard()
        self._control.release()
        self._link.close()

    # --- one action ---------------------------------------------------------------------------
    def _take(self) -> None:
        """Get permission to move. Raises HeliosError before any motion."""
        reading = self._link.read()
        if not reading.holding:
            self._held_as = ""
        self._control.take(reading)

    def _get_ready(self) -> None:
        """Stand up and raise the hand to look."""
        if self._control.stand():
            self._hand_raised = False
        if self._s.camera == "hand" and not self._hand_raised:
            self._raise_hand(self._tilt_rad)

    def _here(self) -> Waypoint:
        return Waypoint.of(self._link.read().T_world_base)

    def _do(self, action: Action, start: Waypoint) -> ActionResult:
        match action:
            case Forward(distance_m) if distance_m < 0:
                raise CannotDo("this robot does not walk back; turn, and walk ahead")
            case Forward() | Turn():
                self._motion.walk(start, goal_of(action, start))
            case Tilt(angle_rad) if self._s.camera == "hand":
                low, high = TILT_RANGE_RAD
                self._raise_hand(min(max(angle_rad, low), high))
            case Pick(point, class_name):
                self._pick(point, class_name)
            case Place(point):
                self._place(point)
            case _:
                pass  # Observe, and Tilt for the fixed body cameras
        return ActionResult(True)

    def _pick(self, point: tuple[float, float, float], class_name: str) -> None:
        with self._hand_back_after():
            self._hand.grasp(point, class_name)
            self._held_as = class_name

    def _place(self, point: tuple[float, float, float]) -> None:
        with self._hand_back_after():
            self._hand.place(point)
            self._held_as = ""

    @contextmanager
    def _hand_back_after(self) -> Iterator[None]:
        """Return the hand after a grasp or a place, unless it was halted: then nothing delays the
        stop that follows."""
        try:
            yield
        except Halted:
            self._hand_raised = False
            raise
        except BaseException:
            self._put_hand_back()
            raise
        self._put_hand_back()

    def _put_hand_back(self) -> None:
        """Return the hand after a grasp or a place. Only logs its failures, so that the caller
        reports those of the grasp or place."""
        try:
            if not self._link.read().holding:
                self._motion.grip(open=False)
            if self._s.camera == "hand":
                self._raise_hand(self._tilt_rad)
            elif not self._link.read().holding:
                self._motion.stow()
        except (CannotDo, HeliosError) as error:
            log.warning("the hand did not come back: %s", error)

    def _raise_hand(self, tilt_rad: float) -> None:
        above_m = self._s.hand_height_m - NOMINAL_BODY_HEIGHT_M
        self._hand_raised = False  # if the motion fails, the next action retries it
        self._motion.look_from(looking_pose(self._s.hand_forward_m, above_m, tilt_rad))
        self._tilt_rad, self._hand_raised = tilt_rad, True

    # --- results ------------------------------------------------------------------------------
    def _fail(self, action_id: str, start: Waypoint | None, error: HeliosError) -> None:
        """Handle an action's error; if it had begun, stop it and store its result, so that the same
        id does not start it again."""
        self._trouble = error.message
        if start is not None:
            if isinstance(error, Conflict):
                self._control.lost(error)
            heard = self._motion.stop_if_heard()
            self._remember(action_id, start, ActionResult(False, error.message), measure=heard)

    def _remember(
        self, action_id: str, start: Waypoint | None, result: ActionResult, measure: bool = True
    ) -> ActionResult:
        self._steps += 1
        moved_m = turned_rad = 0.0
        if start is not None and measure:
            try:
                moved_m, turned_rad = between(start, self._here())
            except HeliosError as error:
                log.warning("how far it came is not known: %s", error.message)
        result = replace(result, moved_m=moved_m, turned_rad=turned_rad, steps=self._steps)
        self._results[action_id] = result
        while len(self._results) > REMEMBERED:
            self._results.popitem(last=False)
        return result

    def _on_liveliness(self, service: str, instance: str, alive: bool) -> None:
        if service != PLANNER:
            return
        if alive:
            self._planners.add(instance)
            return
        gone = self._planners == {instance}
        self._planners.discard(instance)
        if gone and self._halt.cut("the planner went away; the robot stands and waits for it"):
            log.warning("the planner went away in the middle of an action")
