"""Flow of a task with objects (paper section 3.2, appendix 6.1): find, pick, find, place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from helios_core.printable_text import counted
from helios_core.robot import Action, ActionResult, Observe, Pick, Place, Show
from helios_core.types import ObjectInstance

from helios_planner.agents import agent_named
from helios_planner.decisions.decision import Act
from helios_planner.decisions.explanations import less
from helios_planner.hand_check import HandCheck, bottom_of
from helios_planner.instruction.parser import Instruction, Kind
from helios_planner.manipulation import Manipulation, PlacementCheck, SkillOutcome, look_after
from helios_planner.match_radii import SAME_THING_M
from helios_planner.motion_planning.base_placement import GazePoint, nearest_to
from helios_planner.navigation.base_controller import Outcome, base_controller_for, never
from helios_planner.navigation.motion_monitor import Dropped
from helios_planner.robot.interface import RobotInterface
from helios_planner.search.base import FRONTIER_REACH_M, Search, SearchTools
from helios_planner.search.candidate_beliefs import MapBelief
from helios_planner.search.scored_search import ScoredSearch
from helios_planner.search.unnamed_things import is_unnamed
from helios_planner.search.view_selection import STOP_RULES, ViewPlanner
from helios_planner.settings import Settings
from helios_planner.task import Cause, ObjectAbsent, Phase, TaskFailed, TimeIsUp
from helios_planner.tasks.run_control import LastAction


class Mission:
    """One task from start to end; `run` returns the message of its success."""

    def __init__(
        self, robot: RobotInterface, instruction: Instruction, settings: Settings, agent: str = ""
    ) -> None:
        """agent: a name of `agents.AGENTS`; empty for that of the settings."""
        self.robot, self.instruction, self.settings = robot, instruction, settings
        self.agent = agent_named(agent or settings.agent)
        base = base_controller_for(robot, settings)
        belief = self.agent.belief(robot, settings)
        self.tools = SearchTools(
            robot,
            settings,
            base,
            ViewPlanner(robot, base, settings, self.agent.other_share),
            belief,
            np.random.default_rng(settings.agent_seed),
        )
        attempts = settings.picks_per_object if self.agent.retries else 1
        self.skills = Manipulation(robot, base, settings, belief, attempts)
        self.hand = HandCheck(robot, base, settings)
        self.looked_around = self.placed = False
        # True if the placed object is seen there; None: nothing is known to be placed
        self.seen_at_goal: bool | None = None
        self.target_m: np.ndarray | None = None  # centre of the object to pick
        self.picked_at_m: np.ndarray | None = None
        self.unsure: dict[Phase, str] = {}  # notes about doubtful choices, for the final message
        self._fell = ""  # message about a fall, for the next search
        self.search: Search | None = None  # the current one
        self._restored: Mapping[str, Any] | None = None  # checkpoint of the interrupted search
        robot.on_result = self._note_result

    def run(self) -> str:
        """Run the task; returns its message. Raises TaskFailed and TaskCancelled."""
        i = self.instruction
        if self.hand.returning_m is not None and not self.hand.resume():
            self.picked_at_m = self.target_m
        if i.kind is Kind.MOVE:
            return self._bring()
        self._look_around()
        if i.kind is Kind.GO_TO:
            assert i.goal
            self._go_to(i.goal)
            return f"stands at the {i.goal}"
        assert i.object
        search = self.agent.seek_object(self.tools, i.object, i.start)
        if isinstance(search, ScoredSearch):
            search.action = Act.STOP  # for its explanations
        return self._show(self._begun(search))

    def _bring(self) -> str:
        """Pick the object and place it, also after it fell; returns the message of the task. A
        time limit that passes after the placing does not fail the task."""
        i = self.instruction
        assert i.object
        assert i.goal
        if self.placed:  # placed before a restart: nobody looked since
            self.seen_at_goal = False
        elif self.picked_at_m is None:
            self._take_over(i.object)
        while not self.placed:
            try:
                self._look_around()
                if self.picked_at_m is None:
                    self.picked_at_m = self._pick(i.object, i.start)
                self._place(i.goal, self.picked_at_m if i.goal == i.start else None)
                self.placed = True
            except Dropped as fall:
                self.skills.count_fall(fall, i.object)
                self.picked_at_m, self.hand.unchecked = None, False
                self._fell = f"the {i.object} fell: {fall}"
            except TimeIsUp:
                if not self.placed:
                    raise
                self.seen_at_goal = False
        seen = "it is seen there" if self.seen_at_goal else "it was not seen there yet"
        return "; ".join([f"put the {i.object} on the {i.goal}", seen, *self.unsure.values()])

    def _look_around(self) -> None:
        """Look around once in a task. Raises Dropped."""
        if self.looked_around:
            return
        i = self.instruction
        phase = Phase.FIND_RECEPTACLE if i.kind is Kind.GO_TO else Phase.FIND_OBJECT
        self.robot.listener.on_phase(phase, i.object or i.goal or "", "looking around")
        self.tools.base.look_around(self._remembers_it)
        self.looked_around = True

    def _remembers_it(self) -> bool:
        """True if the search would act at once on what a stored map has, found again."""
        i, name = self.instruction, self.instruction.object or self.instruction.goal or ""
        if not isinstance(self.tools.belief, MapBelief):
            return False
        if not any(o.relocalised for o in self.robot.objects(name)):
            return False
        search = (
            self.agent.seek_object(self.tools, name, i.start)
            if i.object
            else self.agent.seek_receptacle(self.tools, name, None)
        )
        return isinstance(search, ScoredSearch) and search.remembers()

    def _take_over(self, name: str) -> None:
        """Use an object that an earlier task left in the gripper: the right one only needs to be
        placed. Raises TaskFailed for any other."""
        held = self.robot.held()
        if held and held != name:
            message = f"the gripper is not free for the {name}: a {held} is in it"
            raise TaskFailed(Cause.PICK_FAILED, message)
        if held:
            self.picked_at_m = np.array([*self.robot.pose().xy, 0.0])
            self.tools.base.monitor.carrying = True

    def _begun(self, search: Search) -> Search:
        """Make a search the current one; an interrupted search gets its checkpoint back."""
        restored, self._restored = self._restored, None
        if restored is not None and restored["phase"] == search.phase:
            search.restore(restored)
        self.search = search
        if self._fell:
            search.set_message_prefix(self._fell)
            self._fell = ""
        search.tell(f"looking for the {search.name}")
        return search

    # --- restart -------------------------------------------------------------------------------
    def _note_result(self, action: Action, result: ActionResult) -> None:
        """Record a successful pick or place for the checkpoint, before any other action begins."""
        if isinstance(action, Pick):
            self.hand.unchecked = bool(result.succeeded)
        elif isinstance(action, Place) and self.picked_at_m is not None:
            self.placed = bool(result.succeeded)

    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a crash of the planner, as JSON, for `restore`."""
        search = self.search
        return {
            "looked_around": self.looked_around,
            "placed": self.placed,
            "target_m": _listed(self.target_m),
            "picked_at_m": _listed(self.picked_at_m),
            "unsure": list(self.unsure.items()),
            "search": None if search is None else search.checkpoint() | {"phase": search.phase},
            **self.skills.checkpoint(),
            **self.hand.checkpoint(),
            **self.tools.checkpoint(),
        }

    def restore(self, checkpoint: Mapping[str, Any], last: LastAction) -> None:
        """Restore the state; `last`: outcome of the newest action. Raises TaskFailed."""
        self.looked_around = checkpoint["looked_around"]
        self.placed = checkpoint.get("placed", False) and not last.held  # older journals lack it
        self.target_m = _array(checkpoint["target_m"])
        self.picked_at_m = _array(checkpoint["picked_at_m"])
        self.unsure = {Phase(phase): said for phase, said in checkpoint["unsure"]}
        self.skills.restore(checkpoint)
        self.hand.restore(checkpoint)
        self.tools.restore(checkpoint)
        self._restored = checkpoint["search"]
        if self.picked_at_m is None:
            self._restore_pick(last)
        elif not self.placed and not last.held:
            self._restore_place(last)
        self.tools.base.monitor.carrying = self.picked_at_m is not None and not self.placed

    def _restore_pick(self, last: LastAction) -> None:
        """Find out whether an object was picked; `picked_at_m` is None before."""
        if last.held and self.hand.returns_unseen():
            return  # `run` puts it back and searches on
        if isinstance(last.action, Pick):
            if last.succeeded or (last.succeeded is None and last.held):
                self._was_picked(self.instruction.object or "")
            elif last.reason:
                self.skills.last_reason = last.reason
        elif last.held and self.hand.returning_m is None:
            if self.hand.unchecked and isinstance(last.action, Observe):
                self._was_picked(self.instruction.object or "")
            elif self.hand.unchecked or isinstance(last.action, Show):
                self.picked_at_m, self._restored = self.target_m, None

    def _restore_place(self, last: LastAction) -> None:
        """Find out whether the carried object was placed or fell. Raises TaskFailed after too many
        falls."""
        self.placed = isinstance(last.action, Place) and last.succeeded is not False
        if not self.placed:
            fall = Dropped(self.robot.pose().xy, last.reason or "the planner was away")
            self.skills.count_fall(fall, self.instruction.object or "")
            self.picked_at_m = self._restored = None

    def _was_picked(self, name: str) -> None:
        """Record a pick that succeeded while the planner was away."""
        assert self.target_m is not None
        self.picked_at_m, self._restored = self.target_m, None
        thing = nearest_to(self.target_m, self.tools.belief.known(name), SAME_THING_M)
        if thing is not None:
            self.tools.belief.taken(thing)

    def _pick(self, name: str, start: str | None) -> np.ndarray:
        """Search and pick until an object is held; returns where it was."""
        search = self.agent.seek_object(self.tools, name, start)
        search.accept_any_after_share(self.settings.pick_at_last)
        if self.hand.can_look:
            search.pick_unnamed(self.settings.unnamed_picks)
            self.hand.recall(search)
        self._begun(search)
        while True:
            try:
                found = search.find()
            except ObjectAbsent:
                raise
            except TaskFailed as failure:
                failed = self.skills.picks - self.hand.put_back
                if failure.cause is Cause.OBJECT_NOT_FOUND and failed:
                    reason = self.skills.last_reason or "it was not held afterwards"
                    message = f"{counted(failed, 'pick')} of a {search.name} failed: {reason}"
                    raise TaskFailed(Cause.PICK_FAILED, message) from failure
                raise
            self.target_m = np.asarray(found.center_m)
            self._note_if_unsure(search, found)
            self.robot.listener.on_phase(
                Phase.PICK, search.name, f"going to pick the {search.name}"
            )
            self.hand.unseen_m = bottom_of(found) if is_unnamed(found) else None
            done = self.skills.pick(found, search.name, search.confirmed)
            if done is not SkillOutcome.SUCCEEDED:
                self._give_up(search, Act.PICK, found, done)
            elif not self.hand.refutes(search, found, self.skills.picks):
                return np.asarray(found.center_m)

    def _place(self, goal: str, not_at: np.ndarray | None) -> None:
        """Search and place until the object is put down, then check if it is seen there."""
        search = self.agent.seek_receptacle(self.tools, goal, not_at)
        search.accept_any_after_share(self.settings.place_at_last)
        search.rounds = self.settings.rounds_held
        self._begun(search)
        while True:
            try:
                found = search.find()
            except TaskFailed as failure:
                tried = search.refused.points or self.skills.failed_places
                if failure.cause is Cause.RECEPTACLE_NOT_FOUND and tried:
                    reason = self.skills.last_reason or "no place on it was in reach"
                    message = f"placing on the {goal} failed: {reason}"
                    raise TaskFailed(Cause.PLACE_MISSED, message) from failure
                raise
            self._note_if_unsure(search, found)
            self.robot.listener.on_phase(Phase.PLACE, goal, f"going to place on the {goal}")
            name = self.instruction.object or ""
            before = list(self.tools.belief.known(name))
            done = self.skills.place(found, goal, search.confirmed)
            if done is SkillOutcome.SUCCEEDED:
                self.seen_at_goal = False  # until it is seen
                receptacle = self.skills.placed_on or found
                self.seen_at_goal = self._seen(name, receptacle, before)
                return
            self._give_up(search, Act.PLACE, found, done)

    def _note_if_unsure(self, search: Search, found: ObjectInstance) -> None:
        """Record a doubtful choice before the action, so that it outlives a restart."""
        self.unsure.pop(search.phase, None)
        if search.accepted_as_likeliest(found):
            said = f"no surer {search.name} was found than this one ({found.score:.2f})"
            self.unsure[search.phase] = said

    def _give_up(
        self, search: Search, what: Act, found: ObjectInstance, done: SkillOutcome
    ) -> None:
        """Leave or doubt a candidate, and publish the reason."""
        reason = self.skills.last_reason or "it did not work"
        if done is SkillOutcome.DOUBTED:
            reason = search.why_not(self.skills.near)
        elif done is SkillOutcome.OUT_OF_REACH:
            reason = "no way leads to where it is in reach"
        search.give_up(what, found, reason)
        if done is SkillOutcome.DOUBTED:
            search.doubt(found)
        else:
            search.reject_or_postpone(found, done is SkillOutcome.OUT_OF_REACH)

    def _seen(
        self, name: str, receptacle: ObjectInstance, before: Sequence[ObjectInstance]
    ) -> bool:
        """True if the placed object is seen on the receptacle. Raises TaskFailed if it is
        seen beside it."""
        least, surface_m = self.settings.cs_g, self.skills.surface_m
        seen, thing = look_after(
            self.robot, receptacle, before, lambda: self.tools.belief.known(name), least, surface_m
        )
        if seen is PlacementCheck.BESIDE_IT and thing is not None:
            x, y, z = thing.center_m
            raise TaskFailed(
                Cause.ROLLED_OFF,
                f"the {name} was placed on the {receptacle.class_name} and is seen beside it, at "
                f"({x:.2f}, {y:.2f}, {z:.2f}) m",
            )
        return seen is PlacementCheck.ON_IT

    def _go_to(self, goal: str) -> None:
        search = self.agent.seek_receptacle(self.tools, goal, None)
        if isinstance(search, ScoredSearch):
            search.action = Act.STOP  # for its explanations
        search = self._begun(search)
        looking, pose = self.tools.looking, self.robot.pose
        while True:
            found = search.find()
            points = looking.remaining_gaze_points(found) or looking.views_of(found)
            for gaze in points:
                if looking.go_and_look(found, gaze, f"go to the {goal}") is Outcome.ARRIVED:
                    return
            if not points and pose().distance_m(found.center_m) < FRONTIER_REACH_M:
                return
            search.reject_or_postpone(found, out_of_reach=True)

    def _show(self, search: Search) -> str:
        """Find an object and stop in front of it, or as near as a path leads. If the search checks
        from near, its score from there must still reach the threshold."""
        looking, near_m = self.tools.looking, max(STOP_RULES.distances_m)
        while True:
            used = self.robot.budget_used()
            found = search.find()
            stop = self._unsupported(found) if search.checks_from_near else never
            stood = self._stand(found, looking.stops_at(found), stop)
            if stood is Outcome.UNREACHABLE:
                x, y, _ = (float(v) for v in found.center_m)
                if self.tools.base.clear_way((x, y), near_m):
                    continue
                self._stand(found, looking.views_of(found), stop)
            seen = self.tools.belief.from_near(found, search.name, SAME_THING_M)
            if search.may_stop(seen):
                x, y, z = (seen or found).center_m
                return f"found the {search.name} at ({x:.2f}, {y:.2f}, {z:.2f}) m"
            worse = seen and f"from near its score is {less(seen.score, search.threshold)}"
            search.give_up(Act.STOP, found, worse or search.why_not(None))
            if self.robot.budget_used() == used:  # without a step, another try would end the same
                search.reject_or_postpone(found, out_of_reach=stood is Outcome.UNREACHABLE)

    def _unsupported(self, thing: ObjectInstance) -> Callable[[], bool]:
        return lambda: not self.tools.belief.still_supports(thing)

    def _stand(
        self, found: ObjectInstance, points: Sequence[GazePoint], stop: Callable[[], bool]
    ) -> Outcome:
        """Drive to the first reachable gaze point, until `stop()` is true."""
        go, purpose = self.tools.looking.go_and_look, f"show the {found.class_name}"
        for gaze in points:
            outcome = go(found, gaze, purpose, stop)
            if outcome is not Outcome.UNREACHABLE:
                return outcome
        return Outcome.UNREACHABLE


def _listed(point_m: np.ndarray | None) -> list[float] | None:
    return None if point_m is None else [float(v) for v in point_m]


def _array(point_m: Sequence[float] | None) -> np.ndarray | None:
    return None if point_m is None else np.asarray(point_m, float)
