"""Base of every search: frontiers, candidates, later rounds, and the checkpoint of a search."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.decisions.acceptance import give_up
from helios_planner.decisions.decision import Act, Decision, Do, FrontierOption
from helios_planner.match_radii import SAME_PLACE_M
from helios_planner.motion_planning.base_placement import REACH_SPARE_M
from helios_planner.motion_planning.costmap import Pose2, facing
from helios_planner.motion_planning.path_planner import Reach
from helios_planner.navigation.base_controller import BaseController, Outcome
from helios_planner.refuted_things import RefutedThing
from helios_planner.robot.interface import Frontier, RobotInterface
from helios_planner.search.candidate_beliefs import Belief
from helios_planner.search.view_selection import PlaceSet, ViewPlanner
from helios_planner.settings import Settings
from helios_planner.task import Cause, Phase, TaskFailed

PICK_LAYER, PLACE_LAYER = "pick", "place"  # value layers of the object and of the goal receptacle
MOST_DOUBTS = 4  # rejections of one candidate in one search
# Limits per search: candidates found out of reach, and the same for one candidate.
MAX_UNREACHABLE, MAX_UNREACHABLE_PER_CANDIDATE = 8, 3
FRONTIER_REACH_M = 1.2  # a frontier is looked at from this near
REVISIT_SPACING_M = 2.5  # between the viewpoints of a repeated search
GRID_M = 0.2  # spacing of the considered places


@dataclass
class SearchTools:
    """Objects that the searches of one task share."""

    robot: RobotInterface
    settings: Settings
    base: BaseController
    looking: ViewPlanner
    belief: Belief
    rng: np.random.Generator
    # Frontiers that a visit did not remove.
    given_up: list[tuple[float, float]] = field(default_factory=list)

    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a crash of the planner, as JSON, for `restore`."""
        return {
            "given_up": [list(f) for f in self.given_up],
            "looked": self.looking.checkpoint(),
            "belief": self.belief.checkpoint(),
            "draws": self.rng.bit_generator.state,
            **self.base.checkpoint(),
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.given_up[:] = [(x, y) for x, y in checkpoint["given_up"]]
        self.looking.restore(checkpoint["looked"])
        self.belief.restore(checkpoint["belief"])
        self.rng.bit_generator.state = checkpoint["draws"]
        self.base.restore(checkpoint)


class Search(ABC):
    """Search for one class until there is a candidate to act on. Subclasses decide about the known
    candidates and choose where to explore."""

    def __init__(self, tools: SearchTools, phase: Phase, name: str, refused_m: float) -> None:
        """refused_m: radius around a refused candidate in which no other is tried."""
        self.tools, self.phase, self.name = tools, phase, name
        self.robot, self.settings = tools.robot, tools.settings
        self.base, self.looking, self.belief = tools.base, tools.looking, tools.belief
        self.refused = PlaceSet(refused_m)  # for the rest of the search
        self.unreachable = PlaceSet(refused_m)  # tried again once more ground is known
        self.rounds = tools.settings.rounds  # times that the home is searched
        self._waited_at: list[tuple[float, float]] = []  # centres of unreachable candidates, m
        self._doubts: dict[int, int] = {}  # instance id -> rejections from near
        self._round = self._first_round = 0
        self._latest_round = 0  # highest round so far: after an attempt, the rounds start again
        self._patrol = RevisitSearch(self.base, REVISIT_SPACING_M)
        self._acted_from: Pose2 | None = None
        self._first = -1.0, ""  # prefix of messages, until the used share of the budget changes
        self._left_at = "", 0  # identity of the map when a candidate was last found out of reach

    @abstractmethod
    def decide(self) -> Decision:
        """Decision about the known candidates: act on one, or search on."""

    @abstractmethod
    def explore(self) -> bool:
        """Take one exploration step; False when nothing is left."""

    def decide_and_publish(self) -> Decision:
        """Decide, publish the decision and return it: act on a candidate, or search on."""
        return self.publish(self.decide())

    def publish(self, decision: Decision) -> Decision:
        """Publish a decision and return it. Raises TypeError if it is something else."""
        if not isinstance(decision, Decision):  # a custom search may return anything
            raise TypeError(
                f"decide() gave a value of type {type(decision).__name__}; wanted a Decision, as "
                "act_on_best gives it"
            )
        if decision.candidates:
            self.robot.listener.on_decision(decision)
            self.tell(decision.why)
        return decision

    @property
    def threshold(self) -> float:
        """Score from which a candidate is acted on now."""
        return self.settings.tau_g

    def confirmed(self, near: ObjectInstance | None) -> bool:
        """True if the chosen candidate is still acted on. near: its estimate from near, None if the
        belief no longer holds it."""
        return near is not None

    @property
    def checks_from_near(self) -> bool:
        """True if a chosen candidate is checked once more in front of it."""
        return True

    def may_stop(self, near: ObjectInstance | None) -> bool:
        """True if a robot in front of the candidate that it was sent to find may stop there. near:
        as in `confirmed`."""
        return near is not None and near.score >= self.threshold

    def why_not(self, near: ObjectInstance | None) -> str:
        """Reason to reject a candidate after the view from near."""
        if near is None:
            return "from near it is no longer believed to be there"
        return f"from near it does not look like a {self.name}"

    def accept_any_after_share(self, after: float) -> None:
        """Accept the most likely candidate when nothing is left, and after that share of the task's
        steps; never if it is 1 or more. A search without a threshold always accepts it."""
        return

    def pick_unnamed(self, most: int) -> None:
        """Let the search choose things without the sought name, for a look in the hand, if it was
        in vain. most: number of such things."""
        return

    def accepted_as_likeliest(self, thing: ObjectInstance) -> bool:
        """True if the candidate was chosen only as the most likely one."""
        return False

    @property
    def accepted_any_candidate(self) -> bool:
        """True if the newest decision accepted the most likely candidate whatever its score."""
        return False

    def relax(self) -> bool:
        """Lower the demands on candidates when nothing is left to explore; False if none is
        left."""
        return False

    def end_if_absent(self) -> None:
        """Raise TaskFailed if the object is probably not there; nothing is left to explore now."""
        return

    def find(self) -> ObjectInstance:
        """Search until there is a candidate to act on. Raises TaskFailed when nothing is left."""
        first, self._first_round = self._first_round, 0
        for round_number in range(first, self.rounds):
            self._round = round_number
            self._latest_round = max(self._latest_round, round_number)
            if round_number > first:
                self.next_round()
            while True:
                decision = self.decide_and_publish()
                if decision.do is Do.ACT:
                    self._acted_from = self.robot.pose()
                    return self.chosen(decision)
                more = self.explore() or self.clear_way() or self.patrol()
                if self.end_waiting() or more:
                    continue
                self.end_if_absent()
                if not self.relax():
                    break
        raise self._not_found()

    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a restart, as JSON, for `restore`."""
        return {
            "round": self._round,
            "latest_round": self._latest_round,
            "waited_at": self._waited_at,
            "patrol": self._patrol.seen_from,
            "refused": self.refused.checkpoint(),
            "waiting": self.unreachable.checkpoint(),
            "doubts": list(self._doubts.items()),
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self._round = self._first_round = int(checkpoint["round"])
        self._latest_round = int(checkpoint.get("latest_round", self._round))
        self._waited_at = [(x, y) for x, y in checkpoint.get("waited_at", [])]
        self._patrol.seen_from = [(x, y) for x, y in checkpoint["patrol"]]
        self._doubts = {int(id): int(n) for id, n in checkpoint.get("doubts", [])}
        self.refused.restore(checkpoint["refused"])
        self.unreachable.restore(checkpoint["waiting"])

    def _not_found(self) -> TaskFailed:
        if self.phase is Phase.FIND_OBJECT:
            cause, where = Cause.OBJECT_NOT_FOUND, "every frontier and every candidate place"
        else:
            cause, where = Cause.RECEPTACLE_NOT_FOUND, "every frontier"
        said = f"no {self.name} was found: {where} was searched{self.robot.detector_trouble()}"
        return TaskFailed(cause, said)

    def tell(self, message: str) -> None:
        used, first = self._first
        said_first = [first] if used == self.robot.budget_used() else []
        self.robot.listener.on_phase(self.phase, self.name, "; ".join([*said_first, message]))

    def set_message_prefix(self, why: str) -> None:
        """Set the reason for searching again. It precedes every message until the robot acts."""
        self._first = self.robot.budget_used(), why

    def give_up(self, what: Act, thing: ObjectInstance, reason: str) -> None:
        """Record and publish why a chosen candidate is left; `what`: the intended action."""
        kind = "object" if self.phase is Phase.FIND_OBJECT else "receptacle"
        decision = give_up(what, thing, kind, reason)
        self.robot.listener.on_decision(decision)
        self.tell(decision.why)
        self.set_message_prefix(decision.why)

    # --- candidates ----------------------------------------------------------------------------
    def reject_or_postpone(self, candidate: ObjectInstance, out_of_reach: bool) -> None:
        """Leave a candidate for good or, if out of reach, until more ground is known."""
        if not out_of_reach:
            self.refused.add(candidate)
            return
        middle = _xy(candidate)
        if self.robot.pose() != self._acted_from:
            self._waited_at.append(middle)
        of_one = sum(math.dist(middle, m) < self.unreachable.same_m for m in self._waited_at)
        if of_one > MAX_UNREACHABLE_PER_CANDIDATE or len(self._waited_at) > MAX_UNREACHABLE:
            self.refused.add(candidate)
        elif self.accepted_any_candidate or not self.base.clear_way(
            middle, self._near_enough_m(candidate)
        ):
            self.unreachable.add(candidate)
            self._left_at = self.robot.ground().identity

    def doubt(self, candidate: ObjectInstance) -> None:
        """Count a rejection from near. Further views may make it a candidate again; after
        MOST_DOUBTS rejections it is refused."""
        self._doubts[candidate.id] = self._doubts.get(candidate.id, 0) + 1
        if self._doubts[candidate.id] >= MOST_DOUBTS:
            self.refused.add(candidate)

    def set_aside(self, candidate: ObjectInstance, probability: float) -> None:
        """Leave a candidate that looked wrong in the hand. probability: that it is right."""
        self.refused.add(candidate)

    def recall(self, thing: RefutedThing) -> None:
        """Leave a thing that looked wrong in the hand in an earlier task until the end."""
        return

    def in_hand(self, candidate: ObjectInstance) -> float:
        """Probability of its class by an earlier look at it in the hand; 1 without one."""
        return 1.0

    def was_set_aside(self, candidate: ObjectInstance) -> bool:
        """True if the candidate looked wrong in the hand before."""
        return self.in_hand(candidate) < 1

    def note_seen(self, candidate: ObjectInstance) -> None:
        """Record that a candidate was looked at in the hand."""
        return

    def end_waiting(self) -> bool:
        """Allow candidates that were out of reach again; True if the map has changed since."""
        waited = bool(self.unreachable.points)
        self.unreachable.clear()
        return waited and self.robot.ground().identity != self._left_at

    def _near_enough_m(self, candidate: ObjectInstance) -> float:
        """Distance from its centre at which some part of the candidate is in reach."""
        reach_m = self.robot.description.reach_m - REACH_SPARE_M
        return reach_m + float(min(candidate.size_m[:2])) / 2

    def open(self, candidate: ObjectInstance) -> bool:
        """True if a candidate is neither refused nor waiting."""
        return candidate not in self.refused and candidate not in self.unreachable

    def chosen(self, decision: Decision) -> ObjectInstance:
        """Instance that a decision chose. Raises TaskFailed if the belief no longer holds it."""
        for o in self.belief.known(self.name):
            if o.id == decision.chosen.id:
                return o
        raise TaskFailed(
            Cause.SYSTEM_ERROR,
            f"the object map no longer holds {self.name} {decision.chosen.id}, which was just "
            "chosen; see whether the object map restarted (`helios status`), and submit the task "
            "again",
        )

    # --- frontiers -----------------------------------------------------------------------------
    def frontier_options(self, layer: str) -> list[FrontierOption]:
        """Reachable frontiers, at the widest obstacle margin with which any is reachable."""
        pose = self.robot.pose()
        frontiers = self._open_frontiers()
        for level in self.base.levels:
            reached = self.base.reach(level)
            options = [
                FrontierOption(
                    f.id,
                    f.xy_m,
                    f.values.get(layer, 0.0),
                    pose.distance_m(f.xy_m),
                    pose.bearing_rad(f.xy_m),
                    float(reached.at(np.array([place]))[0]) * reached.ground.cell_m
                    + math.dist(place, f.xy_m),
                )
                for f in frontiers
                if (place := reached.nearest(f.xy_m, FRONTIER_REACH_M)) is not None
            ]
            if options:
                return options
        return []

    def _open_frontiers(self) -> Sequence[Frontier]:
        return [
            f
            for f in self.robot.frontiers()
            if all(math.dist(f.xy_m, g) > SAME_PLACE_M for g in self.tools.given_up)
        ]

    def _frontier_at(self, xy_m: tuple[float, float]) -> bool:
        return any(math.dist(f.xy_m, xy_m) <= SAME_PLACE_M for f in self.robot.frontiers())

    def visit_frontier(self, xy_m: tuple[float, float], found: Callable[[], bool]) -> None:
        """Drive near a frontier and look at it, until it is gone or `found()` is true. A frontier
        that remains is given up."""
        near = None
        for level in self.base.levels:
            near = self.base.reach(level).nearest(xy_m, FRONTIER_REACH_M)
            if near is not None:
                break
        if near is not None:
            outcome = self.base.go_to(
                facing(*near, xy_m),
                f"explore for the {self.name}",
                lambda: not self._frontier_at(xy_m) or found(),
            )
            if outcome is Outcome.INTERRUPTED:
                return
            if self._frontier_at(xy_m):
                pose = self.robot.pose()
                self.base.turn_to(pose.yaw_rad + pose.bearing_rad(xy_m))
            if self._frontier_at(xy_m):
                self.base.look_down_around()
        if self._frontier_at(xy_m):
            self.tools.given_up.append(xy_m)

    def clear_way(self) -> bool:
        """Look at unknown ground that blocks the path to a frontier or to a waiting candidate, when
        no frontier is in reach; False if there is none."""
        pose = self.robot.pose()
        targets = sorted((f.xy_m for f in self._open_frontiers()), key=pose.distance_m)
        targets += [(float(p[0]), float(p[1])) for p in self.unreachable.points]
        return any(self.base.clear_way(t, FRONTIER_REACH_M) for t in targets)

    def patrol(self) -> bool:
        """Look around from one more place, when nothing is left to explore after the first round;
        False if there is none."""
        if self._latest_round == 0:
            return False

        def found() -> bool:
            return self.decide().do is not Do.SEARCH_ON

        return self._patrol.step(f"look for the {self.name} from another side", found)

    def next_round(self) -> None:
        """Search everything once more, since a detector may miss an object in view."""
        self.tools.given_up.clear()
        self.looking.forget()
        self.base.look_around()
        self._patrol.begin()


def _xy(candidate: ObjectInstance) -> tuple[float, float]:
    return float(candidate.center_m[0]), float(candidate.center_m[1])


class RevisitSearch:
    """Visits the nearest place that is `apart_m` from all places where it has looked around."""

    def __init__(self, base: BaseController, apart_m: float) -> None:
        self._base, self._apart_m = base, apart_m
        self.seen_from: list[tuple[float, float]] = []  # x, y in m

    def begin(self) -> None:
        """Start again from the present place, where the robot has just looked around."""
        self.seen_from = [self._base.robot.pose().xy]

    def step(self, purpose: str, found: Callable[[], bool]) -> bool:
        """Look around from one more place, until `found()` is true; False when none is left."""
        place = next_place(self._base.reach(), self.seen_from, self._apart_m)
        if place is None:
            return False
        pose = self._base.robot.pose()
        goal = Pose2(*place, pose.yaw_rad)
        outcome = self._base.go_to(goal, purpose, found, face=False)
        if outcome is Outcome.INTERRUPTED:
            return True
        self.seen_from.append(place)
        if outcome is Outcome.ARRIVED:
            self._base.turn_around(found)
        return True


def next_place(
    reached: Reach, seen_from: Sequence[tuple[float, float]], apart_m: float
) -> tuple[float, float] | None:
    """Place with the shortest path that is `apart_m` or more from all of `seen_from`; None if there
    is none. World x, y in m."""
    stride = max(1, round(GRID_M / reached.ground.cell_m))
    arrival = reached.arrival[::stride, ::stride]
    cells = np.argwhere(np.isfinite(arrival))
    if not len(cells):
        return None
    xy = reached.ground.centres_of(cells * stride)
    far = np.ones(len(xy), bool)
    for x_m, y_m in seen_from:
        far &= np.hypot(xy[:, 0] - x_m, xy[:, 1] - y_m) >= apart_m
    if not far.any():
        return None
    way = np.where(far, arrival[cells[:, 0], cells[:, 1]], np.inf)
    k = int(np.argmin(way))
    return float(xy[k, 0]), float(xy[k, 1])
