"""A fake world of plain arrays: a disc drives between boxes and handles objects that it sees."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from helios_core.geometry import Matrix, wrap_angle, yaw_of
from helios_core.robot import (
    Action,
    ActionResult,
    Forward,
    Observe,
    Pick,
    Place,
    Show,
    Tilt,
    Turn,
)
from helios_core.types import AlignedBox, ObjectInstance, RobotDescription
from helios_planner.decisions.decision import Decision
from helios_planner.decisions.held_object import HeldObject
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.robot.detections import Sighting, sighting_of
from helios_planner.robot.interface import Frontier, RobotInterface, WhatIf
from helios_planner.task import Cause, Phase, TaskCancelled, TaskFailed
from numpy.typing import NDArray
from planner_eye import CAMERA, CELL_M, ROBOT, floor_seen, frontiers_of, sees, under_robot
from planner_things import Box, Thing, corners_of


class FakeWorld(RobotInterface):
    """A robot and its world. `contacts` counts collisions."""

    description: RobotDescription = ROBOT

    def __init__(
        self,
        size_m: tuple[float, float],
        boxes: Sequence[Box],
        things: Sequence[Thing],
        start: Pose2,
        max_steps: int = 1250,
    ) -> None:
        self.listener = self  # the world records all reports itself
        self.things = {t.id: t for t in things}
        self.max_steps, self.steps, self.contacts = max_steps, 0, 0
        self.log: list[Action] = []
        self.decisions: list[Decision] = []
        self.phases: list[Phase] = []
        self.said: list[tuple[int, str]] = []  # step, message
        self.picks, self.released = 0, None
        self.retired: list[int] = []  # ids of objects, in order of retirement
        self.cancel_after: int | None = None
        self.shares: set[tuple[bool, float | None]] = (
            set()
        )  # (joint, other_share) of all what-if requests
        self._reported: list[Sighting] = []
        self._held: Thing | None = None
        self._pose, self._tilt = start, 0.0
        self.started_at: tuple[float, float] | None = start.xy
        rows, columns = round(size_m[1] / CELL_M), round(size_m[0] / CELL_M)
        self.truth_top = np.zeros((rows, columns), np.float32)
        self.seen_top = np.zeros((rows, columns), np.float32)
        self.boxes = list(boxes)
        self.named_at = 0.5  # probability of a class by the names of detections, anywhere
        self._known = np.zeros((rows, columns), bool)
        self._version = 0
        self._paint()
        self.look()

    # --- truth ---------------------------------------------------------------------------------
    def add_box(self, box: Box) -> None:
        self.boxes.append(box)
        self._paint()

    def _paint(self) -> None:
        self.truth_top[:], self.seen_top[:] = 0, 0
        self.truth_top[[0, -1]], self.truth_top[:, [0, -1]] = 2.5, 2.5
        self.seen_top[:] = self.truth_top
        for b in self.boxes:
            at = np.s_[
                round(b.y0 / CELL_M) : round(b.y1 / CELL_M),
                round(b.x0 / CELL_M) : round(b.x1 / CELL_M),
            ]
            self.truth_top[at] = np.maximum(self.truth_top[at], b.top_m)
            if not b.hidden:
                self.seen_top[at] = np.maximum(self.seen_top[at], b.top_m)
        free = (self.truth_top == 0).astype(np.uint8)
        self.clearance = (cv2.distanceTransform(free, cv2.DIST_L2, 5) - 0.5) * CELL_M

    def _clear(self, x: float, y: float) -> bool:
        return bool(self.clearance[int(y / CELL_M), int(x / CELL_M)] >= 0.3 - CELL_M)

    # --- acting --------------------------------------------------------------------------------
    def act(self, action: Action) -> ActionResult:
        if self.cancel_after is not None and self.steps >= self.cancel_after:
            raise TaskCancelled
        if self.steps >= self.max_steps:
            raise TaskFailed(Cause.STEP_BUDGET, f"{self.steps} steps are used up")
        self.steps += 1
        self.log.append(action)
        result = self._do(action)
        self.on_result(action, result)
        self.look()
        return result

    def _do(self, action: Action) -> ActionResult:
        p = self._pose
        match action:
            case Turn(angle):
                assert math.radians(4.99) <= abs(angle) <= math.radians(30.01), action
                self._pose = Pose2(p.x_m, p.y_m, wrap_angle(p.yaw_rad + angle))
                return ActionResult(True, turned_rad=angle)
            case Forward(distance):
                most = 1.0 if distance > 0 else self.description.max_back_m
                assert 0.0999 <= abs(distance) <= most + 0.0001, action
                return self._drive(distance)
            case Tilt(angle):
                self._tilt = angle
                return ActionResult(True)
            case Pick(point, class_name):
                return self._pick(np.array(point), class_name)
            case Place(point):
                return self._place(np.array(point))
            case Observe():
                return ActionResult(True)
            case Show():
                can = self.description.show_base_m is not None and self._held is not None
                return ActionResult(can, "" if can else "there is nothing to show")

    def _drive(self, distance: float) -> ActionResult:
        moved = 0.0
        while moved < abs(distance) - 1e-9:
            step = min(0.01, abs(distance) - moved)
            there = self._pose.ahead(math.copysign(step, distance))
            if not self._clear(*there.xy):
                self.contacts += 1
                return ActionResult(False, "touched something", moved_m=moved, collided=True)
            self._pose, moved = there, moved + step
        return ActionResult(True, moved_m=moved)

    def _pick(self, point: NDArray[np.float64], class_name: str) -> ActionResult:
        for t in self.things.values():
            if t.graspable and t.class_name == class_name:
                near = np.linalg.norm(t.center_m - point) < 0.1
                if near and self._pose.distance_m(t.center_m) <= ROBOT.reach_m:
                    if t.slippery > 0:
                        t.slippery -= 1
                        return ActionResult(False, "it slipped")
                    self._held = t
                    return ActionResult(True)
        return ActionResult(False, "nothing there to grasp")

    def _place(self, point: NDArray[np.float64]) -> ActionResult:
        if self._held is None or self._pose.distance_m(point) > ROBOT.reach_m:
            return ActionResult(False, "out of reach or nothing held")
        top = float(self.truth_top[int(point[1] / CELL_M), int(point[0] / CELL_M)])
        self._held.center_m = np.array([point[0], point[1], top + 0.05])
        self.released = self._held
        self._held = None
        ok = 0.0 <= point[2] - top < 0.15
        return ActionResult(ok, "" if ok else "it fell")

    # --- seeing --------------------------------------------------------------------------------
    def look(self) -> None:
        self._version += 1
        p, height_m = self._pose, self.description.camera_height_m
        self._known |= floor_seen(self.seen_top, p, self._tilt, height_m)
        self._known |= under_robot(self._known.shape, p)
        for t in self.things.values():
            if t is not self._held and sees(self.seen_top, p, t.center_m):
                eye_m = np.array([p.x_m, p.y_m, height_m])
                aside = abs(p.bearing_rad(t.center_m)) > 0.9 * CAMERA.hfov_rad / 2
                self._reported.append(sighting_of(t.class_name, 0.6, corners_of(t), eye_m, aside))
                here = (p.x_m, p.y_m, p.yaw_rad)
                if all(
                    math.dist(v[:2], here[:2]) > 0.08 or abs(wrap_angle(v[2] - here[2])) > 0.07
                    for v in t.views
                ):
                    t.views.append(here)

    # --- robot interface -----------------------------------------------------------------------
    def budget_used(self) -> float:
        return self.steps / self.max_steps

    def pose(self) -> Pose2:
        return self._pose

    def tilt_rad(self) -> float:
        return self._tilt

    def held(self) -> str:
        return self._held.class_name if self._held else ""

    def ground(self) -> GroundMap:
        occupancy = np.where(self._known, np.where(self.seen_top > 0, 100, 0), -1).astype(np.int8)
        top = np.where(self._known, self.seen_top, 0).astype(np.float32)
        return GroundMap(occupancy, top, CELL_M, (0.0, 0.0), self._version)

    def frontiers(self) -> list[Frontier]:
        return frontiers_of(self._known, self.seen_top)

    def start(self) -> tuple[float, float] | None:
        return self.started_at

    def objects(self, class_name: str) -> list[ObjectInstance]:
        out = []
        for t in self.things.values():
            if t.class_name == class_name and t.views and t is not self._held:
                psi, s, u = t.score_at(len(t.views))
                half = t.size_m[:2] / 2
                corners = t.center_m[:2] + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
                out.append(ObjectInstance(
                    t.id, t.class_name, t.center_m.copy(), t.size_m, psi, s, u, len(t.views), 200,
                    {t.class_name: s}, float(t.center_m[2] + t.size_m[2] / 2), corners, t.rate,
                    0.0, t.remembered,
                ))  # fmt: skip
        return out

    def sightings(self) -> list[Sighting]:
        return list(self._reported)

    def what_if(
        self,
        id: int,
        class_name: str,
        T_world_cam: Sequence[Matrix],
        joint: bool,
        other_share: float | None = None,
    ) -> WhatIf:
        t = self.things[id]
        seen = [self._sees_from(T, t) for T in T_world_cam]
        now = len(t.views)
        optimistic = Thing(0, "", t.center_m, t.size_m, 1.0)
        self.shares.add((joint, other_share))
        views = [now + sum(seen)] if joint else [now + int(s) for s in seen]
        scores = tuple(max(t.score_at(v)[0], optimistic.score_at(v)[0] - 0.4) for v in views)
        gains = tuple(200 * math.log((1 + v) / (1 + now)) for v in views)
        pixels = tuple(50.0 * v for v in views)
        return WhatIf(scores, gains, pixels, float(t.size_m[0] * t.size_m[1]))

    def _sees_from(self, T_world_cam: Matrix, thing: Thing) -> bool:
        yaw = yaw_of(T_world_cam[:, [2, 0, 1, 3]])
        pose = Pose2(float(T_world_cam[0, 3]), float(T_world_cam[1, 3]), yaw)
        return sees(self.seen_top, pose, thing.center_m)

    def held_object(self, class_name: str) -> HeldObject:
        return self._held.in_hand if self._held else HeldObject(1.0, 0, ())

    def probability_at(self, class_name: str, boxes: Sequence[AlignedBox]) -> Sequence[float]:
        return [self.named_at for _ in boxes]

    def retire(self, id: int, point_m: NDArray[np.float64], reason: str) -> None:
        self.retired.append(id)
        if id in self.things:
            self.things[id].views.clear()

    def on_phase(self, phase: Phase, seeking: str, message: str) -> None:
        self.said.append((self.steps, message))
        if not self.phases or self.phases[-1] is not phase:
            self.phases.append(phase)

    def on_decision(self, decision: Decision) -> None:
        self.decisions.append(decision)

    def on_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None:
        return

    def on_picks(self, picks: int) -> None:
        self.picks = picks
