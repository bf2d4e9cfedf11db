"""A flat of plain arrays: boxes on a floor, a disc for a robot, things seen from near enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from helios_core.geometry import Matrix, Pinhole, wrap_angle, yaw_of
from helios_core.robot import Action, ActionResult, Forward, Observe, Pick, Place, Tilt, Turn
from helios_core.types import ObjectInstance, RobotDescription
from helios_planner.body import Body, Frontier, WhatIf
from helios_planner.decide import Decision
from helios_planner.grid import GroundMap, Pose2
from helios_planner.sightings import Sighting, sighting_of
from helios_planner.task import Cause, Phase, TaskCancelled, TaskFailed
from numpy.typing import NDArray

CELL_M = 0.025
TALL_M = 1.3
CAMERA = Pinhole(fx=554.0, fy=554.0, cx=320.0, cy=240.0, width=640, height=480)
ROBOT = RobotDescription(
    name="fake", footprint_radius_m=0.3, height_m=1.4, camera=CAMERA, camera_height_m=1.31,
    reach_m=0.8, max_depth_m=5.0, tilt_range_rad=(-0.5, 1.2), simulated=True,
)  # fmt: skip


@dataclass
class Box:
    """A box on the floor: x0, y0, x1, y1, height; hidden ones are never seen, only felt."""

    x0: float
    y0: float
    x1: float
    y1: float
    top_m: float
    hidden: bool = False


@dataclass
class Thing:
    """Something that a detector can see. rate: share of views in which it is detected."""

    id: int
    class_name: str
    center_m: NDArray[np.float64]
    size_m: NDArray[np.float64]
    rate: float = 1.0
    views: list[tuple[float, float, float]] = field(default_factory=list)
    graspable: bool = True
    slippery: int = 0  # picks that fail first

    def score_at(self, views: int) -> tuple[float, float, float]:
        """(Psi, S, U) after that many views (eq. 4, 7), four classes, alpha_cpa 3."""
        total = 4.0 + 3.0 * views
        s = (1.0 + 3.0 * views * self.rate) / total
        u = math.sqrt(s * (1 - s) / (1 + total))
        return s - u, s, u


class FakeWorld(Body):
    """See the module. Contacts are counted in `contacts`."""

    description: RobotDescription = ROBOT

    def __init__(
        self,
        size_m: tuple[float, float],
        boxes: Sequence[Box],
        things: Sequence[Thing],
        start: Pose2,
        max_steps: int = 1250,
    ) -> None:
        self.things = {t.id: t for t in things}
        self.max_steps, self.steps, self.contacts = max_steps, 0, 0
        self.log: list[Action] = []
        self.decisions: list[Decision] = []
        self.phases: list[Phase] = []
        self.picks, self.released = 0, None
        self.retired: list[int] = []  # things, in the order in which the map was told
        self.cancel_after: int | None = None
        self.shares: set[tuple[bool, float]] = set()  # of what-ifs: joint, other_share
        self._reported: list[Sighting] = []
        self._held: Thing | None = None
        self._pose, self._tilt = start, 0.0
        rows, columns = round(size_m[1] / CELL_M), round(size_m[0] / CELL_M)
        self.truth_top = np.zeros((rows, columns), np.float32)
        self.seen_top = np.zeros((rows, columns), np.float32)
        self.boxes = list(boxes)
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
            at = np.s_[round(b.y0 / CELL_M) : round(b.y1 / CELL_M),
                       round(b.x0 / CELL_M) : round(b.x1 / CELL_M)]  # fmt: skip
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
        p, half = self._pose, CAMERA.hfov_rad / 2
        lowest = self._tilt + CAMERA.vfov_rad / 2
        highest = self._tilt - CAMERA.vfov_rad / 2
        height_m = self.description.camera_height_m
        near_m = height_m / math.tan(lowest) if lowest < math.pi / 2 else 0.0
        far_m = ROBOT.max_depth_m
        if highest > 0.01:
            far_m = min(far_m, height_m / math.tan(highest))
        angles = p.yaw_rad + np.linspace(-half, half, 400)
        ranges = np.arange(0, far_m, CELL_M * 0.5)
        x = p.x_m + np.cos(angles)[:, None] * ranges
        y = p.y_m + np.sin(angles)[:, None] * ranges
        rows, columns = self.seen_top.shape
        r = np.clip((y / CELL_M).astype(np.int32), 0, rows - 1)
        c = np.clip((x / CELL_M).astype(np.int32), 0, columns - 1)
        at = r * columns + c
        blocked = np.logical_or.accumulate((self.seen_top >= TALL_M).ravel()[at], axis=1)
        behind = np.zeros_like(blocked)
        behind[:, 4:] = blocked[:, :-4]  # a wall's own thickness shows
        self._known.ravel()[at[~behind & (ranges >= near_m)]] = True
        own = np.hypot(np.arange(columns)[None] * CELL_M - p.x_m,
                       np.arange(rows)[:, None] * CELL_M - p.y_m) < 0.35  # fmt: skip
        self._known |= own
        for t in self.things.values():
            if t is not self._held and self._sees(p, t.center_m):
                eye_m = np.array([p.x_m, p.y_m, height_m])
                aside = abs(p.bearing_rad(t.center_m)) > 0.9 * half
                self._reported.append(
                    sighting_of(t.class_name, 0.6, corners_of(t), eye_m, aside)
                )  # fmt: skip
                here = (p.x_m, p.y_m, p.yaw_rad)
                if all(math.dist(v[:2], here[:2]) > 0.08 or abs(wrap_angle(v[2] - here[2])) > 0.07
                       for v in t.views):  # fmt: skip
                    t.views.append(here)

    def _sees(self, p: Pose2, point: NDArray[np.float64]) -> bool:
        d = p.distance_m(point)
        if d > 4.0 or abs(p.bearing_rad(point)) > CAMERA.hfov_rad / 2:
            return False
        n = max(2, int(d / (CELL_M * 0.5)))
        s = np.linspace(0, 0.97, n)
        x, y = p.x_m + (point[0] - p.x_m) * s, p.y_m + (point[1] - p.y_m) * s
        return not (self.seen_top[(y / CELL_M).astype(int), (x / CELL_M).astype(int)]
                    >= TALL_M).any()  # fmt: skip

    # --- the Body ------------------------------------------------------------------------------
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
        unknown = (~self._known).astype(np.uint8)
        edge = (cv2.dilate(unknown, np.ones((3, 3), np.uint8)) > 0) & self._known
        edge &= self.seen_top == 0
        count, labels, stats, middles = cv2.connectedComponentsWithStats(edge.astype(np.uint8))
        out = []
        for k in range(1, count):
            if stats[k, cv2.CC_STAT_AREA] * CELL_M < 0.4:
                continue
            cells = np.argwhere(labels == k)
            r, c = cells[np.argmin(np.hypot(cells[:, 1] - middles[k][0],
                                            cells[:, 0] - middles[k][1]))]  # fmt: skip
            xy = ((c + 0.5) * CELL_M, (r + 0.5) * CELL_M)
            size = float(stats[k, cv2.CC_STAT_AREA] * CELL_M)
            out.append(Frontier(k, xy, size, {"pick": 0.2, "place": 0.2}))
        return out

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
        other_share: float = 0.0,
    ) -> WhatIf:
        t = self.things[id]
        seen = []
        for T in T_world_cam:
            yaw = yaw_of(T[:, [2, 0, 1, 3]])
            seen.append(self._sees(Pose2(float(T[0, 3]), float(T[1, 3]), yaw), t.center_m))
        now = len(t.views)
        optimistic = Thing(0, "", t.center_m, t.size_m, 1.0)
        self.shares.add((joint, other_share))
        views = [now + sum(seen)] if joint else [now + int(s) for s in seen]
        scores = tuple(max(t.score_at(v)[0], optimistic.score_at(v)[0] - 0.4) for v in views)
        gains = tuple(200 * math.log((1 + v) / (1 + now)) for v in views)
        return WhatIf(scores, gains)

    def retire(self, id: int, point_m: NDArray[np.float64], reason: str) -> None:
        self.retired.append(id)
        self.things[id].views.clear()

    def tell_phase(self, phase: Phase, seeking: str, message: str) -> None:
        if not self.phases or self.phases[-1] is not phase:
            self.phases.append(phase)

    def tell_decision(self, decision: Decision) -> None:
        self.decisions.append(decision)

    def tell_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None:
        return

    def tell_picks(self, picks: int) -> None:
        self.picks = picks


def corners_of(thing: Thing) -> NDArray[np.float64]:
    """Points [8, 3] of a thing's box."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return thing.center_m + signs * thing.size_m / 2


