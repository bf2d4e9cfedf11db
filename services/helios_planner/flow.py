"""The flow of a task (paper section 3.2, appendix 6.1; docs in `paper-notes`).

find object -> pick -> find receptacle -> place, over a `Body`. All knowledge of what was visited,
chosen and doubted lives here for one task; what is believed lives in the maps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from helios_core.types import ObjectInstance

from helios_planner.body import Body, Frontier
from helios_planner.decide import (
    Decision,
    Do,
    FrontierOption,
    ReceptacleOption,
    act_or_look,
    frontier_by_value,
    global_search,
)
from helios_planner.gaze import outline_of
from helios_planner.grid import facing
from helios_planner.instruction import Instruction, Kind
from helios_planner.legs import Legs, Outcome
from helios_planner.look import BestView, Looking, Places
from helios_planner.objective import ChosenFrontier, FirstSeen, SearchMemory, normalised_gain
from helios_planner.settings import Settings
from helios_planner.skills import Done, Skills
from helios_planner.task import Cause, Phase, TaskFailed

MOST_WAITS = 8  # times in one task that something out of reach is tried again
PICK_LAYER, PLACE_LAYER = "pick", "place"


class Mission:
    """One task from beginning to end; `run` returns the sentence of its success."""

    def __init__(self, body: Body, instruction: Instruction, settings: Settings) -> None:
        self.body, self.instruction, self.settings = body, instruction, settings
        self.legs = Legs(body, settings)
        self.looking = Looking(body, self.legs, settings)
        self.skills = Skills(body, self.legs, settings)
        self.memory = SearchMemory()
        self.visited = Places(settings.same_place_m)
        self.doubted = Places(0.15)
        self.refused = Places(settings.same_place_m)  # receptacles that could not be placed on
        self.waiting = Places(settings.same_place_m)  # out of reach until more ground is known
        self._waited = 0
        self.given_up: list[tuple[float, float]] = []  # frontiers that stayed after a visit
        self._last_seen: dict[str, tuple] = {}

    def run(self) -> str:
        """Raises TaskFailed and TaskCancelled."""
        i = self.instruction
        if i.kind is Kind.GO_TO:
            assert i.goal
            self._tell(Phase.FIND_RECEPTACLE, i.goal, "looking around")
            self.legs.look_around()
            self._go_to(i.goal)
            return f"stands at the {i.goal}"
        assert i.object
        self._tell(Phase.FIND_OBJECT, i.object, "looking around")
        self.legs.look_around()
        if i.kind is Kind.FIND:
            found = self._find_object(i.object)
            self._show(found, i.object)
            x, y, z = found.center_m
            return f"found the {i.object} at ({x:.2f}, {y:.2f}, {z:.2f}) m"
        assert i.goal
        picked_at = self._find_and_pick(i.object)
        self._find_and_place(i.goal, picked_at)
        return f"put the {i.object} on the {i.goal}"

    # --- object --------------------------------------------------------------------------------
    def _find_and_pick(self, name: str) -> np.ndarray:
        """Until something is held; where it was."""
        while True:
            found = self._find_object(name)
            self._tell(Phase.PICK, name, f"going to pick the {name}")
            done = self.skills.pick(found, name)
            if done is Done.SUCCEEDED:
                return np.asarray(found.center_m)
            # Failed: leave it. Doubted: its score fell by looking, so views decide whether it comes
            # back. Out of reach: there may be a way that is not known yet.
            if done is Done.OUT_OF_REACH:
                self._wait_for(found, self.doubted)
            elif done is Done.FAILED:
                self.doubted.add(found)
            self._tell(Phase.FIND_OBJECT, name, f"the pick did not work ({done.name.lower()})")

    def _find_object(self, name: str) -> ObjectInstance:
        """Flow 1 and 2: look until an object has Psi >= tau_g."""
        for round_number in range(self.settings.rounds):
            while True:
                decision, views = self._object_decision(name)
                if decision.do is Do.ACT:
                    self.body.tell_decision(decision)
                    return self._instance(decision, name)
                if decision.do is Do.LOOK:
                    self.body.tell_decision(decision)
                    self._extra_view(decision, views, name, self.settings.tau_g)
                else:
                    more = self._search_step(name)
                    if not self._end_waiting() and not more:
                        break
            self._next_round(round_number)
        if self.skills.picks:
            reason = self.skills.last_reason or "it was not held afterwards"
            raise TaskFailed(
                Cause.PICK_FAILED, f"{self.skills.picks} picks of a {name} failed: {reason}"
            )
        raise TaskFailed(
            Cause.OBJECT_NOT_FOUND,
            f"no {name} was found: every frontier and every candidate place was searched",
        )

    def _object_decision(self, name: str) -> tuple[Decision, dict[int, BestView | None]]:
        s = self.settings
        things = [
            o for o in self.body.objects(name)
            if o.class_score >= s.cs_g and o not in self.doubted and o not in self.waiting
        ]  # fmt: skip
        starts = self._start_receptacles()
        pairs = [
            self.looking.option(o, name, s.tau_g, any(_on(o, r) for r in starts)) for o in things
        ]
        decision = act_or_look([p[0] for p in pairs], s.tau_g, s.tau_inc, "object", "pick")
        return decision, {o.id: p[1] for o, p in zip(things, pairs, strict=True)}

    def _something_to_do(self, name: str) -> bool:
        """Whether the search is to be interrupted for a candidate object."""
        seen = tuple((o.id, o.views, round(o.score, 3)) for o in self.body.objects(name))
        if not seen or self._last_seen.get(name) == seen:
            return False
        self._last_seen[name] = seen
        return self._object_decision(name)[0].do in (Do.ACT, Do.LOOK)

    def _extra_view(
        self, decision: Decision, views: dict[int, BestView | None], name: str, threshold: float
    ) -> None:
        view = views[decision.chosen.id]
        assert view is not None
        thing = self._instance(decision, name)

        def sure() -> bool:
            return any(
                o.score >= threshold and o not in self.doubted for o in self.body.objects(name)
            )

        self.looking.go_and_look(thing, view.gaze, f"another view of the {name}", sure)

    def _instance(self, decision: Decision, name: str) -> ObjectInstance:
        chosen = decision.chosen
        for o in self.body.objects(name):
            if o.id == chosen.id:
                return o
        raise TaskFailed(
            Cause.SYSTEM_ERROR, f"the object map lost {name} {chosen.id} between two questions"
        )

    # --- search for the object -----------------------------------------------------------------
    def _start_receptacles(self) -> list[ObjectInstance]:
        start = self.instruction.start
        if not start:
            return []
        return [o for o in self.body.objects(start) if o.class_score >= self.settings.cs_a]

    def _search_step(self, name: str) -> bool:
        """One step of the global search (flow 1); False when nothing is left."""
        s = self.settings
        options = self._receptacle_options()
        frontiers = self._frontier_options(PICK_LAYER)
        decision = global_search(options, frontiers, self.memory, s.alpha_d)
        self.body.tell_decision(decision)
        if decision.do is Do.NOTHING_LEFT:
            return False
        self._tell(Phase.FIND_OBJECT, name, decision.why)
        chosen = decision.chosen
        if decision.do is Do.GO_TO_FRONTIER:
            value = chosen.terms["value"]
            self.memory.chosen.append(ChosenFrontier(chosen.position_m[:2], value))
            self._visit_frontier(chosen.position_m[:2], name)
        else:
            receptacle = next(o.instance for o in options if o.instance.id == chosen.id)
            self._local_search(receptacle, name)
        return True

    def _receptacle_options(self) -> list[ReceptacleOption]:
        start = self.instruction.start
        pose = self.body.pose()
        options = []
        for r in self._start_receptacles():
            if r in self.visited:
                continue
            assert start
            gain = self.looking.information_gain_nats(r, start)
            if gain is None:
                continue
            normalised = normalised_gain(gain, r.gaussians, self.settings.gain_norm)
            centre = (float(r.center_m[0]), float(r.center_m[1]))
            self.memory.note(r.id, FirstSeen(r.class_score, normalised, centre))
            options.append(ReceptacleOption(r, r.class_score, normalised, pose.distance_m(centre)))
        return options

    def _local_search(self, receptacle: ObjectInstance, name: str) -> None:
        """All gaze points of a receptacle, nearest first; then it is visited."""
        start = self.instruction.start or receptacle.class_name
        while points := self.looking.around(receptacle):
            outcome = self.looking.go_and_look(
                receptacle, points[0], f"look for the {name} on the {start}",
                lambda: self._something_to_do(name),
            )  # fmt: skip
            if outcome is Outcome.INTERRUPTED or self._something_to_do(name):
                return
        self.visited.add(receptacle)

    def _wait_for(self, candidate: ObjectInstance, otherwise: Places) -> None:
        """Leave a candidate until more ground is known; for good after some times."""
        self._waited += 1
        if self._waited > MOST_WAITS:
            otherwise.add(candidate)
        else:
            self.waiting.add(candidate)

    def _end_waiting(self) -> bool:
        """Candidates that were out of reach may be tried again; whether there were any."""
        waited = bool(self.waiting.points)
        self.waiting.clear()
        self._last_seen.clear()
        return waited

    # --- frontiers -----------------------------------------------------------------------------
    def _frontier_options(self, layer: str) -> list[FrontierOption]:
        pose = self.body.pose()
        reach_m = self.settings.frontier_reach_m
        for level in self.legs.levels:
            reached = self.legs.reach(level)
            options = [
                FrontierOption(f.id, f.xy_m, f.values.get(layer, 0.0), pose.distance_m(f.xy_m))
                for f in self._open_frontiers()
                if reached.nearest(f.xy_m, reach_m) is not None
            ]
            if options:
                return options
        return []

    def _open_frontiers(self) -> Sequence[Frontier]:
        return [
            f for f in self.body.frontiers()
            if all(math.dist(f.xy_m, g) > self.settings.same_place_m for g in self.given_up)
        ]  # fmt: skip

    def _frontier_at(self, xy_m: tuple[float, float]) -> bool:
        same = self.settings.same_place_m
        return any(math.dist(f.xy_m, xy_m) <= same for f in self.body.frontiers())

    def _visit_frontier(self, xy_m: tuple[float, float], name: str) -> None:
        def stop() -> bool:
            return not self._frontier_at(xy_m) or self._something_to_do(name)

        self._drive_to_frontier(xy_m, name, stop)

    def _drive_to_frontier(
        self, xy_m: tuple[float, float], name: str, stop: Callable[[], bool]
    ) -> None:
        """Drive near, look at it; what is still a frontier then is given up."""
        reached = next(
            (p for level in self.legs.levels
             if (p := self.legs.reach(level).nearest(xy_m, self.settings.frontier_reach_m))),
            None,
        )  # fmt: skip
        if reached is not None:
            goal = facing(*reached, xy_m)
            if self.legs.go_to(goal, f"explore for the {name}", stop) is Outcome.INTERRUPTED:
                return
            if self._frontier_at(xy_m):
                pose = self.body.pose()
                self.legs.turn_to(pose.yaw_rad + pose.bearing_rad(xy_m))
            if self._frontier_at(xy_m):
                self.legs.look_down_around()
        if self._frontier_at(xy_m):
            self.given_up.append(xy_m)

    def _next_round(self, round_number: int) -> None:
        """Everything was searched: once more, since a detector may miss what it saw."""
        if round_number + 1 < self.settings.rounds:
            self.visited.clear()
            self.given_up.clear()
            self.looking.forget()
            self.legs.look_around()

    # --- receptacle ----------------------------------------------------------------------------
    def _find_and_place(self, goal: str, picked_at: np.ndarray | None) -> None:
        while True:
            found = self._find_receptacle(goal, picked_at)
            self._tell(Phase.PLACE, goal, f"going to place on the {goal}")
            done = self.skills.place(found, goal)
            if done is Done.SUCCEEDED:
                return
            if done is Done.OUT_OF_REACH:
                self._wait_for(found, self.refused)
            else:
                self.refused.add(found)
            self._tell(Phase.FIND_RECEPTACLE, goal, f"this {goal} did not work; another one")

    def _go_to(self, goal: str) -> None:
        while True:
            found = self._find_receptacle(goal, None)
            points = self.looking.around(found) or self.looking.views_of(found)
            for gaze in points:
                if self.looking.go_and_look(found, gaze, f"go to the {goal}") is Outcome.ARRIVED:
                    return
            pose = self.body.pose()
            if not points and pose.distance_m(found.center_m) < self.settings.frontier_reach_m:
                return
            self.refused.add(found)

    def _find_receptacle(self, goal: str, picked_at: np.ndarray | None) -> ObjectInstance:
        """Flow 3: look until a goal receptacle has Psi >= tau_b; frontiers by place value."""
        s = self.settings
        for round_number in range(s.rounds):
            while True:
                decision, views = self._place_decision(goal, picked_at)
                self.body.tell_decision(decision)
                self._tell(Phase.FIND_RECEPTACLE, goal, decision.why)
                if decision.do is Do.ACT:
                    return self._instance(decision, goal)
                if decision.do is Do.LOOK:
                    self._extra_view(decision, views, goal, s.tau_b)
                    continue
                decision = frontier_by_value(self._frontier_options(PLACE_LAYER), PLACE_LAYER)
                self.body.tell_decision(decision)
                if decision.do is not Do.NOTHING_LEFT:
                    self._tell(Phase.FIND_RECEPTACLE, goal, decision.why)
                    self._visit_place_frontier(decision.chosen.position_m[:2], goal, picked_at)
                if not self._end_waiting() and decision.do is Do.NOTHING_LEFT:
                    break
            self._next_round(round_number)
        if self.refused.points:
            reason = self.skills.last_reason or "no flat place on it was in reach"
            raise TaskFailed(Cause.PLACE_MISSED, f"placing on the {goal} failed: {reason}")
        raise TaskFailed(
            Cause.RECEPTACLE_NOT_FOUND, f"no {goal} was found: every frontier was explored"
        )

    def _goals(self, goal: str, picked_at: np.ndarray | None) -> list[ObjectInstance]:
        found = [
            o for o in self.body.objects(goal)
            if o.class_score >= self.settings.cs_b
            and o not in self.refused
            and o not in self.waiting
        ]  # fmt: skip
        if picked_at is not None and goal == self.instruction.start:
            found = [o for o in found if not _near_outline(o, picked_at, 0.2)]
        return found

    def _place_decision(
        self, goal: str, picked_at: np.ndarray | None
    ) -> tuple[Decision, dict[int, BestView | None]]:
        s = self.settings
        things = self._goals(goal, picked_at)
        pairs = [self.looking.option(o, goal, s.tau_b) for o in things]
        decision = act_or_look([p[0] for p in pairs], s.tau_b, s.tau_inc, "receptacle", "place")
        return decision, {o.id: p[1] for o, p in zip(things, pairs, strict=True)}

    def _visit_place_frontier(
        self, xy_m: tuple[float, float], goal: str, picked_at: np.ndarray | None
    ) -> None:
        """As for the object, but what interrupts is a goal receptacle."""
        before = {o.id for o in self._goals(goal, picked_at)}

        def stop() -> bool:
            now = self._goals(goal, picked_at)
            sure = any(o.score >= self.settings.tau_b for o in now)
            return not self._frontier_at(xy_m) or sure or any(o.id not in before for o in now)

        self._drive_to_frontier(xy_m, goal, stop)

    # --- telling -------------------------------------------------------------------------------
    def _show(self, thing: ObjectInstance, name: str) -> None:
        """Stand so that the found thing is in sight."""
        for gaze in self.looking.views_of(thing):
            if self.looking.go_and_look(thing, gaze, f"show the {name}") is Outcome.ARRIVED:
                return

    def _tell(self, phase: Phase, seeking: str, message: str) -> None:
        self.body.tell_phase(phase, seeking, message)


def _near_outline(receptacle: ObjectInstance, point_m: np.ndarray, within_m: float) -> bool:
    """Whether a point lies over a receptacle's ground projection, or this near to it."""
    hull = outline_of(receptacle).astype(np.float32).reshape(-1, 1, 2)
    return cv2.pointPolygonTest(hull, (float(point_m[0]), float(point_m[1])), True) >= -within_m


def _on(thing: ObjectInstance, receptacle: ObjectInstance) -> bool:
    return _near_outline(receptacle, np.asarray(thing.center_m), 0.15)
