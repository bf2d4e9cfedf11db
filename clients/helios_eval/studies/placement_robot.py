"""A robot in a simulated world on this thread, with the 2D map alone: no bus, no detector."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_core.geometry import Matrix
from helios_core.robot import Action, ActionResult
from helios_core.types import AlignedBox, Frame, FrameId, ObjectInstance
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.parameters import MapRules
from helios_planner.decisions.decision import Decision
from helios_planner.decisions.held_object import HeldObject
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.robot.detections import Sighting
from helios_planner.robot.interface import Frontier, RobotInterface, WhatIf
from helios_planner.task import Cause, Phase, TaskFailed
from helios_sim.world import World
from numpy.typing import NDArray

MOST_STEPS = 150


class NullListener:
    """Listener that ignores all events."""

    def on_phase(self, phase: Phase, seeking: str, message: str) -> None: ...
    def on_decision(self, decision: Decision) -> None: ...
    def on_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None: ...
    def on_picks(self, picks: int) -> None: ...


class SimulatedRobot(RobotInterface):
    """Robot in a simulated world; see the module.

    objects_in_world: the content of its object map.
    """

    listener = NullListener()

    def __init__(self, world: World, objects_in_world: Sequence[ObjectInstance]) -> None:
        self._world, self._objects = world, objects_in_world
        self.description = world.describe()
        pose = self.pose()
        self._start = pose.xy
        rules = MapRules(max_depth_m=min(MapRules.max_depth_m, self.description.max_depth_m))
        self._map = EpochMap(rules, pose.xy, self.description.footprint_radius_m)
        self.steps = 0

    def act(self, action: Action) -> ActionResult:
        if self.steps >= MOST_STEPS:
            raise TaskFailed(Cause.STEP_BUDGET, f"the placement took {self.steps} steps")
        self.steps += 1
        result = self._world.act(action, str(self.steps))
        seen = self._world.capture()
        self._map.integrate_frame(Frame(
            FrameId("placements", 0, self.steps), seen.stamp_ns, True, seen.color, seen.depth_m,
            seen.camera, seen.T_world_cam, seen.T_world_base,
        ))  # fmt: skip
        return result

    def budget_used(self) -> float:
        return min(self.steps / MOST_STEPS, 1.0)

    def pose(self) -> Pose2:
        return Pose2.of(self._world.state().T_world_base)

    def tilt_rad(self) -> float:
        return self._world.state().tilt_rad

    def held(self) -> str:
        return self._world.state().held

    def ground(self) -> GroundMap:
        map_ = self._map.published
        grid = map_.grid
        return GroundMap(map_.occupancy, map_.z_high_m, grid.cell_m, grid.origin_m, map_.version)

    def frontiers(self) -> Sequence[Frontier]:
        return ()

    def start(self) -> tuple[float, float]:
        return self._start

    def objects(self, class_name: str) -> Sequence[ObjectInstance]:
        return [thing for thing in self._objects if thing.class_name == class_name]

    def sightings(self) -> Sequence[Sighting]:
        return ()

    def what_if(
        self,
        id: int,
        class_name: str,
        T_world_cam: Sequence[Matrix],
        joint: bool,
        other_share: float | None = None,
    ) -> WhatIf:
        return WhatIf((), ())

    def held_object(self, class_name: str) -> HeldObject:
        return HeldObject(1.0, 0, ())

    def probability_at(self, class_name: str, boxes: Sequence[AlignedBox]) -> Sequence[float]:
        return [0.5 for _ in boxes]

    def retire(self, id: int, point_m: NDArray[np.float64], reason: str) -> None:
        return
