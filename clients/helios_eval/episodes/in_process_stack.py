"""A stack in one process, in lockstep: each action waits until every map holds the last keyframe.

It runs the services of `helios up` on a `MemoryBus`. Nothing streams, no watchdog runs, and no
time-out ends anything, so that a loaded machine gives the same result as an idle one.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings as BridgeSettings
from helios_core import proto as pb
from helios_core.codec import object_from_proto
from helios_core.errors import DeadlineExceeded, Unavailable
from helios_core.health import Health
from helios_core.map_snapshot import MapView, decode_snapshot
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.task_states import ENDED
from helios_core.topics import (
    DECISION,
    GET_TASK,
    KEYFRAME,
    OBJECTS,
    OBSERVATION,
    ROBOT_STATE,
    SNAPSHOT,
    SUBMIT,
    TASK,
)
from helios_core.types import ObjectInstance
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import open_detector, open_scorer
from helios_detector.model_set import Models, open_models
from helios_detector.service import DetectorService
from helios_detector.settings import Settings as DetectorSettings
from helios_detector.simulator_truth import Truth, TruthInstance
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings as Map2DSettings
from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.service import PlannerService
from helios_planner.settings import Settings as PlannerSettings
from helios_sim.ground_truth import Segmentation
from helios_sim.simulation_thread import WorldThread

from helios_eval import kernel_compilation
from helios_eval.episodes.episode_record import Noise, Setting
from helios_eval.episodes.real_detector import RealDetector
from helios_eval.episodes.service_settings import of_service, of_stack

NEVER_S = 86_400.0
BRIDGE = BridgeSettings(stream_hz=0, lockstep=True, lease_s=NEVER_S, heartbeat_s=0, checks=False)
LONGEST_ACTION_S = 600.0  # maximum of the bridge
CALL_S = 60.0


class DirectTruth:
    """Ground truth of a world in this process; a `TruthSource` of the detector."""

    def __init__(self, world: WorldThread) -> None:
        self._world = world
        self._last: tuple[int, Truth] | None = None

    def segmentation(self, stamp_ns: int) -> Truth:
        """Ground truth of a frame; detector and scorer ask for the same one in turn."""
        if self._last is None or self._last[0] != stamp_ns:
            shown = self._world.run(lambda world: world.segmentation(stamp_ns))
            self._last = stamp_ns, truth_of(shown)
        return self._last[1]

    def check(self) -> None:
        """Ground truth is always available."""


def truth_of(shown: Segmentation) -> Truth:
    """Conversion of a segmentation to the detector's `Truth`."""
    instances = {
        i.id: TruthInstance(
            i.id, i.class_name, np.array(i.center_m), i.graspable, i.name, i.turn_rad
        )
        for i in shown.instances
    }
    return Truth(shown.ids.astype(np.uint16), instances, shown.T_world_cam)


