"""Run a search one step at a time, with instances that a test chooses.

The robot does not drive: visits are recorded instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from helios_core.types import ObjectInstance
from helios_planner.decisions import global_search
from helios_planner.decisions.acceptance import paper
from helios_planner.decisions.decision import FrontierOption, ViewOption
from helios_planner.decisions.gain import Gain
from helios_planner.instruction.parser import parse
from helios_planner.motion_planning.base_placement import GazePoint
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import Outcome
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.view_selection import ViewPlanner
from helios_planner.settings import Settings
from helios_planner.tasks.mission import Mission
from planner_flat import flat
from planner_things import Thing

TABLE_XY = (7.0, 5.5)


def instance(thing: Thing, id: int = 0, class_score: float = 0.6, score: float = 0.4) -> Any:
    return ObjectInstance(
        id or thing.id, thing.class_name, thing.center_m, thing.size_m, score, class_score, 0.1, 3,
        100, {}, 0.5, np.empty((0, 2)), 1.0, 0.0,
    )  # fmt: skip


class Looks:
    """Gaze points around a receptacle, given by path length; each is visited once."""

    def __init__(self, ways: Sequence[float], interrupted_after: int = 99) -> None:
        self.left = sorted(ways)
        self.gone_to: list[float] = []
        self.interrupted_after = interrupted_after
        self.then: Callable[[], None] = lambda: None  # after each look
        self.stop: Callable[[], bool] = lambda: False  # the stop condition of the newest look

    def remaining_gaze_points(self, _: ObjectInstance) -> list[GazePoint]:
        return [GazePoint(Pose2(0.0, 0.0, 0.0), 0.0, way) for way in self.left]

    def visit_gaze_points(
        self, candidate: ObjectInstance, purpose: str, stop: Callable[[], bool]
    ) -> bool:
        return ViewPlanner.visit_gaze_points(cast(ViewPlanner, self), candidate, purpose, stop)

    def information_gain(self, *_: object) -> Gain | None:
        return Gain(100.0, 100) if self.left else None

    def go_and_look(
        self, _: ObjectInstance, gaze: GazePoint, purpose: str, stop: Callable[[], bool]
    ) -> Outcome:
        self.stop = stop
        if len(self.gone_to) == self.interrupted_after:
            self.interrupted_after = 99
            return Outcome.INTERRUPTED
        self.gone_to.append(gaze.arrival)
        self.then()
        self.left.remove(gaze.arrival)
        return Outcome.ARRIVED

    def option(
        self, thing: ObjectInstance, *_: object, in_place: bool, **__: object
    ) -> tuple[ViewOption, None]:
        return ViewOption(thing, thing.score, None, 1.0, in_place), None

    def forget(self) -> None:
        return


class Rig:
    """A search for a mug on the coffee table; `known`: the instances in the object map."""

    def __init__(self, looks: Looks | None = None, **settings: Any) -> None:
        self.world = flat()
        self.known: list[ObjectInstance] = []
        self.world.objects = lambda class_name: [
            o for o in self.known if o.class_name == class_name
        ]
        self.settings = Settings(**settings)
        self.tools = Mission(self.world, parse("find the mug"), self.settings).tools
        if looks is not None:
            self.tools.looking = cast(ViewPlanner, looks)
        self.search = ObjectSearch(
            self.tools, "mug", "coffee table", global_search.by_objective, paper
        )
        self.frontiers: list[FrontierOption] = []
        self.visited: list[tuple[float, float]] = []
        self.search.frontier_options = lambda layer: self.frontiers
        self.search.visit_frontier = lambda xy_m, found: self.visited.append(xy_m)

    def offered(self) -> list[int]:
        """Return the ids of the receptacles in the newest decision."""
        return [c.id for c in self.world.decisions[-1].candidates if c.kind == "receptacle"]
