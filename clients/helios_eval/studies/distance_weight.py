"""Study of the distance weight α_d (Tables 6 to 8) and of gain_norm in decisions of real episodes.

    python -m helios_eval.studies.distance_weight --episodes 12 --seed0 400 --gain-norm sum \
        --out runs/distance-weight

Plays episodes of `helios eval ovmm` up to the first pick, and collects every decision of the global
search (eq. 10); after the pick there is none. Then it repeats each decision from its stored inputs,
with other α_d and with every gain_norm. Decisions count if they had several candidates. A repeated
decision shows what would have changed at that moment; the episode behind it stays the one that was
played. Writes `episodes.jsonl` and `study.json`. Episodes in the folder are not played again. The
homes must be development homes.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from google.protobuf.json_format import MessageToDict, ParseDict
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.topics import CANCEL, DECISION, TASK
from helios_planner.decisions.counterfactual import flips, recompute, under_gain_norm
from helios_planner.decisions.decision import Decision, DecisionRule
from helios_planner.settings import GainNorm
from helios_planner.task import Phase
from helios_planner.tasks.messages import decision_from_proto

from helios_eval.episodes.episode_player import LONGEST_S, running_stack
from helios_eval.episodes.episode_record import append_line
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.episodes.run_conditions import parse_condition
from helios_eval.studies.development_homes import homes
from helios_eval.studies.jsonl_file import whole_lines

TABLES = (0.0001, 0.001, 0.01)  # α_d of Tables 6 to 8
WEIGHTS = (*TABLES, 0.1)
PRINTED = 0.001  # α_d of Table 3
NORMS: tuple[GainNorm, ...] = ("sum", "per_gaussian", "per_area", "per_pixel")
CALL_S = 60.0


@dataclass
class Row:
    """Decisions of the played episodes, repeated with one gain_norm."""

    norm: GainNorm
    decisions: int = 0  # with several candidates
    both: int = 0  # of these, with receptacles and frontiers
    receptacle: int = 0  # of both, won by a receptacle at the α_d of Table 3
    differs: int = 0  # of both, with another winner than with the gain_norm that was played
    changed: dict[float, int] | None = None  # α_d -> decisions with another winner than at Table 3
    changed_both: dict[float, int] | None = None  # the same, of both
    scales: list[float] = field(default_factory=list)  # F₀ (eq. 9) of both at Table 3's α_d

    def scale(self) -> str:
        """Median of F₀, for the table."""
        return f"{statistics.median(self.scales):.3g}" if self.scales else "–"

    def as_json(self) -> dict[str, Any]:
        return {
            "gain_norm": self.norm,
            "decisions": self.decisions,
            "both": self.both,
            "receptacle_wins": self.receptacle,
            "frontier_wins": self.both - self.receptacle,
            "other_winner_than_played": self.differs,
            "changed_by_alpha_d": {str(a): n for a, n in (self.changed or {}).items()},
            "changed_by_alpha_d_of_both": {str(a): n for a, n in (self.changed_both or {}).items()},
            "frontier_scale": [round(value, 4) for value in self.scales],
        }


def rows_of(decisions: Sequence[Decision], played: GainNorm) -> list[Row]:
    """One row per gain_norm. Raises InvalidInput if a decision does not hold its gains."""
    return [_row(decisions, norm, played) for norm in NORMS]


def _row(decisions: Sequence[Decision], norm: GainNorm, played: GainNorm) -> Row:
    row = Row(norm, changed=dict.fromkeys(WEIGHTS, 0), changed_both=dict.fromkeys(WEIGHTS, 0))
    assert row.changed is not None
    assert row.changed_both is not None
    for decision in decisions:
        if decision.rule != DecisionRule.BY_OBJECTIVE or len(decision.candidates) < 2:
            continue
        row.decisions += 1
        both = len({c.kind for c in decision.candidates}) > 1
        printed = _repeated(decision, norm, PRINTED)
        if both:
            row.both += 1
            row.scales.append(printed.settings["frontier_scale"])
            row.receptacle += printed.chosen.kind == "receptacle"
            row.differs += flips(_repeated(decision, played, PRINTED), printed)
        for alpha_d in WEIGHTS:
            changed = flips(printed, _repeated(decision, norm, alpha_d))
            row.changed[alpha_d] += changed
            row.changed_both[alpha_d] += changed and both
    return row


def _repeated(decision: Decision, norm: GainNorm, alpha_d: float) -> Decision:
    same = under_gain_norm(decision, norm)
    if same is None:
        raise InvalidInput(
            f"a decision does not hold what gain_norm={norm} needs; play its episode again, with "
            "services of this version"
        )
    return recompute(same, {"alpha_d": alpha_d}).decision


def table(rows: Sequence[Row], played: GainNorm) -> str:
    """Markdown table of all rows."""
    heads = " | ".join(f"{a:g}" for a in WEIGHTS if a != PRINTED)
    marks = "--:|" * (len(WEIGHTS) - 1)
    lines = [
        f"Played with gain_norm={played}. Changed winners: against α_d = {PRINTED:g}, of all "
        "decisions (of those with both kinds).\n",
        f"| gain_norm | decisions | with both kinds | a receptacle wins | a frontier wins | "
        f"F₀, median | other winner than played | α_d = {heads} |",
        f"|---|--:|--:|--:|--:|--:|--:|{marks}",
    ]
    for row in rows:
        assert row.changed is not None
        assert row.changed_both is not None
        changed = " | ".join(
            f"{_share(row.changed[a], row.decisions)} ({_share(row.changed_both[a], row.both)})"
            for a in WEIGHTS
            if a != PRINTED
        )
        frontier = row.both - row.receptacle
        lines.append(
            f"| {row.norm} | {row.decisions} | {row.both} | {_share(row.receptacle, row.both)} | "
            f"{_share(frontier, row.both)} | {row.scale()} | "
            f"{_share(row.differs, row.both)} | {changed} |"
        )
    return "\n".join(lines) + "\n"


def _share(n: int, of: int) -> str:
    return f"{n}, {n / of:.0%}" if of else "–"


def play(spec: EpisodeSpec) -> dict[str, Any]:
    """Decisions of the global search of an episode up to the pick, as JSON. Raises HeliosError."""
    decisions: list[pb.Decision] = []
    with running_stack(spec, colored=False) as (thread, stack):
        bus, picked = stack.bus(), threading.Event()

        def end_after_pick(task: pb.Task) -> None:
            if task.phase == Phase.FIND_RECEPTACLE and not picked.is_set():
                picked.set()
                # Not on this thread, which publishes the task's progress.
                threading.Thread(
                    target=bus.call, args=(CANCEL, pb.TaskRequest(id=task.id), CALL_S)
                ).start()

        bus.subscribe(DECISION, decisions.append)
        bus.subscribe(TASK, end_after_pick)
        instruction = thread.run(lambda world: world.episode.instruction)
        task = stack.run(instruction, spec.max_steps, LONGEST_S)
    return {
        "key": spec.key,
        "seed": spec.seed,
        "instruction": instruction,
        "ended": "picked an object" if picked.is_set() else task.cause,
        "steps": task.steps,
        "decisions": [MessageToDict(d) for d in decisions if d.rule == DecisionRule.BY_OBJECTIVE],
    }


def run(specs: Sequence[EpisodeSpec], played: GainNorm, folder: Path) -> str:
    """Play the missing episodes; return the table of all. Raises HeliosError."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "episodes.jsonl"
    episodes = {e["key"]: e for e in whole_lines(path)}
    for k, spec in enumerate(specs, start=1):
        if spec.key not in episodes:
            episodes[spec.key] = play(spec)
            append_line(path, json.dumps(episodes[spec.key]))
        said = episodes[spec.key]
        print(
            f"{k}/{len(specs)} home {spec.seed}: {said['ended']}, {said['steps']} steps, "
            f"{len(said['decisions'])} decisions",
            file=sys.stderr,
        )
    decisions = [d for s in specs for d in decisions_of(episodes[s.key])]
    rows = rows_of(decisions, played)
    out = {
        "played_with": played,
        "homes": [s.seed for s in specs],
        "settings": {name: str(value) for name, value in specs[0].settings.items()},
        "agent": specs[0].agent,
        "rows": [row.as_json() for row in rows],
    }
    write_file(folder / "study.json", json.dumps(out, indent=1) + "\n")
    return table(rows, played)


