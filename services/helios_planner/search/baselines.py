"""Searches of the baselines: the trusting agent (paper, section 4) and VLFM.

The trusting agent explores until its detector reports the object, then acts: no 3D map, no gaze
points, no objective. VLFM explores by its value map (Yokoyama et al. 2024). Neither queries the
object map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.decisions import explanations
from helios_planner.decisions.acceptance import (
    Candidate,
    best_of,
    paper,
    position_of,
    visit_first,
)
from helios_planner.decisions.decision import Act, Decision, DecisionRule, Do
from helios_planner.match_radii import (
    PICKED_PLACE_M,
    SAME_INSTANCE_M,
    SAME_PLACE_M,
    SAME_THING_M,
)
from helios_planner.motion_planning.base_placement import (
    eye_of,
    near_outline,
    nearest_to,
    outline_of,
)
from helios_planner.navigation.base_controller import Outcome
from helios_planner.robot.detections import Sighting
from helios_planner.search.base import PICK_LAYER, PLACE_LAYER, Search, SearchTools
from helios_planner.search.candidate_beliefs import TrustingBelief
from helios_planner.search.frontier_exploration import Explorer, TargetPursuit
from helios_planner.search.scored_search import ScoredSearch
from helios_planner.search.view_selection import PlaceSet
from helios_planner.task import Phase

RANGE_M = 5.0  # range of VLFM's camera
FAR_SHARE, NEAR_SHARE = 0.95, 0.5  # of the range: tentative beyond, discarded within
TOO_NEAR_M = 1.0
TENTATIVE = 1.0  # uncertainty of a tentative object, so that its score is 0


class TrustingSearch(Search):
    """Search that acts on the nearest reported object that has not failed yet. Goal receptacles
    reported during the object search count too, unless `goal_seen_before_pick` is off."""

    remembers: ClassVar[bool] = False  # goal receptacles reported earlier count in any case

    def __init__(
        self,
        tools: SearchTools,
        phase: Phase,
        name: str,
        explorer: Callable[[Search, str], Explorer],
        not_at: np.ndarray | None = None,
    ) -> None:
        """not_at: point where the object was picked, if start and goal are of one class."""
        super().__init__(tools, phase, name, SAME_THING_M)
        self._not_at = not_at
        layer = PICK_LAYER if phase is Phase.FIND_OBJECT else PLACE_LAYER
        self._explorer = explorer(self, layer)
        counts = self.remembers or tools.settings.goal_seen_before_pick
        counts = counts or phase is Phase.FIND_OBJECT
        known = () if counts else self.belief.known(name)
        self._outdated = {t.id: t.views for t in known}  # views at the start; more make it count

    def reported(self) -> list[ObjectInstance]:
        return [
            thing
            for thing in self.belief.known(self.name)
            if self.open(thing)
            and self._outdated.get(thing.id) != thing.views
            and (self._not_at is None or not near_outline(thing, self._not_at, PICKED_PLACE_M))
        ]

    def decide(self) -> Decision:
        pose = self.robot.pose()
        kind = "object" if self.phase is Phase.FIND_OBJECT else "receptacle"
        candidates = []
        for thing in self.reported():
            away_m = pose.distance_m(thing.center_m)
            terms = {"views": float(thing.views), "distance_m": away_m, "total": -away_m}
            candidates.append(
                Candidate(kind, thing.class_name, position_of(thing), terms, thing.id)
            )
        rule = DecisionRule.TRUST
        if not candidates:
            return Decision(rule, Do.SEARCH_ON, (), None, explanations.none_reported(self.name))
        k = best_of(candidates)
        why = explanations.trusted(candidates, k)
        return Decision(rule, Do.ACT, tuple(candidates), k, why)

    def explore(self) -> bool:
        return self._explorer.step(lambda: bool(self.reported()))

    def checkpoint(self) -> dict[str, Any]:
        return super().checkpoint() | {
            "explorer": self._explorer.checkpoint(),
            "outdated": list(self._outdated.items()),
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        super().restore(checkpoint)
        self._explorer.restore(checkpoint["explorer"])
        self._outdated = {int(id): int(n) for id, n in checkpoint.get("outdated", [])}


class StopSearch(ScoredSearch):
    """Search that explores as VLFM does until there is a candidate by class score (paper, section
    4.2). It then goes to all gaze points around it, and only after that compares its score with
    tau_g. A candidate below tau_g is left; it is acted on if its score rises to tau_g later, and
    visited again in the next round.

    A candidate without a gaze point in reach is looked at once from as near as possible.
    """

    kind, action, extra_views = "object", Act.STOP, False

    def __init__(self, tools: SearchTools, name: str) -> None:
        within = paper(tools.settings.tau_g, False)
        super().__init__(tools, Phase.FIND_OBJECT, name, within, refused_m=SAME_INSTANCE_M)
        self._explorer = TargetPursuit(self, PICK_LAYER)
        self.visited = PlaceSet(SAME_PLACE_M)  # candidates that were looked at from gaze points

    def candidates(self) -> list[ObjectInstance]:
        return [
            o
            for o in self.robot.objects(self.name)
            if o.class_score >= self.settings.cs_g and self.open(o)
        ]

    def decide(self) -> Decision:
        things = self.candidates()
        judged = self.judge([o for o in things if o in self.visited])
        unvisited = [o for o in things if o not in self.visited]
        if judged.do is Do.ACT or not unvisited:
            return judged
        return visit_first(unvisited, [self.robot.pose().distance_m(o.center_m) for o in unvisited])

    def _look_again(self, decision: Decision) -> None:
        """Go to the gaze points around the chosen candidate, as long as it is one."""
        thing = self.chosen(decision)

        def gone() -> bool:
            return all(o.id != thing.id for o in self.candidates())

        purpose = f"look at the {self.name} from all sides"
        if self.looking.remaining_gaze_points(thing) or self.looking.look_count(thing):
            if self.looking.visit_gaze_points(thing, purpose, gone):
                self.visited.add(thing)
        elif self.base.clear_way(position_of(thing)[:2], self._near_enough_m(thing)):
            return
        elif views := self.looking.views_of(thing):
            if self.looking.go_and_look(thing, views[0], purpose, gone) is not Outcome.INTERRUPTED:
                self.visited.add(thing)
        else:
            self.reject_or_postpone(thing, out_of_reach=True)

    def explore(self) -> bool:
        return self.until_candidates(self._explorer)

    def next_round(self) -> None:
        self.visited.clear()
        super().next_round()

    def checkpoint(self) -> dict[str, Any]:
        return super().checkpoint() | {
            "explorer": self._explorer.checkpoint(),
            "visited": self.visited.checkpoint(),
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        super().restore(checkpoint)
        self._explorer.restore(checkpoint["explorer"])
        if "visited" in checkpoint:  # checkpoints of earlier builds lack it
            self.visited.restore(checkpoint["visited"])


class VlfmBelief(TrustingBelief):
    """VLFM's belief: detections seen well count, others are tentative."""

    doubts_sides: ClassVar[bool] = True

    def known(self, class_name: str) -> Sequence[ObjectInstance]:
        """Objects that were seen well; without any, the tentative ones."""
        super().known(class_name)  # reads new sightings
        self._things = [t for t in self._things if not (_tentative(t) and self._disproved(t))]
        things = [t for t in self._things if t.class_name == class_name]
        return [t for t in things if not _tentative(t)] or things

    def from_near(
        self, thing: ObjectInstance, class_name: str, within_m: float
    ) -> ObjectInstance | None:
        return nearest_to(thing.center_m, self.known(class_name), within_m)

    def still_supports(self, thing: ObjectInstance) -> bool:
        """Also False if another object was seen well meanwhile."""
        return any(t.id == thing.id for t in self.known(thing.class_name))

    @property
    def _range_m(self) -> float:
        return min(RANGE_M, self.robot.description.max_depth_m)

    def _take_in(self, sighting: Sighting) -> None:
        if sighting.confidence < self.settings.vlfm_confidence or sighting.nearest_m < TOO_NEAR_M:
            return
        well = sighting.nearest_m <= FAR_SHARE * self._range_m
        well = well and not (self.doubts_sides and sighting.at_side)
        known = self._known_as(sighting)
        if well:
            self._put(sighting, known)
        elif sighting.nearest_m > NEAR_SHARE * self._range_m and (
            known is None or _tentative(known)
        ):
            self._put(sighting, known, TENTATIVE)

    def _disproved(self, thing: ObjectInstance) -> bool:
        """True if the camera faces part of the object from near: it would have seen it well."""
        robot, pose = self.robot.description, self.robot.pose()
        eye = (*eye_of(pose, robot), robot.camera_height_m)
        points = np.vstack([outline_of(thing), thing.center_m[:2]])
        return any(
            abs(pose.bearing_rad(xy)) <= robot.camera.hfov_rad / 2
            and math.dist(eye, (*xy, thing.center_m[2])) <= NEAR_SHARE * self._range_m
            for xy in points
        )


class UnfilteredBelief(VlfmBelief):
    """VLFM's belief that also counts detections at an image's side as seen well (Table 2)."""

    doubts_sides = False


def _tentative(thing: ObjectInstance) -> bool:
    return thing.uncertainty >= TENTATIVE
