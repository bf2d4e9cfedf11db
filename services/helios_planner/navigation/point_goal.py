"""Driving to a point on the floor, over known ground as far as possible.

Without a known path, unknown ground counts as free until it is seen: the robot drives to where the
known ground ends, looks, and plans again. Unknown ground that remains unknown after a look counts
as a wall from then on, so that another path is tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from helios_core.geometry import wrap_angle

from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.path_planner import Reach
from helios_planner.navigation.base_controller import BaseController, BlockedPath, Outcome
from helios_planner.task import Cause, TaskFailed

MOST_AWAY_M = 100.0  # from the robot to the point; the size of the planner's arrays grows with it
AROUND_M = 1.5  # width of the unknown ground around the map through which a path may lead
WALL_M = 0.3  # radius in which unknown ground counts as a wall after a look
MOST_STAGES = 60  # paths that end at unknown ground, for one point
MOST_TRIES = 3  # failed drives over known ground
FACED_RAD = math.radians(10)  # accepted error of the final heading

XY = tuple[float, float]


class PointGoal:
    """Drives the robot to one point. `on_stage` is called with the end of each known path.

    `walls` are places (x, y) of unknown ground that stayed unknown; they must outlive a restart.
    """

    def __init__(
        self,
        base: BaseController,
        xy_m: XY,
        within_m: float,
        on_stage: Callable[[BlockedPath], None],
    ) -> None:
        """within_m: if the robot cannot stand on the point, the nearest place up to this far from
        it is accepted."""
        self._base, self.xy_m, self._within_m = base, xy_m, within_m
        self._on_stage = on_stage
        self.walls: list[XY] = []

    def checkpoint(self) -> dict[str, Any]:
        """State as JSON, for `restore`."""
        return {"walls": [list(wall) for wall in self.walls]}

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.walls = [(x, y) for x, y in checkpoint["walls"]]

    def drive(self, yaw_rad: float | None, purpose: str) -> float:
        """Drive there and face that heading; returns the remaining distance (m). Raises TaskFailed
        with the reason why the point is out of reach, and the nearest place that is not."""
        base = self._base
        away_m = base.robot.pose().distance_m(self.xy_m)
        if away_m > MOST_AWAY_M:
            raise TaskFailed(
                Cause.UNREACHABLE,
                f"{point_text(self.xy_m)} is {away_m:.0f} m away; the robot is sent "
                f"{MOST_AWAY_M:.0f} m at most",
            )
        tries = stages = 0
        while tries < MOST_TRIES and stages < MOST_STAGES:
            if self._near() is not None:
                tries += 1
                goal, slip_m = self._goal(yaw_rad), self._within_m
                if base.go_to(goal, purpose, slip_m=slip_m, face=False) is Outcome.ARRIVED:
                    self._face(yaw_rad)
                    return base.robot.pose().distance_m(self.xy_m)
                continue
            stages += 1
            if not self._stage():
                break
        raise TaskFailed(Cause.UNREACHABLE, self._why_not())

    def _goal(self, yaw_rad: float | None) -> Pose2:
        """Goal pose; without a given heading, that of the direct line to the point."""
        pose = self._base.robot.pose()
        on_the_way = pose.yaw_rad + pose.bearing_rad(self.xy_m)
        return Pose2(*self.xy_m, on_the_way if yaw_rad is None else yaw_rad)

    def _near(self) -> Reach | None:
        """Reach with the widest margin that leads there over known ground; None without one."""
        reaches = (self._base.reach(level) for level in self._base.levels)
        return next((r for r in reaches if r.nearest(self.xy_m, self._within_m) is not None), None)

    def _stage(self) -> bool:
        """Look at the unknown ground where the known path ends; False when no path is left."""
        base = self._base
        ground = walled(padded_to_point(base.robot.ground(), self.xy_m), self.walls)
        barred = base.way_ends(ground, self.xy_m, self._within_m)
        if barred is None:
            return False
        self._on_stage(barred)
        base.look_past(barred, lambda: self._near() is not None)
        if self._near() is None and not self._seen_past(barred) and base.look_down_around():
            self._seen_past(barred)
        if self._near() is None and not self._seen_past(barred):
            self.walls.append(barred.at)
        return True

    def _seen_past(self, barred: BlockedPath) -> bool:
        """True if the place beyond the known path can be reached now."""
        reached = self._base.reach(self._base.levels[-1])
        return bool(np.isfinite(reached.at(np.array([barred.at])))[0])

    def _face(self, yaw_rad: float | None) -> None:
        if yaw_rad is None:
            return
        self._base.turn_to(yaw_rad)
        pose = self._base.robot.pose()
        least = max(FACED_RAD, self._base.rules.min_turn_rad)
        if abs(wrap_angle(yaw_rad - pose.yaw_rad)) > least:
            raise TaskFailed(
                Cause.UNREACHABLE,
                f"stands at {point_text(pose.xy)} and has no room to turn to "
                f"{math.degrees(yaw_rad):.0f}°; it faces {math.degrees(pose.yaw_rad):.0f}°",
            )

    def _why_not(self) -> str:
        """Reason why the point is out of reach, with the nearest place that is not."""
        base = self._base
        said = state_of(base.robot.ground(), self.xy_m, base.robot.description.inner_radius_m)
        place = nearest_reachable(base.reach(base.levels[-1]), self.xy_m)
        if place is None:
            return f"{point_text(self.xy_m)} {said}"
        return (
            f"{point_text(self.xy_m)} {said}; the nearest place that can be reached is "
            f"{point_text(place)}, {math.dist(place, self.xy_m):.2f} m from it"
        )


def point_text(xy_m: XY) -> str:
    """Text of a point in messages."""
    return f"({xy_m[0]:.2f}, {xy_m[1]:.2f}) m"


def padded_to_point(ground: GroundMap, xy_m: XY) -> GroundMap:
    """Map that also covers the point, with unknown ground all around."""
    rows, columns = ground.occupancy.shape
    x_m, y_m = ground.origin_m
    for x, y in ((x_m, y_m), (x_m + columns * ground.cell_m, y_m + rows * ground.cell_m), xy_m):
        ground = ground.padded(x, y, AROUND_M)
    return ground


def walled(ground: GroundMap, walls: Sequence[XY]) -> GroundMap:
    """Map in which the unknown ground around these places is an obstacle."""
    near = np.zeros(ground.occupancy.shape, np.uint8)
    for row, column in ground.cells_of(np.array(walls).reshape(-1, 2)):
        cv2.circle(near, (int(column), int(row)), round(WALL_M / ground.cell_m), 1, -1)
    blocked = (near != 0) & (ground.occupancy < 0)
    return replace(ground, occupancy=np.where(blocked, np.int8(100), ground.occupancy))


def state_of(ground: GroundMap, xy_m: XY, footprint_m: float) -> str:
    """Reason why the robot cannot stand on a point: the predicate of a sentence about it."""
    cell = ground.cells_of(np.array([xy_m]))
    known = int(ground.occupancy[cell[0, 0], cell[0, 1]]) if ground.inside(cell)[0] else -1
    if known > 0:
        return "is inside an obstacle"
    occupied = ground.centres_of(np.argwhere(ground.occupancy > 0))
    if len(occupied):
        away_m = float(np.hypot(occupied[:, 0] - xy_m[0], occupied[:, 1] - xy_m[1]).min())
        if away_m < footprint_m:
            return (
                f"is {away_m:.2f} m from an obstacle, and the robot needs {footprint_m:.2f} m "
                "around it"
            )
    if known < 0:
        return "is unknown ground, and no way to it was found"
    return "is free, but no way that is wide enough leads there"


def nearest_reachable(reached: Reach, xy_m: XY) -> XY | None:
    """Reachable place nearest to a point, at any distance; None if there is none."""
    centres = reached.ground.centres_of(np.argwhere(np.isfinite(reached.arrival)))
    if not len(centres):
        return None
    x_m, y_m = centres[np.argmin(np.hypot(*(centres - np.asarray(xy_m)).T))]
    return float(x_m), float(y_m)
