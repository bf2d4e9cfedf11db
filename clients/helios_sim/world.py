"""The simulated world: a home, a robot in it, physics, pictures, truth and the task's metrics.

One thread uses a World (it holds a GL context), except for `stop`, which may come from any. In its
own process it is served by `service.py`; `thread.py` gives it a thread within a process.
"""

from __future__ import annotations

import math
import threading
import uuid
from collections import OrderedDict
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import se2_to_se3, wrap_angle
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    Forward,
    Observe,
    Pick,
    Place,
    RobotDriver,
    Tilt,
    Turn,
)
from helios_core.types import RobotDescription, RobotState
from numpy.typing import NDArray

from helios_sim.drift import Drift, moved
from helios_sim.episode import Tracker
from helios_sim.events import Event
from helios_sim.gripper import Graspable, Gripper
from helios_sim.home import Episode, Home
from helios_sim.limits import refusal
from helios_sim.manipulation import CannotDo, Manipulation
from helios_sim.metrics import Progress, Released
from helios_sim.motion import Base, Drive
from helios_sim.past import Past
from helios_sim.render import Painter
from helios_sim.robot_model import (
    MAX_DEPTH_M,
    START_TILT_RAD,
    RobotIndex,
    add_robot,
    camera_pose,
    description,
    pinhole,
)
from helios_sim.sensor import SENSORS, SensorRealism, sensed_color, sensed_depth
from helios_sim.things import things_now
from helios_sim.truth import Segmentation, TrueThing

DRAWN_GROUPS = (0, 1, 2)
_REMEMBERED_ACTIONS = 1024
_START_SETTLE_S, _PAUSE_S = 1.0, 0.1


@dataclass(frozen=True)
class _Outcome:
    """What an action came to, with the truth that the robot is not told."""

    result: ActionResult
    touched: frozenset[int] = frozenset()
    released: Released | None = None


