"""Plays one episode in this process and returns its record."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.geometry import invert
from helios_core.map_snapshot import FREE, OCCUPIED
from helios_core.types import ObjectInstance
from helios_detector.service import PREVIEW_QUALITY
from helios_planner.decisions.decision import DecisionRule
from helios_sim.episode_events import PickTried
from helios_sim.failure_causes import OBJECT_NOT_FOUND, STEP_BUDGET, AgentReport
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.sensor_noise import SENSORS
from helios_sim.simulation_thread import WorldThread
from numpy.typing import NDArray

from helios_eval import kernel_compilation
from helios_eval.episodes import home_presets
from helios_eval.episodes.belief_truth import Role, judge_instances
from helios_eval.episodes.episode_judgement import episode_for, verdict
from helios_eval.episodes.episode_record import AbsenceEstimate, Belief, EpisodeRecord
from helios_eval.episodes.episode_spec import WALKER, EpisodeSpec
from helios_eval.episodes.failure_snapshot import FailureSnapshot, MarkedObject
from helios_eval.episodes.in_process_stack import InProcessStack
from helios_eval.episodes.timed_world import TimedWorld
from helios_eval.episodes.worker import as_in_a_worker

BELIEFS_EVERY = 20  # steps
LONGEST_S = 7200.0  # after this a stuck episode ends as a system error
SHOWN_CLASS_SCORE = 0.3  # least class score of beliefs in a failure snapshot
_PLAN_CELL_M = 0.05


@dataclass(frozen=True)
class PlayedEpisode:
    """Record of an episode, and after a failure the snapshot for its picture."""

    record: EpisodeRecord
    snapshot: FailureSnapshot | None = None


@dataclass(frozen=True)
class _Floor:
    """2D map as a failure snapshot stores it."""

    occupancy: NDArray[np.int8]
    origin_m: tuple[float, float]
    cell_m: float


@dataclass(frozen=True)
class _Outcome:
    """Result of the task as the agent reports it."""

    state: str
    message: str
    cause: str
    wall_s: float
    floor: _Floor
    stage_ms: Mapping[str, float]
    beliefs: tuple[Belief, ...] = ()
    believed: tuple[ObjectInstance, ...] = ()
    absence: tuple[AbsenceEstimate, ...] = ()


def play(spec: EpisodeSpec, commit: str) -> PlayedEpisode:
    """Play an episode. Raises HeliosError if it cannot be played."""
    if spec.agent != WALKER:
        kernel_compilation.warm_up()  # before the episode's CPU time begins
    began_s = time.process_time()
    home = home_presets.home_of(spec.preset, spec.seed, spec.inputs.plans)
    thread = WorldThread(lambda: make_world(spec, home, spec.colored))
    try:
        world = thread.run(_timed_world)
        said = (
            thread.run(lambda _: _walk(world, spec.max_steps))
            if spec.agent == WALKER
            else _live(spec, thread)
        )
        played = thread.run(lambda _: _played(spec, commit, world, said))
    finally:
        thread.close()
    cpu_s = round(time.process_time() - began_s, 3)
    return replace(played, record=played.record.model_copy(update={"cpu_s": cpu_s}))


def make_world(spec: EpisodeSpec, home: Home, colored: bool = True) -> TimedWorld:
    """World of an episode; call it on the thread that will use it. colored: as for `World`."""
    episode = episode_for(
        spec.benchmark, home, spec.seed, spec.target_absent, spec.inputs.task_classes
    )
    return TimedWorld(
        home,
        episode,
        boot_id="evaluation",
        sensor=SENSORS[spec.sensor],
        pick_rule=spec.pick_rule,
        colored=colored,
    )


@contextmanager
def running_stack(
    spec: EpisodeSpec, colored: bool = True
) -> Iterator[tuple[WorldThread, InProcessStack]]:
    """World of an episode and stack of its agent, for the duration of the block.

    colored: as for `World`. Variables HELIOS_... have no effect. Raises HeliosError.
    """
    with as_in_a_worker():
        home = home_presets.home_of(spec.preset, spec.seed, spec.inputs.plans)
        thread = WorldThread(lambda: make_world(spec, home, colored))
        try:
            with InProcessStack(
                thread,
                spec.agent,
                spec.noise,
                spec.seed,
                spec.settings,
                detector=spec.inputs.detector,
            ) as stack:
                yield thread, stack
        finally:
            thread.close()


def _timed_world(world: object) -> TimedWorld:
    assert isinstance(world, TimedWorld)
    return world


# --- agents -------------------------------------------------------------------------------------
def _walk(world: TimedWorld, max_steps: int) -> _Outcome:
    """Run the walker that knows ground truth; call it on the world's thread."""
    began = time.perf_counter()
    done = GroundTruthSolver(world, max_steps).run()
    wall_s = time.perf_counter() - began
    free, origin_m = world.home.free_space(0.0, _PLAN_CELL_M)
    plan = np.where(free, FREE, OCCUPIED).astype(np.int8)
    if world.episode.absent:
        said = "failed", f"the home has no {world.episode.object_class}", OBJECT_NOT_FOUND
    elif done.place:
        said = "succeeded", "placed it", ""
    elif done.steps >= max_steps:
        said = "failed", f"{max_steps} steps are used up", STEP_BUDGET
    else:
        said = "failed", "knows no other way", ""
    return _Outcome(
        *said,
        wall_s,
        _Floor(plan, origin_m, _PLAN_CELL_M),
        _stages(world),
    )


