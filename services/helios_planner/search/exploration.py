"""Exploration task: drive to the nearest border of the known floor until none is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from helios_core.printable_text import counted

from helios_planner.decisions.decision import Decision, Do
from helios_planner.decisions.global_search import ExplorationOption, nearest_by_way
from helios_planner.match_radii import SAME_PLACE_M
from helios_planner.motion_planning.costmap import SPECK_M2, facing
from helios_planner.motion_planning.path_planner import Reach
from helios_planner.motion_planning.unknown_borders import Border, borders_of, floor_m2
from helios_planner.navigation.base_controller import BaseController, Outcome
from helios_planner.navigation.point_goal import point_text
from helios_planner.search.base import FRONTIER_REACH_M
from helios_planner.settings import Settings
from helios_planner.task import Phase

MIN_BORDER_M = 0.4  # shorter edges of the known floor are not explored
NAMED = 3  # unseen places in the closing message

XY = tuple[float, float]


class Exploration:
    """Exploration of one task. `given_up`: middles of borders that remained after a look."""

    def __init__(self, base: BaseController, settings: Settings) -> None:
        self._base, self._robot, self._settings = base, base.robot, settings
        self.given_up: list[XY] = []
        self._ids: list[XY] = []  # middles of all borders so far; the index + 1 is a border's id
        self._before_m2: float | None = None  # known floor at the start
        self._now_m2 = 0.0
        self._left: list[XY] = []  # borders that remain
        self._cached: tuple[tuple[str, int] | None, list[Border]] = (None, [])

    def checkpoint(self) -> dict[str, Any]:
        """State as JSON, for `restore`."""
        return {
            "borders_given_up": [list(xy) for xy in self.given_up],
            "borders": [list(xy) for xy in self._ids],
            "before_m2": self._before_m2,
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.given_up = [(x, y) for x, y in checkpoint["borders_given_up"]]
        self._ids = [(x, y) for x, y in checkpoint["borders"]]
        self._before_m2 = checkpoint["before_m2"]

    def run(self) -> None:
        """Explore until every border that can be reached was looked at."""
        self._note()
        while self._step():
            self._note()

    def said(self) -> str:
        """Message about the known floor so far."""
        new_m2 = max(0.0, self._now_m2 - (self._before_m2 or 0.0))  # known floor may become unknown
        return f"{self._now_m2:.1f} m² of floor are known, {new_m2:.1f} m² of them new"

    def said_at_end(self) -> str:
        """Closing message, with the places that could not be looked at."""
        if not self._left:
            return f"{self.said()}; nothing reachable is unknown"
        named = ", ".join(point_text(xy).removesuffix(" m") for xy in self._left[:NAMED])
        more = len(self._left) - NAMED
        rest = f" and {more} more" if more > 0 else ""
        return (
            f"{self.said()}; nothing else that can be reached is unknown; could not see past "
            f"{named} m{rest}"
        )

    def said_left(self) -> str:
        """Part of the message of an exploration that is cut short."""
        n = len(self._left)
        return f"{counted(n, 'place')} {'is' if n == 1 else 'are'} left to look at"

    def begin(self) -> bool:
        """Record the known floor before the first look; True if there is any border."""
        self._note()
        return bool(self._left)

    # --- one border ----------------------------------------------------------------------------
    def _note(self) -> None:
        ground = self._robot.ground()
        self._now_m2 = floor_m2(ground)
        if self._before_m2 is None:
            self._before_m2 = self._now_m2
        self._left = [b.xy_m for b in self._borders()]

    def _step(self) -> bool:
        decision = nearest_by_way(self._options())
        self._robot.listener.on_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            return self._clear_way()
        self._tell(decision)
        self._visit(decision.chosen.position_m[:2])
        return True

    def _tell(self, decision: Decision) -> None:
        message = f"{decision.why}; {self.said()}"
        self._robot.listener.on_phase(Phase.EXPLORE, "unknown floor", message)

    def _borders(self) -> list[Border]:
        ground = self._robot.ground()
        if self._cached[0] != ground.identity:
            self._cached = ground.identity, borders_of(ground, MIN_BORDER_M, SPECK_M2)
        return self._cached[1]

    def _open(self) -> list[Border]:
        return [
            b
            for b in self._borders()
            if all(math.dist(b.xy_m, g) > SAME_PLACE_M for g in self.given_up)
        ]

    def _options(self) -> list[ExplorationOption]:
        """Borders that can be driven near to, with the widest margin that reaches any."""
        borders = self._open()
        for level in self._base.levels:
            reached = self._base.reach(level)
            options = [o for b in borders if (o := self._option(b, reached)) is not None]
            if options:
                return options
        return []

    def _option(self, border: Border, reached: Reach) -> ExplorationOption | None:
        place = reached.nearest(border.xy_m, FRONTIER_REACH_M)
        if place is None:
            return None
        way_m = _way_m(reached, place) + math.dist(place, border.xy_m)
        distance_m = self._robot.pose().distance_m(border.xy_m)
        return ExplorationOption(
            self._id(border.xy_m), border.xy_m, border.size_m, way_m, distance_m
        )

    def _id(self, xy_m: XY) -> int:
        """Number of a border, from 1; one at the place of an earlier border keeps its number."""
        for k, known in enumerate(self._ids, start=1):
            if math.dist(known, xy_m) <= SAME_PLACE_M / 2:
                return k
        self._ids.append(xy_m)
        return len(self._ids)

    def _there(self, xy_m: XY) -> bool:
        return any(math.dist(b.xy_m, xy_m) <= SAME_PLACE_M for b in self._borders())

    def _visit(self, xy_m: XY) -> None:
        """Drive near a border and look at it until it is gone; give it up if it remains."""
        base, near = self._base, self._place_near(xy_m)
        if near is not None:
            goal = facing(*near, xy_m)
            outcome = base.go_to(goal, "explore", lambda: not self._there(xy_m))
            if outcome is Outcome.INTERRUPTED:
                return
            if self._there(xy_m):
                pose = self._robot.pose()
                base.turn_to(pose.yaw_rad + pose.bearing_rad(xy_m))
            if self._there(xy_m):
                base.look_down_around()
        if self._there(xy_m):
            self.given_up.append(xy_m)

    def _place_near(self, xy_m: XY) -> XY | None:
        reaches = (self._base.reach(level) for level in self._base.levels)
        return next(
            (p for r in reaches if (p := r.nearest(xy_m, FRONTIER_REACH_M)) is not None), None
        )

    def _clear_way(self) -> bool:
        """Look at unknown ground that blocks the path to a border, when none is in reach; False if
        there is none."""
        pose = self._robot.pose()
        targets: Sequence[XY] = sorted((b.xy_m for b in self._open()), key=pose.distance_m)
        return any(self._base.clear_way(xy_m, FRONTIER_REACH_M) for xy_m in targets)


def _way_m(reached: Reach, place: XY) -> float:
    """Length of the path to a place, in metres at full speed: narrow stretches count more."""
    ((row, column),) = reached.ground.cells_of(np.array([place]))
    return float(reached.arrival[row, column]) * reached.ground.cell_m
