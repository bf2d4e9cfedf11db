"""Result of `helios chaos`, and its limits."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from helios_eval.provenance import commit, machine

from helios_chaos.figures import percentiles
from helios_chaos.schedule import Kind
from helios_chaos.tasks import PlayedTask

MOST_P95_S, MOST_STILL_S = 5.0, 1.0
LEAST_MOVES = 5  # tasks to move a thing from which one at least has to succeed


@dataclass(frozen=True)
class PlayedFault:
    """A fault that was played. Times in seconds."""

    at_s: float  # after the start of the first task
    kind: str
    target: str
    lasted_s: float
    size: float  # delay in s, rate in Mbit/s or jump in s
    acting_again_s: float | None  # from its end to the end of the next action begun after it
    still_after_s: float | None  # from its start until the robot stood or might drive again
    driving: bool | None = None  # whether the robot drove at its start; None: not looked at


@dataclass
class ChaosResult:
    """Result of a run. between_actions_s: times between the ends of all actions."""

    minutes: float
    seed: int
    tasks: list[PlayedTask]
    faults: list[PlayedFault]
    between_actions_s: list[float]
    map_faults: list[str]
    journal_faults: list[str] = field(default_factory=list)
    orphans: int = 0
    skipped: dict[Kind, str] = field(default_factory=dict)

    def misses(self) -> list[str]:
        """Limits that the run does not meet; empty if it meets them all."""
        figures = self.as_json()
        again, still = figures["acting_again_s"]["p95"], figures["still_after_s"]["max"]
        out = [f"task {t.id} is lost: {t.untrue or t.state}" for t in self.tasks if t.lost]
        out += self.journal_faults + self.map_faults
        if self.orphans:
            out.append(f"{self.orphans} processes were left behind")
        if figures["moves"] >= LEAST_MOVES and not figures["moves_succeeded"]:
            out.append(f"none of {figures['moves']} tasks to move a thing succeeded")
        if never := figures["never_acted_again"]:
            out.append(f"the robot did not act again after {never} faults")
        if again is not None and again > MOST_P95_S:
            out.append(f"p95 of acting again is {again:g} s; wanted at most {MOST_P95_S:g} s")
        if still is not None and still > MOST_STILL_S:
            out.append(f"the robot stood after {still:g} s; wanted at most {MOST_STILL_S:g} s")
        return out

    def as_json(self) -> dict[str, Any]:
        again = [f.acting_again_s for f in self.faults if f.acting_again_s is not None]
        still = [f.still_after_s for f in self.faults if f.still_after_s is not None]
        ends = [task.state for task in self.tasks]
        moves = [task.state for task in self.tasks if task.moves_a_thing]
        return {
            "machine": machine(), "commit": commit(),
            "minutes": round(self.minutes, 2), "seed": self.seed, "tasks": len(self.tasks),
            "succeeded": ends.count("succeeded"), "failed": ends.count("failed"),
            "cancelled": ends.count("cancelled"), "lost": sum(t.lost for t in self.tasks),
            "unjudged": sum(t.unjudged for t in self.tasks),
            "moves": len(moves), "moves_succeeded": moves.count("succeeded"),
            "hit_while_driving": sum(bool(f.driving) for f in self.faults),
            "faults": [asdict(fault) for fault in self.faults],
            "acting_again_s": percentiles(again, 50, 95),
            "never_acted_again": len(self.faults) - len(again),
            "still_after_s": percentiles(still, 50, 95),
            "between_actions_s": percentiles(self.between_actions_s, 50, 95),
            "journal_ok": not self.journal_faults, "journal_faults": self.journal_faults,
            "map_ok": not self.map_faults, "map_faults": self.map_faults,
            "orphans": self.orphans,
            "skipped": [{"kind": k, "reason": why} for k, why in self.skipped.items()],
            "played": [asdict(task) | {"lost": task.lost} for task in self.tasks],
        }  # fmt: skip