def _live(spec: EpisodeSpec, thread: WorldThread) -> _Outcome:
    """Run an agent of the planner, with every service."""
    world = thread.run(_timed_world)
    episode = world.episode
    roles: dict[str, Role] = {episode.goal_receptacle_class: "goal"}
    roles |= {episode.start_receptacle_class: "start", episode.object_class: "object"}
    roles.pop("", None)
    beliefs: list[Belief] = []
    absence: list[AbsenceEstimate] = []
    classes = spec.inputs.task_classes
    class_of = classes.class_of if classes is not None else str

    def look(stack: InProcessStack) -> tuple[ObjectInstance, ...]:
        objects = tuple(stack.objects())
        T = invert(thread.run(lambda _: world.T_estimated_true))  # the robot's pose may drift
        R, t = T[:3, :3], T[:3, 3]
        named = [
            replace(o, class_name=class_of(o.class_name), center_m=R @ o.center_m + t)
            for o in objects
        ]
        step = world.progress.steps
        beliefs.extend(judge_instances(named, thread.run(lambda w: w.object_states()), roles, step))
        return objects

    def on_step() -> None:
        if stack is not None and world.progress.steps % BELIEFS_EVERY == 0:
            look(stack)

    def on_decision(decision: pb.Decision) -> None:
        if decision.rule == DecisionRule.ABSENT:
            absence.append(_absence_estimate(decision, world.progress.steps))

    stack: InProcessStack | None = None
    stack = InProcessStack(
        thread,
        spec.agent,
        spec.noise,
        spec.seed,
        spec.settings,
        on_step,
        spec.inputs.detector,
        on_decision,
    )
    with stack:
        began = time.perf_counter()
        task = stack.run(episode.instruction, spec.max_steps, LONGEST_S)
        wall_s = time.perf_counter() - began
        objects = look(stack)
        view = stack.map()
        return _Outcome(
            task.state,
            task.message,
            task.cause,
            wall_s,
            _Floor(view.occupancy, view.origin_m, view.cell_m),
            _stages(world) | stack.stage_ms(),
            tuple(beliefs),
            tuple(o for o in objects if o.class_score >= SHOWN_CLASS_SCORE),
            tuple(absence),
        )


