"""Tracking of one task in a home: candidate objects, goal receptacles, progress and events."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_sim.episode_events import Collided, Event, PickTried, PlaceTried
from helios_sim.home import Episode, Home
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.task_sampling import AMBIGUOUS, NoTask
from helios_sim.navigable_area import NavigableArea, Points
from helios_sim.objectnav_metrics import MIN_SHORTEST_M
from helios_sim.ovmm_metrics import (
    Progress,
    ReleaseResult,
    Step,
    Targets,
    advance,
    placed,
    viewpoints_of,
)

_CELL_M = 0.05


def episode_of(home: Home, seed: int) -> Episode:
    """Move task that a seed selects in this home."""
    return home.sample_episode(np.random.default_rng([seed, 0x7A5C]))


def reachable(
    home: Home, radius_m: float, cell_m: float = _CELL_M
) -> tuple[NDArray[np.bool_], tuple[float, float]]:
    """Mask [row, column] of cells that a disc can reach from the start pose, and its origin (m)."""
    free, origin_m = home.free_space(radius_m, cell_m)
    _, labels = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    row = int((home.start_pose[1] - origin_m[1]) / cell_m)
    column = int((home.start_pose[0] - origin_m[0]) / cell_m)
    return (labels == labels[row, column]) & free, origin_m


def navigable_area_of(home: Home, radius_m: float) -> NavigableArea:
    """Area that a disc can reach from the start pose."""
    free, origin_m = reachable(home, radius_m)
    return NavigableArea(free, origin_m, _CELL_M)


def objectnav_episode_of(home: Home, seed: int, radius_m: float) -> Episode:
    """Object-navigation task, such as "Find the sofa".

    The class is any furniture of the home that a catalog names and whose nearest viewpoint is at
    least 1 m from the start. Raises NoTask if there is none.
    """
    ground = navigable_area_of(home, radius_m)
    furniture = {item.class_name for item in home.receptacles}
    furniture |= {item.class_name for item in home.fixtures if item.blocks}
    known = {name for c in CATALOGS.values() for name in (*c.receptacles, *c.fixtures)}
    names = sorted(furniture & known - AMBIGUOUS)
    np.random.default_rng([seed, 0x0B1A]).shuffle(names)
    for name in names:
        episode = Episode(name, "", "", f"Find the {name}")
        if MIN_SHORTEST_M <= shortest_path_m(home, targets_of(home, episode, ground)) < np.inf:
            return episode
    raise NoTask(f"home {home.seed} has no furniture at least 1 m from the start; take another")


def shortest_path_m(home: Home, targets: Targets) -> float:
    """Geodesic distance (m) from the start to the nearest candidate viewpoint; inf without any."""
    viewpoints = np.concatenate([np.empty((0, 2)), *targets.objects.values()])
    return targets.ground.shortest_m(home.start_pose[:2], viewpoints)


def targets_of(home: Home, episode: Episode, ground: NavigableArea) -> Targets:
    """Candidates and goals of a task, with their viewpoints.

    A task without a start receptacle is object navigation: all movable objects and all furniture
    of the class are candidates.
    """

    def around(x: float, y: float, yaw_rad: float, size_m: tuple[float, float, float]) -> Points:
        c, s = abs(np.cos(yaw_rad)), abs(np.sin(yaw_rad))
        half = np.array([c * size_m[0] + s * size_m[1], s * size_m[0] + c * size_m[1]]) / 2
        low, high = np.array([x, y]) - half, np.array([x, y]) + half
        box = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
        return viewpoints_of(*box, ground)

    objects = {
        thing.name: around(*thing.position_m[:2], thing.yaw_rad, thing.size_m)
        for thing in home.objects
        if thing.class_name == episode.object_class
        and episode.start_receptacle_class in ("", home.receptacle(thing.receptacle).class_name)
    }
    if not episode.start_receptacle_class:
        objects |= {
            item.name: around(item.x, item.y, item.yaw_rad, item.size_m)
            for item in (*home.receptacles, *home.fixtures)
            if item.class_name == episode.object_class
        }
    goals = {
        item.name: around(item.x, item.y, item.yaw_rad, item.size_m)
        for item in home.receptacles
        if item.class_name == episode.goal_receptacle_class
    }
    return Targets(objects, goals, ground)


class EpisodeTracker:
    """Updates the metrics after every action and records ground-truth events.

    It requests image coverage only where the coverage can change the metrics.
    """

    def __init__(self, home: Home, episode: Episode, radius_m: float) -> None:
        self.episode = episode
        self.targets = targets_of(home, episode, navigable_area_of(home, radius_m))
        self.progress = Progress()
        self.events: list[Event] = []
        self.track_m: list[tuple[float, float]] = [(home.start_pose[0], home.start_pose[1])]
        self._home = home

    def arrived(self) -> bool:
        """True if the base is where object navigation succeeds; see `objectnav_metrics`."""
        return any(self.targets.at(self.track_m[-1], name) for name in self.targets.objects)

    def shortest_path_m(self) -> float:
        """Distance (m) from the start to the nearest candidate viewpoint; inf without any."""
        return shortest_path_m(self._home, self.targets)

    def targets_needing_coverage(
        self, base_xy_m: tuple[float, float], held: str
    ) -> tuple[str, ...]:
        """Names of targets whose image coverage can change the metrics at this base position. An
        object in the hand is not found by looking at it."""
        now = self.progress
        asked = {n: p for n, p in self.targets.objects.items() if not now.find_object and n != held}
        if not now.find_receptacle and (now.pick or held in self.targets.objects):
            asked |= self.targets.goals
        return tuple(name for name in asked if self.targets.at(base_xy_m, name))

    def record_step(
        self,
        base_xy_m: tuple[float, float],
        coverage: dict[str, float],
        held: str,
        collided_with: frozenset[str],
        moved_m: float,
        released: ReleaseResult | None = None,
    ) -> None:
        """Update the metrics after one action."""
        step = Step(base_xy_m, coverage, held, released, collided_with, moved_m)
        self.progress = advance(self.progress, step, self.targets)
        self.track_m.append(base_xy_m)
        if collided_with:
            self.events.append(Collided(self.progress.steps, tuple(sorted(collided_with))))

    def pick_tried(self, asked_class: str, near: frozenset[str], name: str, reason: str) -> None:
        """Record a pick attempt. near: objects within grasp of the requested point."""
        self.events.append(
            PickTried(
                step=self.progress.steps + 1,
                path_m=self.progress.path_m,
                asked_class=asked_class,
                at_candidate=not near.isdisjoint(self.targets.objects),
                name=name,
                class_name=self._class_of(name),
                candidate=name in self.targets.objects,
                reason=reason,
            )
        )

    def place_tried(self, name: str, released: ReleaseResult | None, reason: str) -> None:
        """Record a place attempt. released: None if the place was refused."""
        tried = PlaceTried(
            step=self.progress.steps + 1,
            path_m=self.progress.path_m,
            name=name,
            class_name=self._class_of(name),
            candidate=name in self.targets.objects,
            released=released is not None,
            reason=reason,
        )
        if released is not None:
            tried = replace(
                tried,
                at_rest=released.at_rest,
                on=tuple(sorted(released.on)),
                met_goal=not released.met.isdisjoint(self.targets.goals),
                placed=placed(released, self.targets),
                on_floor=any(self._class_of(body) == "floor" for body in released.on),
                height_m=released.height_m,
            )
        self.events.append(tried)

    def _class_of(self, name: str) -> str:
        """Class of a body of the home; empty for any other name.

        The robot's own bodies occur because an object may fall onto its base.
        """
        return self._home.class_of(name) if name in self._home.body_names() else ""
