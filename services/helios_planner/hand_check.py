"""Look at a picked object before it is carried away; put a wrong one back. Not in the paper."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from helios_core.robot import Place, Show
from helios_core.types import ObjectInstance
from numpy.typing import NDArray

from helios_planner.decisions.acceptance import check_in_hand
from helios_planner.decisions.decision import Act, Decision, Do
from helios_planner.decisions.held_object import HeldObject
from helios_planner.motion_planning.base_placement import tilt_towards, top_at_m
from helios_planner.navigation.base_controller import BaseController
from helios_planner.refuted_things import RefutedThing, RefutedThings
from helios_planner.robot.interface import RobotInterface
from helios_planner.search.base import Search
from helios_planner.search.unnamed_things import is_unnamed
from helios_planner.settings import Settings
from helios_planner.task import Phase

RAISED_M = (0.01, 0.10)  # heights above the old place from which the object is released
NEARER_M = (0.06, 0.12)  # shifts of the place towards the robot, if it cannot be reached
SUPPORT_M = 0.03  # radius and depth within which a shifted place must have a surface
# Probability from which an object that was put back is brought after all, without a better one.
RECONSIDERED_FROM = 0.1
UNNAMED_ODDS = 0.25  # prior odds of a thing without the name, against one with it


def bottom_of(thing: ObjectInstance) -> NDArray[np.float64]:
    """Middle [3] of the lower side of its box, world."""
    x, y, z = (float(v) for v in thing.center_m)
    return np.array([x, y, z - float(thing.size_m[2]) / 2])


def with_odds_times(probability: float, factor: float) -> float:
    """Probability after its odds are multiplied by a factor."""
    odds = factor * probability / max(1 - probability, 1e-6)
    return odds / (1 + odds)


@dataclass
class HandCheck:
    """Views of the picked object from several sides, and the return of a wrong one."""

    robot: RobotInterface
    base: BaseController
    settings: Settings
    put_back: int = 0  # wrong objects so far
    cannot_show: bool = False  # True once the robot failed to show what it holds
    returning_m: NDArray[np.float64] | None = None  # place [3] of a wrong object still in the hand
    unseen_m: NDArray[np.float64] | None = None  # place [3] of an unnamed thing, until it is seen
    unchecked: bool = False  # True from a successful pick until the look at it is over
    refuted: RefutedThings = field(default_factory=RefutedThings)  # of earlier tasks, too

    # --- restart -------------------------------------------------------------------------------
    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a crash of the planner, as JSON, for `restore`."""
        places = {"returning_m": self.returning_m, "unseen_m": self.unseen_m}
        listed = {name: None if at is None else at.tolist() for name, at in places.items()}
        return {"put_back": self.put_back, "unchecked": self.unchecked} | listed

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        self.put_back = int(checkpoint.get("put_back", 0))
        self.unchecked = bool(checkpoint.get("unchecked", False))  # older journals lack it
        for name in ("returning_m", "unseen_m"):
            at = checkpoint.get(name)
            setattr(self, name, None if at is None else np.array(at, float))

    def returns_unseen(self) -> bool:
        """True if the held thing is an unnamed one, and a restart interrupted the look at it. It
        goes back to its place, where it is tried again."""
        if self.unseen_m is None:
            return False
        self.returning_m, self.unseen_m, self.unchecked = self.unseen_m, None, False
        return True

    def resume(self) -> bool:
        """Go on with a return that a restart interrupted. False if the object cannot be put back:
        it is still held."""
        if self.robot.held():
            return self._put_back()
        self._note_returned()
        return True

    # --- the check -----------------------------------------------------------------------------
    def recall(self, search: Search) -> None:
        """Leave things that looked wrong in earlier tasks until nothing better is found."""
        if self.can_look:
            for thing in self.refuted.of(search.name):
                search.recall(thing)

    @property
    def can_look(self) -> bool:
        """True if the robot can show what it holds, and the settings ask for it."""
        can = self.robot.description.show_base_m is not None and not self.cannot_show
        return can and self.settings.hand_sides > 0

    def refutes(self, search: Search, found: ObjectInstance, picks: int) -> bool:
        """True if the picked object looked wrong from its sides and was put back. picks: so far;
        after the last one an object is kept unseen, but no unnamed thing. One that was set aside
        before is kept. Raises Dropped."""
        s, unnamed = self.settings, is_unnamed(found)
        last = s.max_picks and picks >= s.max_picks
        x, y, z = (float(v) for v in found.center_m)
        if search.was_set_aside(found) or not self.can_look or (last and not unnamed):
            self.refuted.forget(search.name, (x, y, z))  # it is taken away
            self.unchecked = False
            return False
        self._tell(search, f"looking at the picked {search.name} from {s.hand_sides} sides")
        held = self._look(search.name)
        self.unseen_m, self.unchecked = None, False
        search.note_seen(found)
        if held is None:
            return unnamed and self._returns_unshown(search, found)
        if unnamed:
            known = held.sides > 0 or held.image_text_nats is not None
            before = held.probability if known else 0.5
            held = replace(held, probability=with_odds_times(before, UNNAMED_ODDS))
        decision = self._publish(search, check_in_hand(found, held, s.hand_from))
        if decision.do is Do.ACT:
            self.refuted.forget(search.name, (x, y, z))
            return False
        if held.probability >= RECONSIDERED_FROM:
            search.set_aside(found, held.probability)
        elif not unnamed:  # what lies beside an unnamed thing is tried, too
            search.refused.add(found)
        self.refuted.add(
            RefutedThing(search.name, (x, y, z), held.probability, unnamed, time.time())
        )
        self.returning_m = bottom_of(found)
        if not self._put_back():
            self.refuted.forget(search.name, (x, y, z))
            why = "which cannot be put back where it was"
            self._publish(search, check_in_hand(found, held, s.hand_from, why))
            return False
        search.set_message_prefix(decision.why)
        return True

    def _returns_unshown(self, search: Search, found: ObjectInstance) -> bool:
        """Put an unnamed thing back that could not be shown; no other is picked then. False if the
        robot still holds it."""
        search.pick_unnamed(0)
        search.give_up(Act.PICK, found, "the robot cannot show what it holds")
        self.returning_m = bottom_of(found)
        return self._put_back()

    def _publish(self, search: Search, decision: Decision) -> Decision:
        self.robot.listener.on_decision(decision)
        self._tell(search, decision.why)
        return decision

    def _tell(self, search: Search, message: str) -> None:
        self.robot.listener.on_phase(Phase.PICK, search.name, message)

    def _look(self, class_name: str) -> HeldObject | None:
        """Show the held object from all sides. None if it cannot be shown."""
        x, y, z = self.robot.description.show_base_m or (0.0, 0.0, 0.0)
        self.base.tilt(tilt_towards(math.hypot(x, y), z, self.robot.description))
        for k in range(self.settings.hand_sides):
            angle_rad = 2 * math.pi * k / self.settings.hand_sides
            if not self.base.monitor.act(Show(angle_rad)).succeeded:
                self.cannot_show = True
                return None
        return self.robot.held_object(class_name)

    def _put_back(self) -> bool:
        """Release the object where it was picked, or beside it. False if the robot still holds
        it."""
        assert self.returning_m is not None
        for x, y, z in self._return_points(self.returning_m):
            for raised_m in RAISED_M:
                self.base.monitor.act(Place((x, y, z + raised_m)))
                if not self.robot.held():
                    self._note_returned()
                    return True
        self.returning_m = None
        return False

    def _return_points(self, place_m: NDArray[np.float64]) -> list[tuple[float, float, float]]:
        """The place, then those nearer to the robot on the same surface."""
        x, y, z = (float(v) for v in place_m)
        here = self.robot.pose()
        away_m = max(here.distance_m((x, y)), 1e-6)
        to_robot = (here.x_m - x) / away_m, (here.y_m - y) / away_m
        nearer = [(x + d * to_robot[0], y + d * to_robot[1]) for d in NEARER_M]
        ground = self.robot.ground()
        on_it = [xy for xy in nearer if abs(top_at_m(ground, xy, SUPPORT_M) - z) <= SUPPORT_M]
        return [(x, y, z), *((*xy, z) for xy in on_it)]

    def _note_returned(self) -> None:
        self.base.monitor.carrying = False
        self.put_back += 1
        self.returning_m = None
