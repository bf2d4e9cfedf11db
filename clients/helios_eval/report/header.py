"""What was run: from the records, and from `run.json` where the runner left one."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput

from helios_eval.record import EpisodeRecord, Noise
from helios_eval.report import text
from helios_eval.report.arms import Arm, correlation_name, most_common
from helios_eval.report.metrics import TITLES, shares_of_causes
from helios_eval.report.model import Block, Command, Facts, Notice, Section
from helios_eval.report.ours import benchmarks_of

RUN = "run.json"
CALIBRATED = "ground truth: no noise"

NOTICE = (
    "These episodes ran in the simulator of this project: homes by seed, shapes made of formulas, "
    "a detector whose errors are drawn from a table. The paper's ran in Habitat with its homes and "
    "a real detector. So no figure here may be held against one of the paper in absolute terms. "
    "What may be compared are relations: which agent is ahead of which, by what factor, and what "
    "noise costs."
)


def run_of(folder: Path) -> dict[str, Any]:
    """What the runner wrote down; empty without `run.json`. Raises InvalidInput for a torn one."""
    path = folder / RUN
    if not path.exists():
        return {}
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InvalidInput(f"{path} is no JSON ({error}); delete it and report again") from error
    if not isinstance(run, dict):
        raise InvalidInput(f"{path} holds no names with values; delete it and report again")
    return run


def section(
    records: Sequence[EpisodeRecord], arms: Sequence[Arm], run: Mapping[str, Any]
) -> Section:
    """The plain sentence, and the facts."""
    blocks: list[Block] = [Notice(NOTICE)]
    commits = most_common(r.commit for r in records)
    warnings = [f"Commit {c} had changes that were not committed." for c in commits if _dirty(c)]
    if len(commits) > 1:
        warnings.append("The episodes come from more than one commit.")
    if len({(r.preset, r.preset_hash) for r in records}) > len({r.preset for r in records}):
        warnings.append("One preset had different contents in different episodes.")
    absent = missing(records, run)
    if absent:
        what = text.plural(absent, "episode")
        warnings.append(
            f"The run was cut short: {what} of those that were asked for last are missing. The "
            "same command plays them."
        )
    warnings += [w for b in benchmarks_of(arms) if (w := unlike(b, arms))]
    errors = sum(r.cause == "system error" for r in records)
    if errors:
        what = text.plural(errors, "episode")
        warnings.append(f"{what} ended by a system error; they count as failures.")
    blocks += [Notice(w) for w in warnings]
    blocks.append(Facts(tuple(_facts(records, arms, run, commits))))
    commands = run.get("commands") or [c for c in [run.get("command")] if c]
    blocks += [Command(_command(c)) for c in commands]
    return Section("run", "What was run", tuple(blocks))


def unlike(benchmark: str, arms: Sequence[Arm]) -> str:
    """That the rows of a benchmark's tables are not over the same homes; empty where they are."""
    homes = {a.label: {r.seed for r in a.records} for a in arms if a.benchmark == benchmark}
    if all(seeds == next(iter(homes.values())) for seeds in homes.values()):
        return ""
    shared = len(set.intersection(*homes.values()))
    each = ", ".join(f"{label} {len(seeds)}" for label, seeds in homes.items())
    return (
        f"{TITLES[benchmark]}: not every row is over the same homes ({each}; "
        f"{text.plural(shared, 'home')} in common). Means of such rows may differ because their "
        "homes do; only the relations, and the differences between agents, compare the same homes."
    )


