"""Views of candidates: gaze points that are left, the expected effect of a view, driving there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from helios_core.geometry import wrap_angle
from helios_core.types import ObjectInstance
from numpy.typing import NDArray

from helios_planner.decisions.acceptance import best_view
from helios_planner.decisions.decision import ViewOption
from helios_planner.decisions.gain import Gain
from helios_planner.match_radii import SAME_PLACE_M
from helios_planner.motion_planning.base_placement import GazePoint, GazeRules, gaze_points
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation.base_controller import BaseController, Outcome, never
from helios_planner.robot.interface import RobotInterface
from helios_planner.settings import Settings

# Lengths in metres: contours around the candidate, and the distance between gaze points on them.
RECEPTACLE_RULES = GazeRules(distances_m=(0.6, 0.9), spacing_m=0.8)  # local search of a receptacle
VIEW_RULES = GazeRules(distances_m=(0.6, 0.9, 1.3, 1.8), spacing_m=0.5)  # extra views of an object
STOP_RULES = GazeRules(distances_m=(0.5, 0.7, 0.85), spacing_m=0.5)  # object navigation: within 1 m


@dataclass(frozen=True)
class Look:
    """A gaze point from which the robot looked at a candidate."""

    class_name: str  # of the candidate; empty in checkpoints of earlier builds
    middle_m: tuple[float, float]  # of the candidate
    pose: Pose2

    def is_at(self, candidate: ObjectInstance, pooled: bool) -> bool:
        """True if it counts as a look at this candidate. pooled: any class within SAME_PLACE_M."""
        near = math.dist(self.middle_m, candidate.center_m[:2]) < SAME_PLACE_M
        return near and (pooled or self.class_name in ("", candidate.class_name))


@dataclass
class PlaceSet:
    """Set of places, found by instance id and by position: ids change when instances merge."""

    same_m: float
    ids: set[int] = field(default_factory=set)
    points: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, instance: ObjectInstance) -> None:
        self.ids.add(instance.id)
        self.points.append(np.asarray(instance.center_m[:2], float))

    def __contains__(self, instance: ObjectInstance) -> bool:
        return instance.id in self.ids or any(
            math.dist(p, instance.center_m[:2]) < self.same_m for p in self.points
        )

    def clear(self) -> None:
        self.ids.clear()
        self.points.clear()

    def checkpoint(self) -> dict[str, Any]:
        """State as JSON, for `restore`."""
        return {"ids": sorted(self.ids), "points": [p.tolist() for p in self.points]}

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.ids = set(checkpoint["ids"])
        self.points = [np.asarray(p, float) for p in checkpoint["points"]]


@dataclass(frozen=True)
class BestView:
    """View that would raise a candidate's score most."""

    gaze: GazePoint
    score: float