def decisions_of(episode: Mapping[str, Any]) -> list[Decision]:
    """Decisions of a stored episode."""
    return [decision_from_proto(ParseDict(d, pb.Decision())) for d in episode["decisions"]]


def specs_of(given: argparse.Namespace) -> list[EpisodeSpec]:
    """Episodes that the flags name. Raises InvalidInput or UsageError."""
    played = homes(given.seed0, given.episodes)
    under = parse_condition(
        [given.agent],
        "ovmm",
        semantics=given.semantics,
        preset=given.preset,
        table=None,
        level=1.0,
        correlation=None,
        sensor="none",
        scorer=None,
        assignments=[*given.assignments, f"gain_norm={given.gain_norm}"],
        max_steps=given.max_steps,
    )
    return [
        EpisodeSpec(
            under.benchmark,
            under.agents[0],
            under.semantics,
            under.preset,
            seed,
            under.noise,
            under.settings,
        )
        for seed in played
    ]


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.distance_weight",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--agent", default="helios-paper", help="an agent that uses eq. 10")
    parser.add_argument("--episodes", type=int, default=12, help="number of homes")
    parser.add_argument("--seed0", type=int, default=400, help="first home; below 1000")
    parser.add_argument(
        "--gain-norm", choices=get_args(GainNorm), default="sum", help="gain_norm that is played"
    )
    parser.add_argument(
        "--set",
        dest="assignments",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="service setting, such as alpha_d=0.01; may be repeated",
    )
    parser.add_argument("--semantics", default="noisy", help="detections: noisy or ground-truth")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--max-steps", type=int, help="actions per episode  [default: 1250]")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    given = _arguments().parse_args(arguments)
    try:
        print(run(specs_of(given), given.gain_norm, given.out))
    except HeliosError as error:
        print(f"distance_weight: {error.message}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
