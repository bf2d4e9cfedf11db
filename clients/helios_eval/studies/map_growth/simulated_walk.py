"""Frames of a robot that walks through a simulated home, with ground-truth detections.

A walk is recorded once and can be replayed anywhere: the map sees only frames and poses, so the
same home at another location is a new home. Frames are reduced to the grid of pixels that a map
with that stride uses; a map with stride 1 then gives the same result.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from helios_core.geometry import Matrix, Pinhole
from helios_core.robot import Action, ActionResult, Capture
from helios_core.types import Frame, FrameId, Observation, Role, SearchClass, SearchContext
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
from helios_detector.simulator_truth import Truth
from helios_objectmap.camera import View, offset
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.world import World
from numpy.typing import NDArray

from helios_eval.episodes import home_presets
from helios_eval.episodes.in_process_stack import truth_of

BOOT_ID = "walk"
STEP_NS = 1_000_000_000  # one frame per second of robot time
SURE = 0.5  # threshold that every ground-truth detection exceeds


@dataclass(frozen=True)
class Walk:
    """Observations of a walk through a home, in order, with everything detected."""

    receptacles: tuple[str, ...]  # classes in the home
    things: tuple[str, ...]
    observations: tuple[Observation, ...]

    def again(self, x_m: float, first_seq: int, context_id: str) -> Iterator[Observation]:
        """The same walk with the home moved along x, and with other frame numbers."""
        T = np.eye(4)
        T[0, 3] = x_m
        for k, o in enumerate(self.observations):
            yield _moved(o, T, first_seq + k, context_id)


def context_of(id: str, receptacles: Sequence[str], things: Sequence[str]) -> SearchContext:
    """Search context for these classes."""
    sought = [SearchClass(name, Role.OBJECT, SURE) for name in things]
    sought += [SearchClass(name, Role.START_RECEPTACLE, SURE) for name in receptacles]
    return SearchContext(id, tuple(sought))


def record(preset: str, seed: int, frames: int, stride_px: int) -> Walk:
    """Walk between random points of the home of a seed; record a frame after each action."""
    home = home_presets.home_of(preset, seed)
    receptacles = tuple(sorted({r.class_name for r in home.receptacles}))
    things = tuple(sorted({o.class_name for o in home.objects} - set(receptacles)))
    context = context_of("walk", receptacles, things)
    observations: list[Observation] = []

    def see(capture: Capture, truth: Truth) -> None:
        frame = Frame(
            FrameId(BOOT_ID, 0, len(observations)),
            capture.stamp_ns,
            True,
            capture.color,
            capture.depth_m,
            capture.camera,
            capture.T_world_cam,
            capture.T_world_base,
        )
        found = GroundTruthDetector(_Known(truth)).detect(frame, context).detections
        seen = Observation(frame, context.id, found, {}, "ground-truth")
        observations.append(strided(seen, stride_px))
        if len(observations) >= frames:
            raise _Enough

    world = _SeenWorld(home, see)
    try:
        with contextlib.suppress(_Enough):
            _wander(world, np.random.default_rng(seed))
    finally:
        world.close()
    return Walk(receptacles, things, tuple(observations))


def strided(observation: Observation, stride_px: int) -> Observation:
    """Observation reduced to the pixels that a map with this stride uses."""
    seen, c = observation.frame, observation.frame.camera
    first = offset(stride_px)
    grid = (slice(first, None, stride_px), slice(first, None, stride_px))
    view = View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, seen.T_world_cam).strided(stride_px)
    frame = replace(
        seen,
        color=seen.color[grid].copy(),
        depth_m=seen.depth_m[grid].copy(),
        camera=Pinhole(view.fx, view.fy, view.cx, view.cy, view.width, view.height),
    )
    masks = [d.mask[grid].copy() for d in observation.detections]
    found = tuple(
        replace(d, mask=mask, box_xyxy=_box_of(mask))
        for d, mask in zip(observation.detections, masks, strict=True)
        if mask.any()
    )
    return replace(observation, frame=frame, detections=found)


def _box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    v, u = np.nonzero(mask)
    return int(u.min()), int(v.min()), int(u.max()) + 1, int(v.max()) + 1


class _Enough(Exception):
    """Raised when all frames are recorded."""


@dataclass(frozen=True)
class _Known:
    """Ground-truth source of one frame."""

    truth: Truth

    def segmentation(self, stamp_ns: int) -> Truth:
        return self.truth

    def check(self) -> None:
        """Ground truth is always available."""


class _SeenWorld(World):
    """World that reports capture and ground truth after each action of its robot."""

    def __init__(self, home: Home, see: Callable[[Capture, Truth], None]) -> None:
        super().__init__(home, boot_id=BOOT_ID)
        self._see = see

    def act(self, action: Action, action_id: str) -> ActionResult:
        result = super().act(action, action_id)
        capture = self.capture()
        self._see(capture, truth_of(self.segmentation(capture.stamp_ns)))
        return result


def _wander(world: World, rng: np.random.Generator) -> None:
    """Drive to random points and to each receptacle in turn, until an exception ends it."""
    guide = GroundTruthSolver(world)
    low_x, low_y, high_x, high_y = world.home.bounds
    names = [r.name for r in world.home.receptacles]
    while True:
        for name in rng.permutation(names).tolist():
            guide.go_near((rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)))
            guide.approach(name)


def _moved(observation: Observation, T: Matrix, seq: int, context_id: str) -> Observation:
    """Observation as if the world had been moved by T."""
    seen = observation.frame
    frame = replace(
        seen,
        id=FrameId(BOOT_ID, 0, seq),
        stamp_ns=seq * STEP_NS,
        T_world_cam=T @ seen.T_world_cam,
        T_world_base=T @ seen.T_world_base,
    )
    return replace(observation, frame=frame, context_id=context_id)