def missing(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> int:
    """How many of the episodes that `run.json` asks for are not there."""
    try:
        noise = Noise(**run["noise"]) if run["noise"] else None
        first, count = int(run["seed0"]), int(run["episodes"])
        asked = {(agent, s) for agent in run["agents"] for s in range(first, first + count)}
        condition = run["benchmark"], run["semantics"], run["preset"], noise, run["settings"]
    except (KeyError, TypeError, ValueError):
        return 0  # another program's run.json
    there = {
        (r.agent, r.seed) for r in records
        if (r.benchmark, r.semantics, r.preset, r.noise, r.settings) == condition
    }  # fmt: skip
    return len(asked - there)


def _dirty(commit: str) -> bool:
    return commit.endswith(("-dirty", "+"))


def _command(command: object) -> str:
    if isinstance(command, list):
        return shlex.join(map(str, command))
    return str(command)


def _facts(
    records: Sequence[EpisodeRecord],
    arms: Sequence[Arm],
    run: Mapping[str, Any],
    commits: Sequence[str],
) -> list[tuple[str, str]]:
    benchmarks = benchmarks_of(arms)
    seeds = [r.seed for r in records]
    done = sum(r.success for r in records)
    facts = [
        ("benchmark", ", ".join(TITLES[b] for b in benchmarks)),
        ("agents", ", ".join(dict.fromkeys(a.agent for a in arms))),
        ("episodes", f"{len(records)}, of which {done} succeeded"),
        ("seeds", f"{text.ranges(seeds)} ({text.plural(len(set(seeds)), 'home')})"),
        ("preset", ", ".join(_hashed([(r.preset, r.preset_hash) for r in records]))),
        ("semantics", ", ".join(dict.fromkeys(a.semantics for a in arms))),
        *_noise(records),
        ("settings that differ", _settings(arms)),
        ("commit", ", ".join(_marked(c) for c in commits)),
    ]
    if "machine" in run:
        facts.append(("machine", str(run["machine"])))
    for name in ("jobs", "cores", "started", "date"):
        if name in run:
            facts.append((name, str(run[name])))
    if isinstance(run.get("wall_s"), int | float):
        facts.append(("wall time of the last run", text.duration(float(run["wall_s"]))))
    if isinstance(run.get("versions"), dict):
        facts.append(("versions", ", ".join(f"{k} {v}" for k, v in run["versions"].items())))
    facts.append(("time of all episodes", text.duration(sum(r.wall_s for r in records))))
    return facts


def _marked(commit: str) -> str:
    return f"{commit} (not committed in full)" if _dirty(commit) else commit


def _hashed(pairs: Sequence[tuple[str, str]]) -> list[str]:
    return [f"{name} ({digest[:12]})" for name, digest in dict.fromkeys(pairs)]


def _noise(records: Sequence[EpisodeRecord]) -> list[tuple[str, str]]:
    noises = [n for n in dict.fromkeys(r.noise for r in records) if n is not None]
    if not noises:
        return [("noise of the detector", CALIBRATED)]
    tables = _hashed([(n.table, n.digest) for n in noises])
    levels = dict.fromkeys(f"{n.level:g}" for n in noises)
    correlations = dict.fromkeys(correlation_name(n) for n in noises)
    return [
        ("noise table", ", ".join(tables)),
        ("noise level", ", ".join(levels)),
        ("noise correlation", ", ".join(correlations)),
    ]


def _settings(arms: Sequence[Arm]) -> str:
    """Those of all arms, then those of single agents."""
    every = [dict(a.settings) for a in arms]
    shared = {k: v for k, v in every[0].items() if all(s.get(k) == v for s in every)}
    parts = [f"{k}={v}" for k, v in shared.items()]
    for arm in arms:
        own = [f"{k}={v}" for k, v in arm.settings if k not in shared]
        if own:
            parts.append(f"{arm.agent}: {' '.join(own)}")
    return "; ".join(dict.fromkeys(parts)) or "none: the defaults of the services"


def title(records: Sequence[EpisodeRecord], arms: Sequence[Arm]) -> tuple[str, str]:
    """The headline, and the line below it."""
    benchmarks = " and ".join(TITLES[b] for b in benchmarks_of(arms))
    agents = list(dict.fromkeys(a.agent for a in arms))
    causes = shares_of_causes(records)
    most = max((n for c, n in causes.items() if c), default=0)
    worst = sorted(c for c, n in causes.items() if c and n == most)
    lead = (
        f"{text.plural(len(records), 'episode')} of {text.plural(len(agents), 'agent')} in "
        f"{text.plural(len({r.seed for r in records}), 'home')}."
    )
    if len(worst) == 1:
        lead += f" The most frequent cause of failure: {worst[0]}."
    return f"HELIOS evaluation: {benchmarks}", lead
