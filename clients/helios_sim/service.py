"""World process: serves one world on the bus, with ground truth for the evaluation under truth/."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import (
    action_from_proto,
    description_to_proto,
    result_to_proto,
    state_to_proto,
)
from helios_core.errors import HeliosError
from helios_core.health import Health
from helios_core.heartbeat import SILENCE_S, HeartbeatMonitor
from helios_core.robot import Action, ActionResult, Capture, RobotDriver
from helios_core.topics import (
    BRIDGE_HEARTBEAT,
    TRUTH_EPISODE,
    TRUTH_METRICS,
    TRUTH_OBJECTS,
    TRUTH_SEGMENTATION,
    TRUTH_TRACE,
    WORLD_ACT,
    WORLD_CAPTURE,
    WORLD_CLEAR_STOP,
    WORLD_DESCRIBE,
    WORLD_STATE,
    WORLD_STOP,
    WORLD_WATCHED,
)

from helios_sim.assets import realistic
from helios_sim.capture_messages import capture_to_proto
from helios_sim.episode_tracker import episode_of
from helios_sim.ground_truth_messages import (
    episode_to_proto,
    metrics_to_proto,
    objects_to_proto,
    segmentation_to_proto,
    trace_to_proto,
)
from helios_sim.home import PRESETS, Episode, Home, generate_home
from helios_sim.home.task_sampling import NoTask
from helios_sim.injected_faults import Faults, FaultyRobot
from helios_sim.sensor_noise import SENSORS
from helios_sim.settings import Settings
from helios_sim.simulation_thread import WorldThread
from helios_sim.start_poses import with_random_start
from helios_sim.world import World

log = logging.getLogger(__name__)
T = TypeVar("T")
MOST_WATCH_HZ = 60.0  # images per second of an action
NO_FAULTS = Faults()


class WorldService:
    """Request handlers of a world; those that act or look run on its thread."""

    def __init__(
        self,
        bus: Bus,
        thread: WorldThread,
        health: Health,
        heartbeat_s: float = SILENCE_S,
        faults: Faults = NO_FAULTS,
    ) -> None:
        """heartbeat_s: a drive ends when the bridge is silent for this long; 0: never. faults:
        injected into what the robot reports."""
        self._thread, self._health = thread, health
        self._robot: RobotDriver = thread if faults == NO_FAULTS else FaultyRobot(thread, faults)
        self._watched: tuple[Capture, ...] = ()  # images during the newest action
        self._monitor = HeartbeatMonitor(bus, BRIDGE_HEARTBEAT, heartbeat_s, thread.halt)
        bus.serve(WORLD_STATE, lambda _: state_to_proto(self._robot.state()))
        bus.serve(WORLD_CAPTURE, self._capture)
        bus.serve(WORLD_ACT, self._act)
        bus.serve(WORLD_WATCHED, self._last_watched)
        bus.serve(WORLD_STOP, self._stop)
        bus.serve(WORLD_CLEAR_STOP, self._clear_stop)
        bus.serve(TRUTH_SEGMENTATION, self._segmentation)
        bus.serve(
            TRUTH_EPISODE, lambda _: thread.run(lambda w: episode_to_proto(w.home, w.episode))
        )
        bus.serve(TRUTH_METRICS, lambda _: thread.run(lambda w: metrics_to_proto(w.progress)))
        bus.serve(
            TRUTH_OBJECTS, lambda _: thread.run(lambda w: objects_to_proto(w.object_states()))
        )
        bus.serve(TRUTH_TRACE, lambda request: trace_to_proto(thread.trace, request.since_ns))
        # Served last: once a client finds the description, all other queries are served.
        bus.serve(WORLD_DESCRIBE, lambda _: description_to_proto(self._robot.describe()))
        health.ready(f"injected faults: {faults}" if faults != NO_FAULTS else "")

    def close(self) -> None:
        self._thread.close()

    def _capture(self, _: pb.Empty) -> pb.WorldCapture:
        return capture_to_proto(self._timed("capture_ms", self._robot.capture))

    def _last_watched(self, _: pb.Empty) -> pb.WorldCaptures:
        return pb.WorldCaptures(captures=map(capture_to_proto, self._watched))

    def _act(self, request: pb.WorldActRequest) -> pb.ActionResult:
        action = action_from_proto(request.action)
        with self._monitor.watching(request.action_id, request.beats):
            done = self._timed(
                "act_ms", lambda: self._do(action, request.action_id, request.watch_hz)
            )
        self._health.count("actions")
        return result_to_proto(done, request.action_id)

    def _do(self, action: Action, action_id: str, watch_hz: float) -> ActionResult:
        self._watched = ()
        if not 0.0 < watch_hz <= MOST_WATCH_HZ:
            return self._robot.act(action, action_id)
        done, self._watched = self._robot.act_and_watch(action, action_id, watch_hz)
        return done

    def _stop(self, request: pb.StopRequest) -> pb.Empty:
        self._thread.stop(request.reason)
        return pb.Empty()

    def _clear_stop(self, _: pb.Empty) -> pb.Empty:
        self._thread.clear_stop()
        return pb.Empty()

    def _segmentation(self, request: pb.TruthSegmentationRequest) -> pb.TruthSegmentation:
        stamp_ns = request.stamp_ns
        truth = self._timed(
            "segmentation_ms", lambda: self._thread.run(lambda world: world.segmentation(stamp_ns))
        )
        return segmentation_to_proto(truth)

    def _timed(self, name: str, call: Callable[[], T]) -> T:
        began = time.monotonic()
        out = call()
        self._health.sample(name, (time.monotonic() - began) * 1e3)
        return out


def world_of(settings: Settings) -> World:
    """World of the home, task, sensor and pick rule that the settings choose.

    Call it on the thread that will use the world. Raises HeliosError if there is no such home, if
    its plan cannot be used, or if no furniture is baked.
    """
    furniture_models = realistic() if settings.furniture == "realistic" else None
    if settings.home is None:
        home = generate_home(settings.seed, PRESETS[settings.preset], furniture_models)
    else:
        from helios_sim.plans import PlanSource, drawn_home, home_of_plan  # takes a second
        from helios_sim.plans.plan_summary import summary

        source = PlanSource.of(settings.home, settings.level)
        home = home_of_plan(source, settings.seed, furniture_models)
        for line in summary(drawn_home(source, furniture_models)):
            log.info("%s", line)
    if settings.start_seed is not None:
        home = with_random_start(home, settings.start_seed)
    task_seed = settings.seed if settings.task_seed is None else settings.task_seed
    world = World(
        home,
        _task_of(home, task_seed),
        sensor=SENSORS[settings.sensor],
        pick_rule=settings.pick_rule,
        pace=settings.pace,
        reported_start=(0.0, 0.0, 0.0) if settings.pose_origin == "start" else None,
    )
    log.info("home %s, task: %s", home.structure_hash()[:12], world.episode.instruction)
    return world


def _task_of(home: Home, seed: int) -> Episode | None:
    """Task of a seed; None in the home of a plan that has none."""
    try:
        return episode_of(home, seed)
    except NoTask as error:
        log.warning("%s", error.message)
        return None


class HostedWorld:
    """World process: builds the world in the background, then serves it."""

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        self._ending = threading.Event()
        self._service: WorldService | None = None
        self._lock = threading.Lock()
        health.waiting(f"the home of seed {settings.seed} is being built")

        def build() -> None:
            try:
                thread = WorldThread(lambda: world_of(settings))
            except HeliosError as error:
                log.error("no world: %s", error.message)
                health.degraded(error.message)
                return
            except Exception as error:
                log.exception("no world")
                health.degraded(f"the world could not be made: {type(error).__name__}: {error}")
                return
            with self._lock:
                if self._ending.is_set():
                    thread.close()
                else:
                    self._service = WorldService(
                        bus, thread, health, settings.heartbeat_s, Faults.of(settings.faults)
                    )

        threading.Thread(target=build, name="build", daemon=True).start()

    def close(self) -> None:
        self._ending.set()
        with self._lock:
            if self._service is not None:
                self._service.close()
