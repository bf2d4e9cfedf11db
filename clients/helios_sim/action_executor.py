"""Execution of robot actions in the physics, with their true outcome.

Points of actions are in the frame of the robot's pose estimate; `RobotSensors` converts them to
the true world frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from helios_core.geometry import wrap_angle
from helios_core.robot import (
    Action,
    ActionResult,
    Forward,
    Observe,
    Pick,
    Place,
    Show,
    Tilt,
    Turn,
)

from helios_sim.base_motion import Base, Drive
from helios_sim.drive_trace import DriveTrace
from helios_sim.episode_tracker import EpisodeTracker
from helios_sim.gripper import Graspable, Gripper
from helios_sim.home import Home
from helios_sim.manipulation import Manipulation, ManipulationFailed, PickRule
from helios_sim.mujoco_library import mujoco
from helios_sim.ovmm_metrics import ReleaseResult
from helios_sim.robot_model import RobotIndex
from helios_sim.robot_physics import RobotPhysics
from helios_sim.robot_sensors import RobotSensors

_PAUSE_S = 0.1

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Outcome:
    """Result of an action, with the ground truth that the robot does not receive."""

    result: ActionResult
    touched: frozenset[str] = frozenset()  # bodies touched, without movable objects
    released: ReleaseResult | None = None


class ActionExecutor:
    """Executes actions with the robot's base, head and gripper.

    `support_of` maps each movable object to the body that it was put on.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotIndex,
        home: Home,
        senses: RobotSensors,
        tracker: EpisodeTracker,
        pick_rule: PickRule = "physical",
        trace: DriveTrace | None = None,
    ) -> None:
        """tracker: records picks and places. pick_rule: see `manipulation`."""
        self._model, self._data, self._robot = model, data, robot
        self._senses, self._tracker = senses, tracker
        things = [Graspable.of(model, thing.name, thing.size_m) for thing in home.objects]
        movable = frozenset(thing.body for thing in things)
        self._names = [model.body(body).name for body in range(model.nbody)]
        self._receptacles = frozenset(item.name for item in home.receptacles)
        self._gripper = Gripper(model, data, robot, movable)
        gripper = self._gripper
        self._physics = RobotPhysics(model, data, robot, gripper.step, lambda: gripper.held_body)
        self._base = Base(model, data, robot, movable, self._physics, trace or DriveTrace())
        classes = {thing.name: thing.class_name for thing in home.objects}
        self._manipulation = Manipulation(
            data, self._gripper, things, senses.bodies_in_view, classes, pick_rule
        )
        self.support_of = {thing.name: thing.receptacle for thing in home.objects}
        self.held_class_requested = ""  # requested class of the held object

    @property
    def shown(self) -> tuple[str, float] | None:
        """Name of the object that is shown to the camera, and its turn in rad; None: none is."""
        held, turn_rad = self._gripper.held, self._gripper.shown_turn_rad
        return None if held is None or turn_rad is None else (held.name, turn_rad)

    @property
    def held_name(self) -> str:
        """Name of the held body; empty if the gripper is empty."""
        return self._gripper.held.name if self._gripper.held else ""

    def touching(self) -> frozenset[str]:
        """Bodies in contact with the robot now, without movable objects."""
        return self._named(self._base.touching())

    def execute(self, action: Action, stop_asked: Callable[[], str | None]) -> Outcome:
        """Execute one action. stop_asked: returns the reason to end a drive at once, or None."""
        if not isinstance(action, Show | Tilt | Observe):
            self._gripper.end_showing()
        match action:
            case Forward(distance_m):
                return self._driven(self._base.forward(distance_m, _asked(stop_asked)), stop_asked)
            case Turn(angle_rad):
                return self._driven(self._base.turn(angle_rad, _asked(stop_asked)), stop_asked)
            case Tilt(angle_rad):
                self._data.qpos[self._robot.tilt_qpos] = angle_rad
                self._data.qvel[self._robot.tilt_dof] = 0.0
                self._pause()
                return Outcome(ActionResult(True))
            case Pick(point, class_name):
                return self._pick(point, class_name)
            case Place(point):
                return self._place(point)
            case Observe():
                self._pause()
                return Outcome(ActionResult(True))
            case Show(angle_rad):
                return self._show(angle_rad)

    def watch_drives(self, watch: Callable[[], None] | None) -> None:
        """Call `watch` after each physics step of the following drives; None: no longer."""
        self._physics.watch = watch

    def _driven(self, drive: Drive, stop_asked: Callable[[], str | None]) -> Outcome:
        mujoco.mj_forward(self._model, self._data)
        done = f"after {drive.moved_m:.2f} m and {math.degrees(drive.turned_rad):.0f}°"
        if drive.stopped:
            reason = f"stopped {done}: {stop_asked() or 'stop-now'}"
        elif not drive.arrived:
            reason = f"blocked {done}; look, and go another way"
        else:
            reason = ""
        turned_rad = wrap_angle(drive.turned_rad)
        result = ActionResult(drive.arrived, reason, drive.moved_m, turned_rad)
        return Outcome(result, self._named(drive.touched))

    def _show(self, angle_rad: float) -> Outcome:
        if self._gripper.held is None:
            return Outcome(ActionResult(False, "the gripper is empty; pick something first"))
        self._gripper.show(angle_rad)
        self._pause()
        return Outcome(ActionResult(True))

    def _pick(self, believed_m: Point, class_name: str) -> Outcome:
        self._pause()
        point = self._senses.true_point_m(believed_m)
        near = self._manipulation.within_grasp(point)
        try:
            thing = self._manipulation.pick(point, _text(believed_m), class_name)
        except ManipulationFailed as why:
            self._tracker.pick_tried(class_name, near, "", str(why))
            return Outcome(ActionResult(False, str(why)))
        self._tracker.pick_tried(class_name, near, thing.name, "")
        self.held_class_requested = class_name
        self.support_of[thing.name] = ""
        self._pause()
        return Outcome(ActionResult(True))

    def _place(self, believed_m: Point) -> Outcome:
        self._pause()
        point = self._senses.true_point_m(believed_m)
        try:
            thing, rest = self._manipulation.place(point, _text(believed_m))
        except ManipulationFailed as why:
            self._tracker.place_tried(self.held_name, None, str(why))
            return Outcome(ActionResult(False, str(why)))
        self.held_class_requested = ""
        on = {self._names[body]: z for body, z in rest.on.items()}
        # Of several bodies, receptacles come first.
        self.support_of[thing.name] = min(
            on, key=lambda it: (it not in self._receptacles, it), default=""
        )
        released = ReleaseResult(
            thing.name, rest.at_rest, on, rest.height_m, self._named(rest.touched_any_time)
        )
        self._tracker.place_tried(thing.name, released, "")
        return Outcome(ActionResult(True), released=released)

    def _named(self, bodies: Iterable[int]) -> frozenset[str]:
        return frozenset(self._names[body] for body in bodies)

    def _pause(self) -> None:
        """Run the physics for `_PAUSE_S`, then update all poses to its last step."""
        self._physics.begin()
        for left in reversed(range(math.ceil(_PAUSE_S / self._model.opt.timestep))):
            self._physics.step(whole=left == 0)
        self._gripper.follow()
        mujoco.mj_forward(self._model, self._data)


def _asked(stop_asked: Callable[[], str | None]) -> Callable[[], bool]:
    return lambda: stop_asked() is not None


def _text(point: Point) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