class InProcessStack:
    """Stack for one episode; see the module.

    A context manager that leaves neither threads nor files.
    """

    def __init__(
        self,
        world: WorldThread,
        agent: str,
        noise: Noise | None,
        seed: int,
        settings: Mapping[str, Setting],
        on_step: Callable[[], None] = lambda: None,
        detector: RealDetector | None = None,
        on_decision: Callable[[pb.Decision], None] = lambda _: None,
    ) -> None:
        """seed: for the detector's errors, and for an agent that draws. noise: None for
        ground-truth semantics. settings: those that differ from the agent's own. on_step: called
        after each action, when every map holds the keyframe; it may query the stack. detector: the
        model of the detections; None for the simulated one. on_decision: called with each
        decision of the planner. A stack that cannot open leaves nothing. Raises HeliosError.
        """
        settings = of_stack(agent, settings)
        self._ended = threading.Event()
        self._hub = MemoryHub(uncopied=frozenset({KEYFRAME, OBSERVATION}))
        self._bus = MemoryBus(self._hub)
        self.healths = {
            name: Health() for name in ("bridge", "detector", "objectmap", "map2d", "planner")
        }
        self._on_step, self._last_seq = on_step, 0
        kernel_compilation.warm_up()
        with ExitStack() as opened:
            folder = opened.enter_context(tempfile.TemporaryDirectory(prefix="helios-eval-"))
            opened.callback(self._bus.close)
            # The services receive a keyframe in this order: 2D map, then detector and its
            # subscribers.
            self._open_maps(opened, settings)
            models = _models(world, noise, seed, settings, detector)
            opened.callback(models.close)
            models.warm_up()
            health = self.healths["detector"]
            DetectorService(
                self.bus(), models.detector, models.scorer, health, models.depth, previews=False
            )
            BridgeService(self.bus(), world, BRIDGE, self.healths["bridge"], first_number=0)
            planner = _planner_settings(Path(folder), agent, seed, settings)
            service = PlannerService(self.bus(), planner, self.healths["planner"])
            opened.callback(service.close)
            self._bus.subscribe(TASK, self._on_task)
            self._bus.subscribe(DECISION, on_decision)
            self._bus.subscribe(ROBOT_STATE, self._on_state)
            self._opened = opened.pop_all()

    def _open_maps(self, opened: ExitStack, settings: Mapping[str, Setting]) -> None:
        map2d = Map2DSettings(**of_service("map2d", settings))
        self._map2d = Map2DService(self.bus(), map2d, self.healths["map2d"])
        opened.callback(self._map2d.close)
        objects = ObjectMapSettings(**of_service("objectmap", settings))
        service = ObjectMapService(self.bus(), objects, self.healths["objectmap"])
        opened.callback(service.close)
        service.warm_up()

    def run(self, instruction: str, max_steps: int, within_s: float) -> pb.Task:
        """Run a task to its end and return it.

        Raises the planner's errors, and DeadlineExceeded.
        """
        request = pb.SubmitRequest(instruction=instruction, max_steps=max_steps)
        self._ended.clear()
        task = self._bus.call(SUBMIT, request, CALL_S)
        if not self._ended.wait(within_s):
            raise DeadlineExceeded(f"the episode did not end within {within_s:g} s")
        return self._bus.call(GET_TASK, pb.TaskRequest(id=task.id), CALL_S)

    def objects(self) -> list[ObjectInstance]:
        """Current instances of the object map."""
        reply = self._bus.call(OBJECTS, pb.ObjectsRequest(), CALL_S)
        return [object_from_proto(o) for o in reply.objects]

    def map(self) -> MapView:
        """Current 2D map."""
        return decode_snapshot(self._bus.call(SNAPSHOT, pb.SnapshotRequest(layers=False), CALL_S))

    def settle(self) -> None:
        """Wait for an attempt to relocalise in a stored map, if one is due."""
        self._map2d.places_settled(CALL_S)

    def bus(self) -> MemoryBus:
        """New bus of this stack, for a subscriber."""
        return MemoryBus(self._hub)

    def stage_ms(self) -> dict[str, float]:
        """Median time per stage of the services, milliseconds."""
        return {
            f"{service}_{name.removesuffix('_ms_median')}": round(value, 3)
            for service, health in self.healths.items()
            for name, value in health.metrics().items()
            if name.endswith("_ms_median")
        }

    def close(self) -> None:
        """End the services, each also if another cannot end; the world stays open."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _on_task(self, task: pb.Task) -> None:
        if task.state in ENDED:
            self._ended.set()

    def _on_state(self, state: pb.RobotState) -> None:
        """Call `on_step` once per action.

        A robot state also comes before the keyframe of an action, still with the last number.
        """
        if state.last_seq != self._last_seq:
            self._last_seq = state.last_seq
            self._on_step()


def _models(
    world: WorldThread,
    noise: Noise | None,
    seed: int,
    settings: Mapping[str, Setting],
    real: RealDetector | None,
) -> Models:
    """Detector and scorer of an episode. Raises HeliosError if they cannot be opened."""
    s = DetectorSettings(**of_service("detector", settings))
    if real is not None:
        real.check()
        s = s.model_copy(update={"detector": real.spec, "threads": 1, "noise_seed": seed})
        return open_models(s, DirectTruth(world))  # truth: for a simulated scorer alone
    options = DetectorOptions(truth=DirectTruth(world), threads=1, noise_seed=seed)
    name = "ground-truth"
    if noise is not None:
        name = "simulated"
        options = DetectorOptions(
            options.truth, 1, noise.table, seed, noise.level, noise.correlation
        )
    with ExitStack() as opened:
        detector = open_detector(name, options)
        opened.callback(detector.close)
        if noise is not None and not detector.name.endswith(noise.digest):
            raise Unavailable(
                f"the noise table {noise.table} has changed since the run began (then "
                f"{noise.digest}, now {detector.name}); give the command again, into another folder"
            )
        models = Models(detector, open_scorer(s.scorer, options))
        opened.pop_all()
    return models


def _planner_settings(
    folder: Path, agent: str, seed: int, settings: Mapping[str, Setting]
) -> PlannerSettings:
    chosen = of_service("planner", settings)
    chosen |= {"state_dir": folder, "agent": agent, "agent_seed": seed}
    chosen |= {"ack_timeout_s": NEVER_S, "call_timeout_s": NEVER_S}
    return PlannerSettings(**chosen, action_timeout_s=LONGEST_ACTION_S)
