"""Watches one task in a home: what counts as its object and its goal, and how far it got."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_sim.events import Collided, Event, PickTried, PlaceTried
from helios_sim.home import Episode, Home
from helios_sim.metrics import (
    Points,
    Progress,
    Released,
    Step,
    Targets,
    advance,
    at_viewpoint,
    placed,
    viewpoints_of,
)

_CELL_M = 0.05


def episode_of(home: Home, seed: int) -> Episode:
    """The task that belongs to a seed in this home."""
    return home.sample_episode(np.random.default_rng([seed, 0x7A5C]))


def reachable(
    home: Home, radius_m: float, cell_m: float = _CELL_M
) -> tuple[NDArray[np.bool_], tuple[float, float]]:
    """Cells [row, column] where a disc fits and can get to from the start, and their origin."""
    free, origin_m = home.free_space(radius_m, cell_m)
    _, labels = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    row = int((home.start_pose[1] - origin_m[1]) / cell_m)
    column = int((home.start_pose[0] - origin_m[0]) / cell_m)
    return (labels == labels[row, column]) & free, origin_m


def targets_of(home: Home, episode: Episode, radius_m: float) -> Targets:
    """Candidates and goals of a task, with their viewpoints for a robot of that radius."""
    free, origin_m = reachable(home, radius_m)

    def around(x: float, y: float, yaw_rad: float, size_m: tuple[float, float, float]) -> Points:
        c, s = abs(np.cos(yaw_rad)), abs(np.sin(yaw_rad))
        half = np.array([c * size_m[0] + s * size_m[1], s * size_m[0] + c * size_m[1]]) / 2
        low, high = np.array([x, y]) - half, np.array([x, y]) + half
        return viewpoints_of(
            (float(low[0]), float(low[1])),
            (float(high[0]), float(high[1])),
            free,
            origin_m,
            _CELL_M,
        )

    objects = {
        thing.name: around(*thing.position_m[:2], thing.yaw_rad, thing.size_m)
        for thing in home.objects
        if thing.class_name == episode.object_class
        and home.receptacle(thing.receptacle).class_name == episode.start_receptacle_class
    }
    goals = {
        item.name: around(item.x, item.y, item.yaw_rad, item.size_m)
        for item in home.receptacles
        if item.class_name == episode.goal_receptacle_class
    }
    return Targets(objects, goals)


class Tracker:
    """Feeds the metrics after every action, and keeps what really happened.

    Asks for pictures only where they can count.
    """

    def __init__(self, home: Home, episode: Episode, radius_m: float) -> None:
        self.episode = episode
        self.targets = targets_of(home, episode, radius_m)
        self.progress = Progress()
        self.events: list[Event] = []
        self.track_m: list[tuple[float, float]] = [(home.start_pose[0], home.start_pose[1])]
        self._home = home

    def in_question(self, base_xy_m: tuple[float, float], held: str) -> tuple[str, ...]:
        """Names of which the coverage of the image matters here and now."""
        now = self.progress
        asked = {} if now.find_object else dict(self.targets.objects)
        if not now.find_receptacle and (now.pick or held in self.targets.objects):
            asked |= self.targets.goals
        return tuple(name for name, views in asked.items() if at_viewpoint(base_xy_m, views))

    def note(
        self,
        base_xy_m: tuple[float, float],
        coverage: dict[str, float],
        held: str,
        collided_with: frozenset[str],
        moved_m: float,
        released: Released | None = None,
    ) -> None:
        """Count one action."""
        step = Step(base_xy_m, coverage, held, released, collided_with, moved_m)
        self.progress = advance(self.progress, step, self.targets)
        self.track_m.append(base_xy_m)
        if collided_with:
            self.events.append(Collided(self.progress.steps, tuple(sorted(collided_with))))

    def pick_tried(self, asked_class: str, near: frozenset[str], name: str, reason: str) -> None:
        """Note a pick that is being counted. near: things within a grasp of the asked point."""
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

    def place_tried(self, name: str, released: Released | None, reason: str) -> None:
        """Note a place that is being counted. released: None if it was refused."""
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
        return self._home.class_of(name) if name else ""
