"""CPU time of the parts of an episode that runs in one process.

`measured_parts` wraps the entry points of each part for the duration of a block. The time counts
for the part entered last. In lockstep one thread works at a time, so the CPU time of the process is
that of the part; this includes threads of the OpenGL library.
"""

from __future__ import annotations

import functools
import inspect
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

import numpy as np
from helios_core import codec
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus
from helios_detector.frame_analysis import FrameAnalyzer
from helios_planner.tasks.executor import TaskExecutor
from helios_sim.action_executor import ActionExecutor
from helios_sim.renderer import CameraRenderer
from helios_sim.simulation_thread import WorldThread
from helios_sim.world import World
from numpy.typing import NDArray

from helios_eval.episodes.episode_player import play
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.in_process_stack import DirectTruth

PHYSICS, RENDERING, TRUTH = "physics", "rendering", "truth"
DETECTOR, SCORER, OBJECT_MAP, MAPS_2D = "detector", "scorer", "object map", "2D maps"
PLANNER, MESSAGES, REST = "planner", "messages", "rest"
PARTS = (
    PHYSICS, RENDERING, TRUTH, DETECTOR, SCORER, OBJECT_MAP, MAPS_2D, PLANNER, MESSAGES, REST,
)  # fmt: skip
FIRST_STEPS = 5  # of an episode, left out: they fill the caches
_LEAST_STEPS = FIRST_STEPS + 3

_METHODS: tuple[tuple[type, tuple[str, ...], str], ...] = (
    (ActionExecutor, ("execute",), PHYSICS),
    (CameraRenderer, ("color_and_depth", "depth_and_body_ids", "body_ids"), RENDERING),
    (World, ("capture",), RENDERING),  # with the errors of the sensor
    (World, ("act", "segmentation", "object_states"), TRUTH),  # act: without its other parts
    (DirectTruth, ("segmentation",), TRUTH),
    (FrameAnalyzer, ("judge",), SCORER),
    (TaskExecutor, ("run",), PLANNER),
    (MemoryBus, ("publish", "call"), MESSAGES),
    (WorldThread, ("state",), MESSAGES),
)
_SERVICES = {
    "helios_detector": DETECTOR,
    "helios_objectmap": OBJECT_MAP,
    "helios_map2d": MAPS_2D,
    "helios_planner": PLANNER,
    "helios_bridge": MESSAGES,
    "helios_core": MESSAGES,
}


def measure(spec: EpisodeSpec) -> NDArray[np.float64]:
    """CPU milliseconds [steps, parts] of an episode, in the order of `PARTS`.

    Raises HeliosError if it cannot be played, and InvalidInput if it is too short.
    """
    clock = PartClock()
    marks: list[tuple[float, ...]] = []

    def mark() -> None:
        clock.enter(clock.enter(REST))
        marks.append(tuple(clock.seconds.values()))

    with measured_parts(clock, mark):
        play(spec, commit="")
    if len(marks) <= _LEAST_STEPS:
        raise InvalidInput(
            f"the episode of home {spec.seed} has {len(marks)} steps, wanted more than "
            f"{_LEAST_STEPS}; take another home"
        )
    return np.diff(np.array(marks), axis=0)[FIRST_STEPS:] * 1e3


def summary(costs: Sequence[NDArray[np.float64]]) -> dict[str, dict[str, float]]:
    """Part, or "all" -> mean milliseconds per step: over `all`, the `first` and the `last` third.

    costs: [steps, parts] of each episode.
    """
    thirds = [np.array_split(cost, 3) for cost in costs]
    windows = {
        "all": np.concatenate(costs),
        "first": np.concatenate([third[0] for third in thirds]),
        "last": np.concatenate([third[-1] for third in thirds]),
    }
    means = {name: rows.mean(axis=0) for name, rows in windows.items()}
    out = {
        part: {name: round(float(mean[k]), 3) for name, mean in means.items()}
        for k, part in enumerate(PARTS)
    }
    out["all"] = {name: round(float(mean.sum()), 3) for name, mean in means.items()}
    return out


class PartClock:
    """CPU seconds of this process by part. Not for parts that run at the same time."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(PARTS, 0.0)
        self._part, self._since_s = REST, time.process_time()

    def enter(self, part: str) -> str:
        """Count for `part` from now on; return the part before it."""
        now_s = time.process_time()
        before = self._part
        self.seconds[before] += now_s - self._since_s
        self._part, self._since_s = part, now_s
        return before

    def counted(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        """The function, whose time counts for `part`."""

        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            before = self.enter(part)
            try:
                return function(*args, **kwargs)
            finally:
                self.enter(before)

        return timed


@contextmanager
def measured_parts(clock: PartClock, on_action: Callable[[], None]) -> Iterator[None]:
    """Count the time of every part for the duration of the block.

    Build worlds and stacks inside the block. on_action: called before each action of the world.
    """
    with ExitStack() as stack:

        def patch(owner: object, name: str, function: Callable[..., Any]) -> None:
            stack.enter_context(mock.patch.object(owner, name, function))

        for owner, names, part in _METHODS:
            for name in names:
                patch(owner, name, clock.counted(getattr(owner, name), part))
        patch(World, "act", _announced(World.act, on_action))
        for name in ("subscribe", "subscribe_in_place", "serve"):
            patch(MemoryBus, name, _with_counted_handler(clock, getattr(MemoryBus, name)))
        for module, name, function in _codec_functions():
            patch(module, name, clock.counted(function, MESSAGES))
        yield


def _announced(act: Callable[..., Any], on_action: Callable[[], None]) -> Callable[..., Any]:
    def announced(*args: Any, **kwargs: Any) -> Any:
        on_action()
        return act(*args, **kwargs)

    return announced


def _with_counted_handler(clock: PartClock, register: Callable[..., Any]) -> Callable[..., Any]:
    """`subscribe` or `serve`, whose handlers count for the service that they belong to."""

    def registered(bus: MemoryBus, topic: Any, handler: Callable[..., Any]) -> Any:
        package = inspect.unwrap(handler).__module__.split(".")[0]
        return register(bus, topic, clock.counted(handler, _SERVICES.get(package, REST)))

    return registered


def _codec_functions() -> Iterator[tuple[object, str, Callable[..., Any]]]:
    """(module, name, function) of every import of a conversion to or from messages."""
    for name, module in list(sys.modules.items()):
        if name.startswith("helios_") and not name.startswith(codec.__name__):
            for key, value in list(vars(module).items()):
                if inspect.isfunction(value) and value.__module__.startswith(codec.__name__):
                    yield module, key, value