def flat(
    things: Sequence[Thing] = (), start: Pose2 | None = None, extra: Sequence[Box] = ()
) -> FakeWorld:
    """Three rooms, 9 x 7 m, doors 1 m wide; a coffee table, a counter, a bed as boxes."""
    walls = [
        Box(4.4, 0, 4.5, 2.5, 2.5), Box(4.4, 3.5, 4.5, 7, 2.5), Box(4.5, 4.0, 6.5, 4.1, 2.5),
        Box(7.5, 4.0, 9, 4.1, 2.5),
    ]  # fmt: skip
    furniture = [
        Box(6.5, 5.2, 7.5, 5.8, 0.45), Box(1.2, 6.3, 3.2, 6.95, 0.9), Box(6.8, 0.05, 8.8, 1.9, 0.5)
    ]  # fmt: skip
    return FakeWorld((9, 7), [*walls, *furniture, *extra], things, start or Pose2(1.5, 1.5, 0.3))


def coffee_table(id: int = 1) -> Thing:
    return Thing(id, "coffee table", np.array([7.0, 5.5, 0.4]), np.array([1.0, 0.6, 0.1]),
                 graspable=False)  # fmt: skip


def counter(id: int = 2) -> Thing:
    return Thing(id, "counter", np.array([2.2, 6.62, 0.85]), np.array([2.0, 0.65, 0.1]),
                 graspable=False)  # fmt: skip


def mug(id: int = 3, x: float = 7.2, y: float = 5.35, z: float = 0.5, rate: float = 1.0) -> Thing:
    return Thing(id, "mug", np.array([x, y, z]), np.array([0.08, 0.08, 0.1]), rate)
