"""Task of a home and ground-truth verdict on an episode, for each benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_sim.episode_events import PickTried
from helios_sim.episode_tracker import episode_of, objectnav_episode_of
from helios_sim.failure_causes import AgentReport, absent_cause, failure_cause, objectnav_cause
from helios_sim.home import Episode, Home
from helios_sim.home.task_sampling import sample_among
from helios_sim.robot_model import description
from helios_sim.world import World

from helios_eval.episodes.absent_targets import absent_episode_of
from helios_eval.episodes.episode_record import Benchmark
from helios_eval.episodes.task_classes import TaskClasses

PUT_BACK_M = 0.15  # from its first place, of an object that counts as put back
_AMONG = 0x7A5D  # stream of the draw of a task among given classes


@dataclass(frozen=True)
class Verdict:
    """Fields of an episode's record that each benchmark determines in its own way."""

    find_object: bool
    pick: bool
    find_receptacle: bool
    place: bool
    success: bool
    cause: str
    shortest_path_m: float | None = None


def episode_for(
    benchmark: Benchmark,
    home: Home,
    seed: int,
    target_absent: bool = False,
    classes: TaskClasses | None = None,
) -> Episode:
    """Task of a seed. Raises InvalidInput for a home without a possible task.

    target_absent: ask for an object that is not in the home (`ovmm` alone). classes: those that
    the task may ask for (`ovmm` alone, and with a present target); None: every class.
    """
    if classes is not None:
        rng = np.random.default_rng([seed, _AMONG])
        task = sample_among(
            home.receptacles, home.objects, rng, classes.objects, classes.receptacles
        )
        return classes.words(task)
    if benchmark == "ovmm":
        return absent_episode_of(home, seed) if target_absent else episode_of(home, seed)
    return objectnav_episode_of(home, seed, description().footprint_radius_m)


def grasped(world: World) -> frozenset[str]:
    """Names of the objects that the robot grasped."""
    return frozenset(e.name for e in world.events if isinstance(e, PickTried) and e.name)


def put_back(world: World) -> frozenset[str]:
    """Names of the grasped objects that lie where they were at the start of the episode."""
    first_m = {thing.name: thing.position_m for thing in world.home.objects}
    return frozenset(
        name
        for name in grasped(world) - {world.held_name}
        if math.dist(world.position_m(name), first_m[name]) <= PUT_BACK_M
    )


def verdict(benchmark: Benchmark, world: World, said: AgentReport, max_steps: int) -> Verdict:
    """Verdict after the agent has ended; call it on the world's thread."""
    done = world.progress
    if benchmark == "objectnav":
        success = said.state == "succeeded" and world.arrived()
        cause = objectnav_cause(success, done.steps, said, max_steps)
        shortest_m = world.tracker.shortest_path_m()
        return Verdict(done.find_object, False, False, False, success, cause, shortest_m)
    if world.episode.absent:
        all_back = put_back(world) == grasped(world)
        cause = absent_cause(done, world.events, said, max_steps, all_back)
        return Verdict(False, False, False, False, not cause, cause)
    cause = failure_cause(done, world.events, said, max_steps, put_back(world))
    shortest_m = world.tracker.shortest_path_m()
    return Verdict(
        done.find_object,
        done.pick,
        done.find_receptacle,
        done.place,
        done.success,
        cause,
        shortest_m if math.isfinite(shortest_m) else None,
    )
