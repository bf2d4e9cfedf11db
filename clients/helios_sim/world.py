"""The simulated world: a home, a robot in it, physics, pictures, truth and the task's metrics.

One thread uses a World (it holds a GL context), except for `stop`, which may come from any. In its
own process it is served by `service.py`; `simulation_thread.py` gives it a thread within a process.
"""

from __future__ import annotations

import math
import threading
import uuid
from collections import OrderedDict
from dataclasses import replace

import mujoco
import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    Forward,
    RobotDriver,
    Turn,
)
from helios_core.types import RobotDescription, RobotState
from numpy.typing import NDArray

from helios_sim.action_executor import ActionExecutor, Outcome
from helios_sim.action_limits import refusal
from helios_sim.episode_events import Event
from helios_sim.episode_tracker import EpisodeTracker
from helios_sim.ground_truth import Segmentation, TrueThing
from helios_sim.home import Episode, Home
from helios_sim.object_states import things_now
from helios_sim.ovmm_metrics import Progress
from helios_sim.robot_model import (
    MAX_DEPTH_M,
    START_TILT_RAD,
    RobotIndex,
    add_robot,
    description,
    pinhole,
)
from helios_sim.robot_sensors import RobotSensors
from helios_sim.sensor_noise import SENSORS, SensorRealism

_REMEMBERED_ACTIONS = 1024
_START_SETTLE_S = 1.0


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
        spec.compiler.usethread = False  # no faster, and each thread keeps a heap for good
        self._model = model = spec.compile()
        # Before the data is made: what lies still costs nothing.
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        self._data = mujoco.MjData(model)
        self._robot = robot = RobotIndex.of(model)
        self._home = home
        self._names = [model.body(body).name for body in range(model.nbody)]
        self._description = description(min(MAX_DEPTH_M, sensor.max_depth_m))
        episode = episode or Episode("", "", "", "")
        self._tracker = EpisodeTracker(home, episode, self._description.footprint_radius_m)
        self._boot_id = boot_id or uuid.uuid4().hex
        self._stop_lock = threading.Lock()
        self._stop_reason: str | None = None
        self._results: OrderedDict[str, ActionResult] = OrderedDict()
        self._settle()
        movable = [int(model.body(thing.name).id) for thing in home.objects]
        self._sensors = RobotSensors(model, self._data, robot, camera, home, movable, sensor)
        self._executor = ActionExecutor(
            model, self._data, robot, home, self._sensors, self._tracker
        )

    # --- what a driver offers -----------------------------------------------------------------
    def describe(self) -> RobotDescription:
        return self._description

    def state(self) -> RobotState:
        """How the robot is; `held` is the class it was asked to pick, not what it truly holds."""
        with self._stop_lock:
            reason = self._stop_reason
        return RobotState(
            T_world_base=self._sensors.T_world_base,
            tilt_rad=float(self._data.qpos[self._robot.tilt_qpos]),
            held=self._executor.held_as,
            stopped=reason is not None,
            world_epoch=0,
            robot_boot_id=self._boot_id,
            message=reason or "",
        )

    def capture(self) -> Capture:
        """RGB and depth of one pass, with the stamp of simulated time."""
        return self._sensors.capture(self._executor.on)

    def act(self, action: Action, action_id: str) -> ActionResult:
        """Do it once; the same id again is answered from memory. A refusal is not remembered."""
        if not action_id:
            raise InvalidInput("the action has no id; give each action an id of its own")
        if action_id in self._results:
            return self._results[action_id]
        why_not = self._refusal(action)
        if why_not:
            return ActionResult(False, why_not, steps=self.progress.steps)
        outcome = self._executor.do(action, lambda: self._stop_reason)
        self._measure(outcome)
        moved_m, turned_rad = self._sensors.feel_motion()
        result = replace(outcome.result, collided=bool(outcome.touched), steps=self.progress.steps)
        if isinstance(action, Forward | Turn):
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
        self._sensors.close()

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
    def tracker(self) -> EpisodeTracker:
        """Candidates, goals and viewpoints of the task."""
        return self._tracker

    @property
    def progress(self) -> Progress:
        """The metrics so far."""
        return self._tracker.progress

    @property
    def held_name(self) -> str:
        """Body that the gripper holds; empty: none."""
        return self._executor.held_name

    def position_m(self, name: str) -> NDArray[np.float64]:
        """Where a body of the home is now [3]; the middle of a graspable thing's box."""
        return self._data.body(name).xpos.copy()

    def things(self) -> tuple[TrueThing, ...]:
        """All furniture and movable things as they are now."""
        return tuple(things_now(self._home, self._data, self._executor.on))

    @property
    def events(self) -> tuple[Event, ...]:
        """Picks, places and collisions so far."""
        return tuple(self._tracker.events)

    def arrived(self) -> bool:
        """Whether an agent that says now that it has found the thing is right (see objectnav)."""
        return self._tracker.arrived()

    @property
    def T_believed_true(self) -> Matrix:
        """Takes points of the true world to where the robot believes them now [4, 4]."""
        return self._sensors.T_believed_true

    @property
    def trajectory_m(self) -> NDArray[np.float64]:
        """Where the base truly was at the start and after each action [n, 2]."""
        return np.array(self._tracker.track_m)

    def segmentation(self, stamp_ns: int) -> Segmentation:
        """Of one of the last 64 captures. Raises InvalidInput for any other stamp."""
        return self._sensors.segmentation(stamp_ns)

    # --- actions ------------------------------------------------------------------------------
    def _refusal(self, action: Action) -> str:
        """Why this cannot be begun; empty if it can."""
        with self._stop_lock:
            reason = self._stop_reason
        if reason is not None:
            return f"the robot is stopped ({reason}); clear the stop first"
        return refusal(action, self._description)

    def _measure(self, outcome: Outcome) -> None:
        x, y, _ = self._robot.pose(self._data)
        asked = self._tracker.in_question((x, y), self.held_name)
        coverage: dict[str, float] = {}
        if asked:
            ids = self._sensors.bodies_in_view()
            counts = np.bincount(ids.ravel(), minlength=len(self._names)) / ids.size
            coverage = {name: float(counts[self._names.index(name)]) for name in asked}
        self._tracker.note(
            (x, y),
            coverage,
            self.held_name,
            outcome.touched | self._executor.touching(),
            outcome.result.moved_m,
            outcome.released,
        )

    def _settle(self) -> None:
        """Put the robot where it starts, and let all things come to rest."""
        data, robot = self._data, self._robot
        for address, value in zip(robot.qpos, self._home.start_pose, strict=True):
            data.qpos[address] = value
        data.qpos[robot.tilt_qpos] = START_TILT_RAD
        for _ in range(math.ceil(_START_SETTLE_S / self._model.opt.timestep)):
            mujoco.mj_step(self._model, data)
        mujoco.mj_forward(self._model, data)