class ViewPlanner:
    """Views of the candidates of a task; records the viewpoints from which it looked at each."""

    def __init__(
        self,
        robot: RobotInterface,
        base: BaseController,
        settings: Settings,
        other_share: float | None = None,
    ) -> None:
        """other_share: share of the evidence of an expected view that goes to the *other* class;
        None: by the object map's setting."""
        self.robot, self.base, self.settings = robot, base, settings
        self._other_share = other_share
        self._looks: list[Look] = []
        self._views: dict[tuple, BestView | None] = {}
        self._gains: dict[tuple, Gain] = {}

    # --- gaze points ---------------------------------------------------------------------------
    def remaining_gaze_points(self, receptacle: ObjectInstance) -> list[GazePoint]:
        """Gaze points of a local search that are left, nearest first."""
        return self._left(receptacle, RECEPTACLE_RULES, 0.6 * RECEPTACLE_RULES.spacing_m)

    def views_of(self, thing: ObjectInstance) -> list[GazePoint]:
        """Gaze points for an extra view that are left, nearest first."""
        rules = RECEPTACLE_RULES if self.settings.view_contours == "paper" else VIEW_RULES
        return self._left(thing, rules, 0.6 * rules.spacing_m)

    def stops_at(self, thing: ObjectInstance) -> list[GazePoint]:
        """Poses at which to stop in front of a found object, nearest first; used before or not."""
        return self._points(thing, STOP_RULES)

    def _left(self, candidate: ObjectInstance, rules: GazeRules, apart_m: float) -> list[GazePoint]:
        done = self._done(candidate)
        return [
            g
            for g in self._points(candidate, rules)
            if all(d.distance_m(g.pose.xy) >= apart_m for d in done)
        ]

    def _points(self, candidate: ObjectInstance, rules: GazeRules) -> list[GazePoint]:
        """Gaze points at the widest obstacle margin with which any is reachable."""
        rules = replace(rules, aim_at_top=self.settings.gaze_aim == "top")
        for level in self.base.levels:
            points = gaze_points(candidate, self.base.reach(level), self.robot.description, rules)
            if points:
                return points
        return []

    def _done(self, candidate: ObjectInstance) -> list[Pose2]:
        pooled = self.settings.pooled_looks
        return [look.pose for look in self._looks if look.is_at(candidate, pooled)]

    def look_count(self, candidate: ObjectInstance) -> int:
        """Number of times that a candidate was looked at on purpose."""
        return len(self._done(candidate))

    def forget(self) -> None:
        """Make every gaze point available again."""
        self._looks.clear()

    def checkpoint(self) -> list[list[float | str]]:
        """Looks [x, y, x, y, yaw, class name] as JSON, for `restore`."""
        return [
            [*look.middle_m, look.pose.x_m, look.pose.y_m, look.pose.yaw_rad, look.class_name]
            for look in self._looks
        ]

    def restore(self, checkpoint: Sequence[Sequence[Any]]) -> None:
        self._looks = [
            Look(named[0] if named else "", (middle_x, middle_y), Pose2(x, y, yaw))
            for middle_x, middle_y, x, y, yaw, *named in checkpoint
        ]

    # --- expected effect of views --------------------------------------------------------------
    def information_gain(self, receptacle: ObjectInstance, class_name: str) -> Gain | None:
        """Expected gain of a local search (eq. 12); None if no gaze point can be reached."""
        points = self.remaining_gaze_points(receptacle)[: self.settings.most_gaze_points]
        if not points:
            return None
        key = (receptacle.id, receptacle.views, receptacle.gaussians, tuple(g.pose for g in points))
        if key not in self._gains:
            poses = [g.T_world_cam(self.robot.description) for g in points]
            answer = self.robot.what_if(
                receptacle.id, class_name, poses, joint=True, other_share=self._other_share
            )
            self._gains[key] = Gain(
                answer.gains_nats[0] if answer.gains_nats else 0.0,
                receptacle.gaussians,
                answer.area_m2,
                answer.pixels[0] if answer.pixels else 0.0,
            )
        return self._gains[key]

    def best_view(self, thing: ObjectInstance, class_name: str) -> BestView | None:
        """Extra view with the best Psi' (eq. 11); None if none is left."""
        if self.look_count(thing) >= self.settings.extra_views:
            return None
        points = self.views_of(thing)[: self.settings.most_gaze_points]
        if not points:
            return None
        key = (thing.id, thing.views, thing.gaussians, tuple(g.pose for g in points))
        if key not in self._views:
            poses = [g.T_world_cam(self.robot.description) for g in points]
            answer = self.robot.what_if(thing.id, class_name, poses, joint=False)
            scores = list(answer.scores)
            if len(scores) != len(points):
                self._views[key] = None
            else:
                k = int(np.argmax(scores))
                self._views[key] = BestView(points[k], float(scores[k]))
                self.robot.listener.on_decision(
                    best_view(thing, scores, [g.pose.xy for g in points])
                )
        return self._views[key]

    def option(
        self,
        thing: ObjectInstance,
        class_name: str,
        threshold: float,
        in_place: bool,
        ask: bool,
    ) -> tuple[ViewOption, BestView | None]:
        """Candidate with its terms. If `ask` is set and its score is below the threshold, also the
        best extra view."""
        matters = ask and thing.score < threshold
        view = self.best_view(thing, class_name) if matters else None
        distance_m = self.robot.pose().distance_m(thing.center_m)
        score = view.score if view else None
        return ViewOption(thing, thing.score, score, distance_m, in_place), view

    # --- driving to a view ---------------------------------------------------------------------
    def go_and_look(
        self,
        candidate: ObjectInstance,
        gaze: GazePoint,
        purpose: str,
        stop: Callable[[], bool] = never,
    ) -> Outcome:
        """Drive to a gaze point, face the candidate, tilt the head. The gaze point is then used,
        reached or not, so that it is not chosen again; after an interruption it is not."""
        outcome = self.base.go_to(gaze.pose, purpose, stop)
        if outcome is Outcome.INTERRUPTED:
            return outcome
        middle = float(candidate.center_m[0]), float(candidate.center_m[1])
        self._looks.append(Look(candidate.class_name, middle, gaze.pose))
        if outcome is Outcome.ARRIVED:
            pose = self.robot.pose()
            self.base.turn_to(wrap_angle(pose.yaw_rad + pose.bearing_rad(middle)))
            self.base.tilt(gaze.tilt_rad)
        return outcome

    def visit_gaze_points(
        self, candidate: ObjectInstance, purpose: str, stop: Callable[[], bool]
    ) -> bool:
        """Look at a candidate from the gaze points that are left, nearest first, until `stop()` is
        true. True if none is left."""
        while points := self.remaining_gaze_points(candidate):
            outcome = self.go_and_look(candidate, points[0], purpose, stop)
            if outcome is Outcome.INTERRUPTED or stop():
                return not self.remaining_gaze_points(candidate)
        return True