class World(RobotDriver):
    """See the module. Also a driver of itself, for use within one thread."""

    def __init__(
        self,
        home: Home,
        episode: Episode | None = None,
        *,
        boot_id: str = "",
        sensor: SensorRealism = SENSORS["none"],
    ) -> None:
        """episode: the task to measure; None takes no metrics but steps and collisions.

        sensor: how pictures and poses err, by the seed of the home.
        """
        spec = home.spec()
        add_robot(spec)
        camera = pinhole()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.width, camera.height
        spec.visual.quality.shadowsize = 0  # no light of a home casts shadows
        self._model = model = spec.compile()
        # Before the data is made: what lies still costs nothing.
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        self._data = mujoco.MjData(model)
        self._robot = robot = RobotIndex.of(model)
        self._home = home
        self._things = {
            int(model.body(t.name).id): Graspable.of(model, t.name, t.size_m) for t in home.objects
        }
        self._on = {thing.name: thing.receptacle for thing in home.objects}
        self._receptacles = frozenset(item.name for item in home.receptacles)
        self._names = [model.body(b).name for b in range(model.nbody)]
        movable = frozenset(self._things)
        self._gripper = Gripper(model, self._data, robot, movable)
        self._base = Base(model, self._data, robot, movable, self._step)
        self._sensor = sensor
        self._description = description(min(MAX_DEPTH_M, sensor.max_depth_m))
        episode = episode or Episode("", "", "", "")
        self._tracker = Tracker(home, episode, self._description.footprint_radius_m)
        self._held_as = ""
        self._boot_id = boot_id or uuid.uuid4().hex
        self._stop_lock = threading.Lock()
        self._stop_reason: str | None = None
        self._results: OrderedDict[str, ActionResult] = OrderedDict()
        self._last_stamp_ns = 0
        for address, value in zip(robot.qpos, home.start_pose, strict=True):
            self._data.qpos[address] = value
        self._set_tilt(START_TILT_RAD)
        self._pause(_START_SETTLE_S)
        self._painter = Painter(model, robot.camera, (camera.width, camera.height), DRAWN_GROUPS)
        self._past = Past(model, self._painter, home, self._things)
        self._manipulation = Manipulation(
            self._data, self._gripper, self._things.values(), self._bodies_seen, self._step
        )
        self._drift = Drift(sensor, home.seed, robot.pose(self._data))

    # --- what a driver offers -----------------------------------------------------------------
    def describe(self) -> RobotDescription:
        return self._description

    def state(self) -> RobotState:
        """How the robot is; `held` is the class it was asked to pick, not what it truly holds."""
        with self._stop_lock:
            reason = self._stop_reason
        return RobotState(
            T_world_base=se2_to_se3(*self._drift.believed),
            tilt_rad=float(self._data.qpos[self._robot.tilt_qpos]),
            held=self._held_as,
            stopped=reason is not None,
            world_epoch=0,
            robot_boot_id=self._boot_id,
            message=reason or "",
        )

    def capture(self) -> Capture:
        """RGB and depth of one pass, with the stamp of simulated time."""
        stamp_ns = max(round(float(self._data.time) * 1e9), self._last_stamp_ns + 1)
        self._last_stamp_ns = stamp_ns
        color, depth_m = self._painter.color_and_depth(self._data, MAX_DEPTH_M)
        self._past.remember(stamp_ns, self._data.qpos, self._on)
        camera, seed = self._description.camera, self._home.seed
        return Capture(
            stamp_ns=stamp_ns,
            color=sensed_color(color, self._sensor, seed, stamp_ns),
            depth_m=sensed_depth(depth_m, camera, self._sensor, seed, stamp_ns),
            camera=camera,
            T_world_cam=self._drift.T_believed_true @ camera_pose(self._data, self._robot.camera),
            T_world_base=se2_to_se3(*self._drift.believed),
        )

    def act(self, action: Action, action_id: str) -> ActionResult:
        """Do it once; the same id again is answered from memory. A refusal is not remembered."""
        if not action_id:
            raise InvalidInput("the action has no id; give each action an id of its own")
        if action_id in self._results:
            return self._results[action_id]
        why_not = self._refusal(action)
        if why_not:
            return ActionResult(False, why_not, steps=self.progress.steps)
        outcome = self._do(action)
        self._measure(outcome)
        before = self._drift.believed
        self._drift.follow(self._robot.pose(self._data))
        result = replace(outcome.result, collided=bool(outcome.touched), steps=self.progress.steps)
        if self._sensor.drifts and isinstance(action, Forward | Turn):
            moved_m, turned_rad = moved(before, self._drift.believed)
            result = replace(result, moved_m=moved_m, turned_rad=turned_rad)
        self._results[action_id] = result
        while len(self._results) > _REMEMBERED_ACTIONS:
            self._results.popitem(last=False)
        return result

    def stop(self, reason: str) -> None:
        """From any thread: ends a drive within one step of the physics, and latches."""
        with self._stop_lock:
            self._stop_reason = reason or "stop-now"

    def clear_stop(self) -> None:
        with self._stop_lock:
            self._stop_reason = None

    def close(self) -> None:
        """Give the graphics back; from the thread that made the world."""
        self._painter.close()

    # --- the truth ----------------------------------------------------------------------------
    @property
    def home(self) -> Home:
        """The home that the robot is in."""
        return self._home

    @property
    def episode(self) -> Episode:
        """The task that is measured; empty where there is none."""
        return self._tracker.episode

    @property
    def tracker(self) -> Tracker:
        """Candidates, goals and viewpoints of the task."""
        return self._tracker

    @property
    def progress(self) -> Progress:
        """The metrics so far."""
        return self._tracker.progress

    @property
    def held_name(self) -> str:
        """Body that the gripper holds; empty: none."""
        return self._gripper.held.name if self._gripper.held else ""

    def position_m(self, name: str) -> NDArray[np.float64]:
        """Where a body of the home is now [3]; the middle of a graspable thing's box."""
        return self._data.body(name).xpos.copy()

    def things(self) -> tuple[TrueThing, ...]:
        """All furniture and movable things as they are now."""
        return tuple(things_now(self._home, self._data, self._on))

    @property
    def events(self) -> tuple[Event, ...]:
        """Picks, places and collisions so far."""
        return tuple(self._tracker.events)

    def arrived(self) -> bool:
        """Whether an agent that says now that it has found the thing is right (see objectnav)."""
        return self._tracker.arrived()

    @property
    def trajectory_m(self) -> NDArray[np.float64]:
        """Where the base truly was at the start and after each action [n, 2]."""
        return np.array(self._tracker.track_m)

    def segmentation(self, stamp_ns: int) -> Segmentation:
        """Of one of the last 64 captures. Raises InvalidInput for any other stamp."""
        return self._past.segmentation(stamp_ns)

    # --- actions ------------------------------------------------------------------------------
    def _refusal(self, action: Action) -> str:
        """Why this cannot be begun; empty if it can."""
        with self._stop_lock:
            reason = self._stop_reason
        if reason is not None:
            return f"the robot is stopped ({reason}); clear the stop first"
        return refusal(action, self._description)

    def _do(self, action: Action) -> _Outcome:
        match action:
            case Forward(distance_m):
                return self._driven(self._base.forward(distance_m, self._stop_asked))
            case Turn(angle_rad):
                return self._driven(self._base.turn(angle_rad, self._stop_asked))
            case Tilt(angle_rad):
                self._set_tilt(angle_rad)
                self._pause(_PAUSE_S)
                return _Outcome(ActionResult(True))
            case Pick(point, class_name):
                return self._pick(point, class_name)
            case Place(point):
                return self._place(point)
            case Observe():
                self._pause(_PAUSE_S)
                return _Outcome(ActionResult(True))

    def _driven(self, drive: Drive) -> _Outcome:
        mujoco.mj_forward(self._model, self._data)
        done = f"after {drive.moved_m:.2f} m and {math.degrees(drive.turned_rad):.0f}°"
        if drive.stopped:
            reason = f"stopped {done}: {self.state().message or 'stop-now'}"
        elif not drive.arrived:
            reason = f"blocked {done}; look, and go another way"
        else:
            reason = ""
        turned_rad = wrap_angle(drive.turned_rad)
        result = ActionResult(drive.arrived, reason, drive.moved_m, turned_rad)
        return _Outcome(result, drive.touched)

    def _pick(self, believed_m: tuple[float, float, float], class_name: str) -> _Outcome:
        self._pause(_PAUSE_S)
        point = self._drift.true_point_m(believed_m)
        near = self._manipulation.within_grasp(point)
        try:
            thing = self._manipulation.pick(point, _told(believed_m))
        except CannotDo as why:
            self._tracker.pick_tried(class_name, near, "", str(why))
            return _Outcome(ActionResult(False, str(why)))
        self._tracker.pick_tried(class_name, near, thing.name, "")
        self._held_as = class_name
        self._on[thing.name] = ""
        self._pause(_PAUSE_S)
        return _Outcome(ActionResult(True))

    def _place(self, believed_m: tuple[float, float, float]) -> _Outcome:
        self._pause(_PAUSE_S)
        point = self._drift.true_point_m(believed_m)
        try:
            thing, rest = self._manipulation.place(point, _told(believed_m))
        except CannotDo as why:
            self._tracker.place_tried(self.held_name, None, str(why))
            return _Outcome(ActionResult(False, str(why)))
        self._held_as = ""
        on = {self._names[body]: z for body, z in rest.on.items()}
        met = frozenset(self._names[body] for body in rest.met)
        self._on[thing.name] = min(
            on, key=lambda name: (name not in self._receptacles, name), default=""
        )
        released = Released(thing.name, rest.at_rest, on, rest.height_m, met)
        self._tracker.place_tried(thing.name, released, "")
        return _Outcome(ActionResult(True), released=released)

    def _measure(self, outcome: _Outcome) -> None:
        x, y, _ = self._robot.pose(self._data)
        asked = self._tracker.in_question((x, y), self.held_name)
        coverage: dict[str, float] = {}
        if asked:
            ids = self._bodies_seen()
            counts = np.bincount(ids.ravel(), minlength=len(self._names)) / ids.size
            coverage = {name: float(counts[self._names.index(name)]) for name in asked}
        touched = outcome.touched | self._base.touching().keys()
        self._tracker.note(
            (x, y),
            coverage,
            self.held_name,
            frozenset(self._names[body] for body in touched),
            outcome.result.moved_m,
            outcome.released,
        )

    def _bodies_seen(self) -> NDArray[np.int32]:
        return self._past.bodies(self._data.qpos)

    # --- small things -------------------------------------------------------------------------
    def _stop_asked(self) -> bool:
        return self._stop_reason is not None

    def _set_tilt(self, angle_rad: float) -> None:
        self._data.qpos[self._robot.tilt_qpos] = angle_rad
        self._data.qvel[self._robot.tilt_dof] = 0.0
        mujoco.mj_forward(self._model, self._data)

    def _step(self) -> None:
        self._gripper.follow()
        mujoco.mj_step(self._model, self._data)

    def _pause(self, seconds: float) -> None:
        """Let the physics run, then bring all poses to its last instant."""
        for _ in range(math.ceil(seconds / self._model.opt.timestep)):
            self._step()
        self._gripper.follow()
        mujoco.mj_forward(self._model, self._data)


def _told(point: tuple[float, float, float]) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
