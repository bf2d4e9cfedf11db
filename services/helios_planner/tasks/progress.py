"""Progress of a task, and the range of seconds until its end.

The steps left are a range. The fewest assume that the sought object is at the end of the present
path, the most that it is at the last of the known places. Seconds are steps times the seconds per
step of this task so far. The result of a search cannot be predicted: the range is wide where little
is known.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

from helios_planner.instruction.parser import Kind
from helios_planner.task import Phase

LEAST_STEPS = 5  # before an estimate is published
RECENT = 20  # newest steps, whose pace may differ from the whole task's
LONGEST_STEP_S = 120.0  # a longer step does not count for the pace

# Steps of a phase without any knowledge: about the fewest and the most in the simulated homes with
# a perfect detector (docs/results/ground-truth).
TYPICAL: Mapping[Phase, tuple[float, float]] = {
    Phase.FIND_OBJECT: (20, 300),
    Phase.PICK: (3, 40),
    Phase.FIND_RECEPTACLE: (3, 200),
    Phase.PLACE: (3, 40),
    Phase.GO: (1, 80),  # to another room and around obstacles
    Phase.EXPLORE: (20, 300),
}
UNKNOWN_PHASE = (1.0, 300.0)
PHASES: Mapping[Kind, Sequence[Phase]] = {
    Kind.MOVE: (Phase.FIND_OBJECT, Phase.PICK, Phase.FIND_RECEPTACLE, Phase.PLACE)
}
STEPS_A_PLACE = 25.0  # to go to a place and look, before this task has visited any
STEPS_A_M = (1.0, 8.0)  # per metre of path: straight, or with many turns
ROUNDS = 2  # a search may go over all places once more
LEAST_PROGRESS_SHARE = 0.001  # least progress per step, as a share of the rest
MOST_PROGRESS = 0.99  # before it has succeeded


class ProgressEstimate:
    """Estimate for one life of a task, updated by one thread. `progress` never falls."""

    def __init__(self, kind: Kind, max_steps: int, steps: int, progress: float) -> None:
        """steps, progress: values at the start of this life."""
        self._kind, self._max_steps, self._steps = kind, max_steps, steps
        self.progress = progress
        self._phase: Phase | None = None
        self._phase_began = steps
        self._places, self._decided = 0, 0  # places left to visit; decisions in this phase
        self._way_m = 0.0
        self._last_s: float | None = None  # time of the newest step; None after a pause
        self._took_s, self._counted = 0.0, 0
        self._recent_s: deque[float] = deque(maxlen=RECENT)

    # --- events --------------------------------------------------------------------------------
    def on_step(self, steps: int, now_s: float) -> None:
        """Count a finished step; now_s: time of any monotonic clock."""
        if self._last_s is not None and 0 <= (took_s := now_s - self._last_s) <= LONGEST_STEP_S:
            self._took_s, self._counted = self._took_s + took_s, self._counted + 1
            self._recent_s.append(took_s)
        self._last_s, self._steps = now_s, steps
        self._rise(self.progress + LEAST_PROGRESS_SHARE * max(MOST_PROGRESS - self.progress, 0.0))
        self._rise_to_now()

    def on_rest(self) -> None:
        """The robot stands: the time until the next step does not count."""
        self._last_s = None

    def on_phase(self, phase: Phase) -> None:
        if phase is not self._phase:
            self._phase, self._phase_began = phase, self._steps
            self._places, self._decided, self._way_m = 0, 0, 0.0

    def on_choice(self, places: int) -> None:
        """Count a decision for the next place, among this number of places."""
        self._places, self._decided = places, self._decided + 1

    def on_way(self, length_m: float) -> None:
        self._way_m = length_m

    # --- estimates -----------------------------------------------------------------------------
    def eta_s(self, left_s: float = math.inf) -> tuple[float, float] | None:
        """Seconds until its end, at least and at most; None before LEAST_STEPS steps. left_s: until
        its time limit."""
        if self._counted < LEAST_STEPS:
            return None
        whole_s = self._took_s / self._counted
        recent_s = sum(self._recent_s) / len(self._recent_s)
        low, high = self.steps_left()
        high_s = min(high * max(whole_s, recent_s), max(left_s, 0.0))
        return min(low * min(whole_s, recent_s), high_s), high_s

    def steps_left(self) -> tuple[float, float]:
        """Fewest and most steps until its end."""
        phases = PHASES.get(self._kind, ())
        later = phases[phases.index(self._phase) + 1 :] if self._phase in phases else ()
        if self._phase is None:
            low, high = map(sum, zip(*map(_typical, phases or (None,)), strict=True))
        else:
            low, high = self._left_of_phase()
        low += sum(_typical(phase)[0] for phase in later)
        high += sum(_typical(phase)[1] for phase in later)
        budget = float(max(self._max_steps - self._steps, 0))
        return min(low, budget), min(max(low, high), budget)

    def _left_of_phase(self) -> tuple[float, float]:
        done = self._steps - self._phase_began
        low, high = self._way_m * STEPS_A_M[0], self._way_m * STEPS_A_M[1]
        if self._decided:
            a_place = max(done / self._decided, STEPS_A_PLACE)
            return max(low, 1.0), max(high, ROUNDS * (self._places + 1) * a_place)
        typical = _typical(self._phase)
        return max(low, typical[0] - done, 1.0), max(high, typical[1] - done, float(done))

    def _rise_to_now(self) -> None:
        low, high = self.steps_left()
        likely = math.sqrt(max(low, 1.0) * max(high, 1.0))
        self._rise(self._steps / (self._steps + likely))

    def _rise(self, to: float) -> None:
        self.progress = max(self.progress, min(to, MOST_PROGRESS))


def _typical(phase: Phase | None) -> tuple[float, float]:
    return UNKNOWN_PHASE if phase is None else TYPICAL.get(phase, UNKNOWN_PHASE)
