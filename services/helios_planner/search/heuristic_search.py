"""Searches of HomeRobot's heuristic agent (Yenamandra et al. 2023), on detections.

Its map remembers every detection. The object counts where a start receptacle was detected under it.
Until then the agent goes to the nearest detected part of a start receptacle that it has not been
near, and without one to the nearest frontier. A goal receptacle counts whenever it was detected.
Nearest means the shortest path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.decisions import explanations
from helios_planner.decisions.acceptance import Candidate, best_of
from helios_planner.decisions.decision import Decision, DecisionRule, Do
from helios_planner.decisions.global_search import nearest
from helios_planner.motion_planning.base_placement import outline_of
from helios_planner.motion_planning.costmap import facing
from helios_planner.search.base import SearchTools
from helios_planner.search.baselines import TrustingSearch
from helios_planner.search.frontier_exploration import RuleExplorer
from helios_planner.search.object_search import is_on_any
from helios_planner.task import Phase

CLOSE_M = 1.0  # the robot has been near a place within this distance of its path (HomeRobot's)
PART_M = 0.2  # spacing of the considered parts of a receptacle's outline
BEEN_M = 0.1  # spacing of the recorded places
NEW_M = 0.5  # a part this far from all known ones is new

XY = tuple[float, float]


class HeuristicSearch(TrustingSearch):
    """Search of the heuristic agent, for the object or for the goal receptacle."""

    remembers: ClassVar[bool] = True

    def __init__(
        self,
        tools: SearchTools,
        phase: Phase,
        name: str,
        start: str | None = None,
        not_at: np.ndarray | None = None,
    ) -> None:
        """start: class of the receptacle on which the object lies; None if the task names none."""
        super().__init__(tools, phase, name, partial(RuleExplorer, rule=nearest), not_at)
        self.start = start
        self._been: list[XY] = []

    def reported(self) -> list[ObjectInstance]:
        """Reported objects, only those on a detected start receptacle if the task names one."""
        things = super().reported()
        if self.start is None:
            return things
        starts = self.belief.known(self.start)
        return [thing for thing in things if is_on_any(thing, starts)]

    def explore(self) -> bool:
        parts = self._parts()
        decision = self._nearest_part(parts)
        if decision is None:
            known = [xy for _, xy in parts]
            return self._explorer.step(lambda: bool(self.reported()) or self._is_new(known))
        self.robot.listener.on_decision(decision)
        self.tell(decision.why)
        self._go_near(decision.chosen)
        return True

    def next_round(self) -> None:
        self._been.clear()
        super().next_round()

    def checkpoint(self) -> dict[str, Any]:
        return super().checkpoint() | {"been": self._been}

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        super().restore(checkpoint)
        self._been = [(x, y) for x, y in checkpoint["been"]]

    # --- start receptacles ---------------------------------------------------------------------
    def _parts(self) -> list[tuple[ObjectInstance, XY]]:
        """Parts of detected start receptacles that the robot has not been near."""
        here = self.robot.pose().xy
        if all(math.dist(here, b) > BEEN_M for b in self._been):
            self._been.append(here)
        starts = [] if self.start is None else self.belief.known(self.start)
        return [
            (thing, xy)
            for thing in starts
            for xy in parts_of(thing)
            if all(math.dist(xy, b) > CLOSE_M for b in self._been)
        ]

    def _is_new(self, known: Sequence[XY]) -> bool:
        """True if there is a part away from all known ones."""
        return any(all(math.dist(xy, k) > NEW_M for k in known) for _, xy in self._parts())

    def _nearest_part(self, parts: Sequence[tuple[ObjectInstance, XY]]) -> Decision | None:
        """Decision for the part with the shortest path; None if none is in reach."""
        pose = self.robot.pose()
        ways: dict[int, Candidate] = {}  # the nearest part of each receptacle
        for thing, xy in parts:
            way_m = self._way_m(xy)
            if way_m is None or (thing.id in ways and ways[thing.id].terms["way_m"] <= way_m):
                continue
            terms = {"way_m": way_m, "distance_m": pose.distance_m(xy), "total": -way_m}
            at = (*xy, float(thing.center_m[2]))
            ways[thing.id] = Candidate("receptacle", thing.class_name, at, terms, thing.id)
        if not ways:
            return None
        candidates = tuple(ways.values())
        k = best_of(candidates)
        why = explanations.unvisited_receptacle(candidates, k)
        return Decision(DecisionRule.NEAREST_RECEPTACLE, Do.SEARCH_RECEPTACLE, candidates, k, why)

    def _place_near(self, xy_m: XY) -> tuple[XY, float] | None:
        """Reachable place nearest to a part, and the length of the path to it; None without one."""
        for level in self.base.levels:
            reached = self.base.reach(level)
            place = reached.nearest(xy_m, CLOSE_M)
            if place is not None:
                return place, float(reached.at(np.array([place]))[0]) * reached.ground.cell_m
        return None

    def _way_m(self, xy_m: XY) -> float | None:
        near = self._place_near(xy_m)
        return None if near is None else near[1]

    def _go_near(self, part: Candidate) -> None:
        """Drive to a part until the robot is near it or the object is reported. The part then
        counts as visited, reached or not."""
        xy = part.position_m[:2]
        near = self._place_near(xy)
        if near is not None:
            place, _ = near

            def enough() -> bool:
                self._parts()  # records the place
                return self.robot.pose().distance_m(xy) <= CLOSE_M or bool(self.reported())

            self.base.go_to(facing(*place, xy), f"look for the {self.name}", enough)
        if not self.reported():
            self._been.append(xy)


def parts_of(receptacle: ObjectInstance) -> list[XY]:
    """Points on a receptacle's outline, at most `PART_M` apart, and its middle."""
    corners = outline_of(receptacle)
    x, y = corners.mean(axis=0)
    points = [(float(x), float(y))]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        steps = max(1, math.ceil(math.dist(a, b) / PART_M))
        points += [(float(p[0]), float(p[1])) for p in np.linspace(a, b, steps, endpoint=False)]
    return points