def _absence_estimate(decision: pb.Decision, step: int) -> AbsenceEstimate:
    values = decision.settings
    return AbsenceEstimate(
        step=step,
        searches=int(values["searches"]),
        probability=values["absence_probability"],
        start_score=values["start_score"],
        tried=int(values["tried"]),
        best_score=max((c.terms["total"] for c in decision.candidates), default=0.0),
    )


def _stages(world: TimedWorld) -> dict[str, float]:
    metrics = world.health.metrics()
    return {
        name.removesuffix("_ms_median"): round(value, 3)
        for name, value in metrics.items()
        if name.endswith("_ms_median")
    }


# --- record ---------------------------------------------------------------------------------------
def _played(spec: EpisodeSpec, commit: str, world: TimedWorld, said: _Outcome) -> PlayedEpisode:
    done, episode = world.progress, world.episode
    report = AgentReport(said.state, said.cause, said.message)
    judged_as = verdict(spec.benchmark, world, report, spec.max_steps)
    record = EpisodeRecord(
        benchmark=spec.benchmark, agent=spec.agent, semantics=spec.semantics, preset=spec.preset,
        seed=spec.seed, noise=spec.noise, settings=spec.settings,
        instruction=episode.instruction, object_class=episode.object_class,
        start_receptacle_class=episode.start_receptacle_class,
        goal_receptacle_class=episode.goal_receptacle_class, absent=episode.absent,
        **asdict(judged_as), collisions=done.collisions, collided_with=done.collided_with,
        steps=done.steps, path_m=done.path_m,
        find_object_steps=done.find_object_steps or None,
        find_object_path_m=done.find_object_path_m if done.find_object else None,
        picks=sum(isinstance(event, PickTried) for event in world.events),
        wrong_picks=sum(
            isinstance(event, PickTried) and bool(event.name) and not event.candidate
            for event in world.events
        ),
        state=said.state, message=said.message, reported_cause=said.cause,
        wall_s=round(said.wall_s, 3),
        step_ms=round(statistics.median(world.step_ms), 2) if world.step_ms else 0.0,
        stage_ms=dict(said.stage_ms), beliefs=said.beliefs, absence=said.absence,
        commit=commit, preset_hash=home_presets.digest_of(spec.preset, spec.inputs.plans),
        structure_hash=world.home.structure_hash(), home_file=spec.home_file,
    )  # fmt: skip
    return PlayedEpisode(record, None if record.success else _failure_snapshot(record, world, said))


def _failure_snapshot(record: EpisodeRecord, world: TimedWorld, said: _Outcome) -> FailureSnapshot:
    targets = world.tracker.targets
    return FailureSnapshot(
        key=record.key, agent=record.agent, semantics=record.semantics, seed=record.seed,
        instruction=record.instruction, cause=record.cause, message=record.message,
        occupancy=said.floor.occupancy, origin_m=said.floor.origin_m, cell_m=said.floor.cell_m,
        trajectory_m=world.trajectory_m, start_pose=world.home.start_pose,
        candidates=_true(world, targets.objects), goals=_true(world, targets.goals),
        beliefs=tuple(
            MarkedObject(
                o.class_name, _triple(o.center_m), _triple(o.size_m), o.score, o.class_score
            )
            for o in said.believed
        ),
        camera_jpeg=_jpeg(world.color_image()),
    )  # fmt: skip


def _jpeg(rgb: NDArray[np.uint8]) -> bytes:
    quality = [cv2.IMWRITE_JPEG_QUALITY, PREVIEW_QUALITY]
    return cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), quality)[1].tobytes()


def _true(world: TimedWorld, names: Mapping[str, object]) -> tuple[MarkedObject, ...]:
    return tuple(
        MarkedObject(thing.name, _triple(thing.center_m), _triple(thing.size_m))
        for thing in world.object_states()
        if thing.name in names
    )


def _triple(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 4) for v in values)
    return x, y, z
