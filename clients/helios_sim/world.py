"""Simulated world: a home with a robot, physics, images, ground truth and task metrics.

Only one thread may use a World, because it holds a GL context; `stop` and `clear_stop` may come
from any thread. `service.py` serves a World in its own process; `simulation_thread.py` runs it on
its own thread.
"""

from __future__ import annotations

import math
import threading
import uuid
from collections import OrderedDict
from dataclasses import replace

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
from helios_sim.action_limits import limit_violation
from helios_sim.drive_trace import DriveTrace
from helios_sim.episode_events import Event
from helios_sim.episode_tracker import EpisodeTracker
from helios_sim.ground_truth import Segmentation, TrueObjectState
from helios_sim.home import Episode, Home
from helios_sim.manipulation import PickRule
from helios_sim.mujoco_library import mujoco
from helios_sim.object_states import current_object_states
from helios_sim.odometry_drift import Pose
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
from helios_sim.sensor_noise import SENSORS, SensorErrorModel

_REMEMBERED_ACTIONS = 1024
_START_SETTLE_S = 1.0


class World(RobotDriver):
    """Simulated world, and robot driver for use within one thread. See the module."""

    def __init__(
        self,
        home: Home,
        episode: Episode | None = None,
        *,
        boot_id: str = "",
        sensor: SensorErrorModel = SENSORS["none"],
        pick_rule: PickRule = "physical",
        colored: bool = True,
        pace: float = 0.0,
        reported_start: Pose | None = None,
    ) -> None:
        """episode: the task to measure; None measures only steps and collisions.

        sensor: errors of images and poses, seeded with the seed of the home. pick_rule: which
        object a pick takes, see `manipulation`. colored: False takes less than half of the time for
        a capture and its ground truth. Color images are then black; all else is the same.
        pace: simulated seconds per second of a drive; 0 for as fast as possible.
        reported_start: x, y (m), yaw (rad) that the robot reports at its start; None for the true
        pose. Anything else makes the origin of its poses unknown.
        """
        spec = home.spec()
        add_robot(spec)
        camera = pinhole()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.width, camera.height
        spec.visual.quality.shadowsize = 0  # no light of a home casts shadows
        spec.compiler.usethread = False  # threads are no faster, and each keeps its heap
        self._model = model = spec.compile()
        # Bodies at rest sleep and cost no time. Must be set before MjData is created.
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
        self._halt_reason: str | None = None  # ends the running action alone
        self._results: OrderedDict[str, ActionResult] = OrderedDict()
        self._settle()
        movable = [int(model.body(thing.name).id) for thing in home.objects]
        self._sensors = RobotSensors(
            model,
            self._data,
            robot,
            camera,
            home,
            movable,
            sensor,
            colored,
            reported_start,
        )
        self.trace = DriveTrace(pace)
        self._executor = ActionExecutor(
            model, self._data, robot, home, self._sensors, self._tracker, pick_rule, self.trace
        )

    # --- driver interface ---------------------------------------------------------------------
    def describe(self) -> RobotDescription:
        return self._description

    def state(self) -> RobotState:
        """State of the robot; `held` is the requested class, not the object it truly holds."""
        with self._stop_lock:
            reason = self._stop_reason
        return RobotState(
            T_world_base=self._sensors.T_world_base,
            tilt_rad=float(self._data.qpos[self._robot.tilt_qpos]),
            held=self._executor.held_class_requested,
            stopped=reason is not None,
            world_epoch=0,
            robot_boot_id=self._boot_id,
            message=reason or "",
        )

    def capture(self) -> Capture:
        """Capture of RGB and depth from one pass, stamped with simulated time."""
        return self._sensors.capture(self._executor.support_of, self._executor.shown)

    def act(self, action: Action, action_id: str) -> ActionResult:
        """Execute the action once; a repeated id returns the stored result.

        A refused action is not stored. Raises InvalidInput for an empty id.
        """
        if not action_id:
            raise InvalidInput("the action has no id; give each action an id of its own")
        if action_id in self._results:
            return self._results[action_id]
        why_not = self._refusal(action)
        if why_not:
            return ActionResult(False, why_not, steps=self.progress.steps)
        self.trace.begun += 1
        self._halt_reason = None  # of an action before
        outcome = self._executor.execute(action, lambda: self._stop_reason or self._halt_reason)
        self._measure(outcome)
        moved_m, turned_rad = self._sensors.update_odometry()
        result = replace(outcome.result, collided=bool(outcome.touched), steps=self.progress.steps)
        if isinstance(action, Forward | Turn):
            result = replace(result, moved_m=moved_m, turned_rad=turned_rad)
        self._results[action_id] = result
        self.trace.actions += 1
        while len(self._results) > _REMEMBERED_ACTIONS:
            self._results.popitem(last=False)
        return result

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        """Execute an action like `act`, with `hz` images per simulated second of a drive."""
        seen: list[Capture] = []
        next_s = float(self._data.time)

        def watch() -> None:
            nonlocal next_s
            if float(self._data.time) >= next_s:
                next_s += 1.0 / hz
                seen.append(self._sensors.capture_moving())

        self._executor.watch_drives(watch)
        try:
            result = self.act(action, action_id)
            return result, tuple(seen)
        finally:
            self._executor.watch_drives(None)

    def stop(self, reason: str) -> None:
        """End a drive within one physics step and latch the stop. Thread-safe."""
        with self._stop_lock:
            self._stop_reason = reason or "stop-now"

    def halt(self, reason: str) -> None:
        """End the running drive within one physics step, without a latch. Thread-safe."""
        self._halt_reason = reason

    def clear_stop(self) -> None:
        with self._stop_lock:
            self._stop_reason = None

    def close(self) -> None:
        """Release the GL context; call it from the thread that created the world."""
        self._sensors.close()

    # --- ground truth -------------------------------------------------------------------------
    @property
    def home(self) -> Home:
        """Home in which the robot is."""
        return self._home

    @property
    def episode(self) -> Episode:
        """Measured task; an empty episode if there is none."""
        return self._tracker.episode

    @property
    def tracker(self) -> EpisodeTracker:
        """Tracker of the task, with candidates, goals and viewpoints."""
        return self._tracker

    @property
    def progress(self) -> Progress:
        """Metrics after the actions executed so far."""
        return self._tracker.progress

    @property
    def held_name(self) -> str:
        """Name of the held body; empty if the gripper is empty."""
        return self._executor.held_name

    def position_m(self, name: str) -> NDArray[np.float64]:
        """Current position [3] of a body of the home; for a graspable object the box centre."""
        return self._data.body(name).xpos.copy()

    def object_states(self) -> tuple[TrueObjectState, ...]:
        """Current state of all furniture and movable objects."""
        return tuple(current_object_states(self._home, self._data, self._executor.support_of))

    @property
    def events(self) -> tuple[Event, ...]:
        """All picks, places and collisions so far."""
        return tuple(self._tracker.events)

    def arrived(self) -> bool:
        """True if an agent that reports success now has found the object; see objectnav_metrics."""
        return self._tracker.arrived()

    @property
    def T_estimated_true(self) -> Matrix:
        """Transform [4, 4] from the true world frame to the currently estimated world frame."""
        return self._sensors.T_estimated_true

    @property
    def trajectory_m(self) -> NDArray[np.float64]:
        """True base positions [n, 2] at the start and after each action."""
        return np.array(self._tracker.track_m)

    def color_image(self) -> NDArray[np.uint8]:
        """Color image [h, w, 3], RGB, of the current view without sensor errors."""
        return self._sensors.color_image()

    def segmentation(self, stamp_ns: int) -> Segmentation:
        """Segmentation of one of the last 64 captures. Raises InvalidInput for any other stamp."""
        return self._sensors.segmentation(stamp_ns)

    # --- actions ------------------------------------------------------------------------------
    def _refusal(self, action: Action) -> str:
        """Reason why the action cannot start; empty if it can."""
        with self._stop_lock:
            reason = self._stop_reason
        if reason is not None:
            return f"the robot is stopped ({reason}); clear the stop first"
        return limit_violation(action, self._description)

    def _measure(self, outcome: Outcome) -> None:
        x, y, _ = self._robot.pose(self._data)
        asked = self._tracker.targets_needing_coverage((x, y), self.held_name)
        coverage: dict[str, float] = {}
        if asked:
            ids = self._sensors.bodies_in_view()
            counts = np.bincount(ids.ravel(), minlength=len(self._names)) / ids.size
            coverage = {name: float(counts[self._names.index(name)]) for name in asked}
        self._tracker.record_step(
            (x, y),
            coverage,
            self.held_name,
            outcome.touched | self._executor.touching(),
            outcome.result.moved_m,
            outcome.released,
        )

    def _settle(self) -> None:
        """Put the robot at its start pose and let all objects come to rest."""
        data, robot = self._data, self._robot
        for address, value in zip(robot.qpos, self._home.start_pose, strict=True):
            data.qpos[address] = value
        data.qpos[robot.tilt_qpos] = START_TILT_RAD
        for _ in range(math.ceil(_START_SETTLE_S / self._model.opt.timestep)):
            mujoco.mj_step(self._model, data)
        mujoco.mj_forward(self._model, data)
