"""Study of evidence rules: how well each separates true from false objects on the same frames.

    python -m helios_eval.studies.evidence_rules --out runs/map-study --seed0 100 --homes 40 \\
        --arm helios-paper --arm helios --arm "helios named_from=0.25 size_agreement=on"

`helios-paper` searches each home once without picking. The observations of its noisy detector go
into one object map per arm: an agent, with its settings and the given ones. At the end each arm
selects the object that it would pick, by its agent's rule, and states its beliefs about the
receptacles.

Prints one row per arm. "Picks": homes in which the selected object is one that the task means (in
brackets: homes won and lost against the first arm), another, or none. "Best": homes in which the
highest Psi of the receptacles is on a true one. "AUROC": the probability that a true instance has a
higher Psi than a false one, over all homes. Writes the same to `study.json`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numba
import numpy as np
from helios_client.usage_errors import UsageError
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError
from helios_core.name_rules import plain
from helios_core.types import ObjectInstance, Role
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.decisions.acceptance import paper, patient
from helios_planner.search.object_search import is_on_any, place_probability
from helios_planner.settings import Settings as PlannerSettings

from helios_eval.calibration.statistics import auroc
from helios_eval.episodes import service_settings
from helios_eval.episodes.belief_truth import Role as BeliefRole
from helios_eval.episodes.belief_truth import is_at, judge_instances
from helios_eval.episodes.episode_record import Belief
from helios_eval.studies.development_homes import homes
from helios_eval.studies.recorded_walk import Walk, believed, walk

ROLES = ("object", "start", "goal")
RULES = {"helios-paper": paper, "helios": patient}  # agents with map settings of their own


@dataclass(frozen=True)
class Arm:
    """Agent and settings under test, by the name given on the command line."""

    name: str
    map: ObjectMapSettings
    thresholds: Mapping[Role, float]  # detector thresholds
    least: float  # least class score for a pick
    by_place: bool  # Psi times location probability; else location first, then Psi


@dataclass
class Outcome:
    """Results of one arm over the walks so far."""

    picks: list[bool | None] = field(default_factory=list)  # correct or not, by home; None: no pick
    beliefs: list[list[Belief]] = field(default_factory=list)

    def best(self, role: str) -> int:
        """Number of homes in which the highest score of a role belongs to a true instance."""
        of_role = ([b for b in home if b.role == role] for home in self.beliefs)
        return sum(max(home, key=lambda b: b.score).correct for home in of_role if home)

    def auroc(self, role: str) -> float:
        """AUROC of the scores of a role; NaN without both true and false instances."""
        of_role = [b for home in self.beliefs for b in home if b.role == role]
        score = np.array([b.score for b in of_role])
        truth = np.array([b.correct for b in of_role], bool)
        return float(auroc(score, truth)[0]) if len(of_role) else float("nan")


def arm_of(text: str) -> Arm:
    """Arm from `"helios size_agreement=on"`: an agent and changed settings. Raises UsageError."""
    agent, *assignments = text.split() or [""]
    if agent not in RULES:
        raise UsageError(f"--arm {text!r}: begin with an agent, {' or '.join(RULES)}")
    settings = service_settings.of_stack(agent, service_settings.parsed(assignments))
    planner = PlannerSettings(**service_settings.of_service("planner", settings))
    of_map = ObjectMapSettings(**service_settings.of_service("objectmap", settings))
    thresholds = {
        Role.OBJECT: planner.od_g,
        Role.START_RECEPTACLE: planner.od_a,
        Role.GOAL_RECEPTACLE: planner.od_b,
    }
    return Arm(
        text,
        of_map.model_copy(update={"stride_px": 1}),
        thresholds,
        planner.cs_g,
        RULES[agent](planner.tau_g, True).by_place,
    )


def pick(arm: Arm, walked: Walk, known: Sequence[ObjectInstance]) -> bool | None:
    """True if the arm would pick an object that the task means; None if it knows no candidate."""
    starts = [o for o in known if plain(o.class_name) == plain(walked.start)]
    things = [
        o
        for o in known
        if plain(o.class_name) == plain(walked.object) and o.class_score >= arm.least
    ]
    if not things:
        return None
    if arm.by_place:
        chosen = max(things, key=lambda o: o.score * place_probability(o, starts))
    else:
        chosen = max(things, key=lambda o: (is_on_any(o, starts), o.score))
    return any(is_at(chosen, target, "object") for target in walked.targets)


def tell(walked: Walk, arms: Sequence[Arm], found: Mapping[str, Outcome]) -> None:
    """Add the results of one walk to the outcome of every arm."""
    roles: dict[str, BeliefRole] = {walked.goal: "goal", walked.start: "start"}
    roles[walked.object] = "object"
    for arm in arms:
        known = believed(walked.seen, arm.map, arm.thresholds)
        found[arm.name].picks.append(pick(arm, walked, known))
        found[arm.name].beliefs.append(
            judge_instances(known, walked.things, roles, len(walked.seen))
        )


def row(outcome: Outcome, first: Outcome) -> dict[str, float | None]:
    """Statistics of an arm, compared with the first arm. An AUROC is None without right and wrong
    instances."""
    pairs = list(zip(outcome.picks, first.picks, strict=True))
    return {
        "homes": len(pairs),
        "right": sum(now is True for now, _ in pairs),
        "won": sum(now is True and before is not True for now, before in pairs),
        "lost": sum(now is not True and before is True for now, before in pairs),
        "wrong": sum(now is False for now, _ in pairs),
        "none": sum(now is None for now, _ in pairs),
        "best_start": outcome.best("start"),
        "best_goal": outcome.best("goal"),
        **{f"auroc_{role}": _rounded(outcome.auroc(role)) for role in ROLES},
    }


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 3)


def _decimals(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def table(rows: Mapping[str, Mapping[str, float | None]]) -> str:
    """Markdown table of all arms."""
    lines = [
        "| | homes | picks: right, wrong, none | best start, goal | AUROC: object, start, goal |",
        "|---|--:|--:|--:|--:|",
    ]
    for name, r in rows.items():
        lines.append(
            f"| `{name}` | {r['homes']} | {r['right']} (+{r['won']} −{r['lost']}), {r['wrong']}, "
            f"{r['none']} | {r['best_start']}, {r['best_goal']} | "
            f"{', '.join(_decimals(r[f'auroc_{role}']) for role in ROLES)} |"
        )
    return "\n".join(lines)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.evidence_rules",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--arm",
        dest="arms",
        action="append",
        metavar="AGENT SETTING=VALUE …",
        help="may be repeated  [default: helios-paper, helios]",
    )
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--seed0", type=int, default=100, help="first home")
    parser.add_argument("--homes", type=int, default=40)
    parser.add_argument("--max-steps", type=int, default=500, help="of each walk")
    parser.add_argument("--stride", type=int, default=4, help="every n-th pixel, both ways")
    parser.add_argument("--out", type=Path, required=True, help="folder for study.json")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    given = _arguments().parse_args(arguments)
    numba.set_num_threads(1)  # threads that wait for each other are far slower beside a renderer
    rows: dict[str, dict[str, float | None]] = {}
    failed = False
    try:
        arms = [arm_of(text) for text in given.arms or ("helios-paper", "helios")]
        least = {role: min(arm.thresholds[role] for arm in arms) for role in arms[0].thresholds}
        found = {arm.name: Outcome() for arm in arms}
        for seed in homes(given.seed0, given.homes):
            tell(walk(given.preset, seed, given.max_steps, given.stride, least), arms, found)
            rows = {name: row(o, found[arms[0].name]) for name, o in found.items()}
            print(f"{seed - given.seed0 + 1}/{given.homes} home {seed}", file=sys.stderr)
    except HeliosError as error:
        print(f"evidence_rules: {error.message}", file=sys.stderr)
        failed = True
    if not rows:
        return 1
    given.out.mkdir(parents=True, exist_ok=True)
    write_file(given.out / "study.json", json.dumps(rows, indent=1) + "\n")
    print(table(rows))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
