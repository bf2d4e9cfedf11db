"""Legs of a robot that is no disc: it must be turned to fit, and turning needs room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from helios_core.robot import Forward, Turn

from helios_planner.ground.blind_ring import BlindRing
from helios_planner.ground.grid import GroundMap, Pose2
from helios_planner.ground.motion import Reach
from helios_planner.ground.poses import Capsule, PoseReach, pose_reach
from helios_planner.moving.legs import ARRIVED_M, Legs, Outcome
from helios_planner.moving.mishaps import NO_MOTION_M
from helios_planner.robot.body import Body
from helios_planner.settings import Settings


def legs_of(body: Body, settings: Settings) -> Legs:
    """The legs that fit the robot's footprint."""
    box = body.description.footprint_box_m
    return Legs(body, settings) if box is None else PoseLegs(body, settings, Capsule.around(*box))


class PoseLegs(Legs):
    """See the module."""

    def __init__(self, body: Body, settings: Settings, capsule: Capsule) -> None:
        super().__init__(body, settings)
        self.capsule = capsule
        self.rules = replace(self.rules, footprint_m=capsule.reach_m)
        self.blind_ring = BlindRing(body.description, capsule.reach_m, settings.blind_m)
        self._lattice_xy: tuple[float, float] | None = None

    def reach(self, level: int = 0) -> PoseReach:
        reached = super().reach(level)
        assert isinstance(reached, PoseReach)
        return reached

    def _reach_on(self, ground: GroundMap, level: int) -> Reach:
        rules = replace(self.rules, margin_m=self.settings.margins_m[level])
        reached = pose_reach(
            self._covering(ground), self.body.pose(), self.capsule, rules, *self._discs(),
            lattice_xy=self._lattice_xy,
        )  # fmt: skip
        self._lattice_xy = reached.node_xy
        return reached

    def _new_lattice(self) -> None:
        """From where it stands: what one lattice misses another may have."""
        self._lattice_xy = None
        self._cached.clear()

    def _drive(self, goal: Pose2, purpose: str, stop: Callable[[], bool], slip_m: float) -> Outcome:
        level, looked = 0, False
        self._settle_jump()
        self._get_free()
        for _ in range(80 + int(20 * self.body.pose().distance_m(goal.xy))):
            pose = self.body.pose()
            reached = self.reach(level)
            end = reached.best_near(goal, slip_m)
            move = None
            if end is not None:
                way = reached.way_to(end)
                self.body.tell_plan(reached.route_along(way), goal, purpose)
                if len(way) == 1 and pose.distance_m(goal.xy) < max(slip_m, ARRIVED_M):
                    return Outcome.ARRIVED
                move = reached.next_move(way, self.rules)
            if move is None:
                if end is not None and pose.distance_m(goal.xy) < ARRIVED_M:
                    return Outcome.ARRIVED
                if reached.kept:
                    self._new_lattice()
                elif level + 1 < len(self.settings.margins_m):
                    level += 1
                elif not looked and self.look_down_around():
                    looked, level = True, 0
                else:
                    return Outcome.UNREACHABLE
                continue
            result = self.mishaps.act(move)
            if isinstance(move, Forward):
                if self.mishaps.stood_still(move, result):
                    self._mark_ahead(pose, result.moved_m)
                    self._get_free()
                level = 0
            self._settle_jump()
            if stop():
                return Outcome.INTERRUPTED
        return Outcome.UNREACHABLE

    def ahead(self, distance_m: float) -> bool:
        free_m = self.reach(self.levels[-1]).free_ahead_m(distance_m, self.rules)
        if free_m < self.rules.min_forward_m:
            return False
        return self.mishaps.act(Forward(free_m)).moved_m > NO_MOTION_M

    def _turn(self, angle_rad: float) -> bool:
        free_rad = self.reach(self.levels[-1]).free_turn_rad(angle_rad)
        if abs(free_rad) < self.rules.min_turn_rad:
            return False
        self.mishaps.act(Turn(free_rad))
        return abs(free_rad) >= abs(angle_rad) - 1e-6
