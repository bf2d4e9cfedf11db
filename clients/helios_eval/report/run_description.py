"""Report section on the run itself, from the records and from `run.json` if there is one."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput

from helios_eval.episodes.episode_record import EpisodeRecord, content_of
from helios_eval.episodes.episode_spec import ABSENT, DETECTOR, PICK_RULE, SCORER, TASK_CLASSES
from helios_eval.report import number_format, played_before
from helios_eval.report.agent_groups import Arm, correlation_name, most_common, noise_parts
from helios_eval.report.number_format import plural, ranges
from helios_eval.report.our_results import benchmarks_of
from helios_eval.report.real_detectors import NO_SIMULATION, REAL_NOTICE, all_real, detectors
from helios_eval.report.record_metrics import TITLES, counts_of_causes
from helios_eval.report.report_model import Block, Command, Facts, Notice, Rows, Section, Table
from helios_eval.report.requested_episodes import Identity, commands_of, requests_of, seeds_asked
from helios_eval.report.skipped_homes import skipped_by

RUN = "run.json"
MOST_NAMED = 6  # rows that a sentence names
OWN_FACT = (
    SCORER,
    PICK_RULE,
    ABSENT,
    DETECTOR,
    TASK_CLASSES,
)  # settings that a fact of their own names
PICK_RULE_TEXTS = {
    "physical": "a pick takes what lies at the point",
    "ovmm": "a pick fails where nothing of the sought class is in reach and in view",
}
NO_NOISE = "ground truth: no noise"

NOTICE = (
    "These episodes ran in the simulator of this project: homes by seed, shapes made of formulas, "
    "a detector whose errors are drawn from a table. The paper's ran in Habitat with its homes and "
    "a real detector. So no figure here may be held against one of the paper in absolute terms. "
    "What may be compared are relations: which agent is ahead of which, by what factor, and what "
    "noise costs."
)


def run_of(folder: Path) -> dict[str, Any]:
    """Content of `run.json`; empty without the file.

    Raises InvalidInput for a damaged file, and Unavailable for one that cannot be read.
    """
    path = folder / RUN
    if (content := content_of(path)) is None:
        return {}
    try:
        run = json.loads(content.decode())
    except ValueError as error:
        raise InvalidInput(f"{path} is no JSON ({error}); delete it and report again") from error
    if not isinstance(run, dict):
        raise InvalidInput(f"{path} holds no names with values; delete it and report again")
    return run


def machines_of(run: Mapping[str, Any]) -> list[str]:
    """Machines that played the episodes of a `run.json`, oldest first."""
    return [str(m) for m in run.get("machines") or [run[k] for k in ("machine",) if k in run]]


def section(
    records: Sequence[EpisodeRecord], arms: Sequence[Arm], run: Mapping[str, Any]
) -> Section:
    """Section with the notices, facts and commands of the run."""
    blocks: list[Block] = [Notice(text) for text in notices_of(records)]
    commits = most_common(r.commit for r in records)
    warnings = [f"Commit {c} had changes that were not committed." for c in commits if is_dirty(c)]
    if len(commits) > 1:
        warnings.append(_versions(arms))
    if len({(r.preset, r.preset_hash) for r in records}) > len({r.preset for r in records}):
        warnings.append("One preset had different contents in different episodes.")
    asked = seeds_asked(run)
    if lacking := missing(arms, asked):
        warnings.insert(0, _not_complete(lacking, asked))
    if changed := _changed_homes(records):
        warnings.append(
            f"The homes of {plural(len(changed), 'seed')} ({ranges(changed)}) were not "
            "the same in all episodes; agents are not compared in them."
        )
    skipped = [skipped_by(order, run) for order in requests_of(run)]
    warnings += dict.fromkeys(homes.sentence() for homes in skipped if homes.seeds)
    warnings += [w for b in benchmarks_of(arms) if (w := different_homes_notice(b, arms))]
    errors = sum(r.cause == "system error" for r in records)
    if errors:
        what = plural(errors, "episode")
        unplayed = sum(not r.was_played for r in records)
        left_out = (
            " The means of steps, collisions and times leave out those that could not be played: "
            f"{unplayed}."
        )
        told = f"{what} ended by a system error; they count as failures."
        warnings.append(told + left_out * bool(unplayed))
    blocks += [Notice(w) for w in warnings]
    blocks.append(Facts(tuple(_facts(records, arms, run, commits))))
    blocks += [Command(_command(c)) for c in commands_of(run)]
    if lacking:
        blocks.append(_progress(arms, asked, lacking))
    return Section("run", "What was run", tuple(blocks))


def notices_of(records: Sequence[EpisodeRecord]) -> list[str]:
    """What the figures may be compared with: notices about real and about simulated detections."""
    real = {r.semantics == "detector" for r in records}
    return [text for is_so, text in ((False, NOTICE), (True, REAL_NOTICE)) if is_so in real]


def different_homes_notice(benchmark: str, arms: Sequence[Arm]) -> str:
    """Notice that a benchmark's rows are not over the same homes; empty if they are."""
    homes = {a.label: {r.seed for r in a.records} for a in arms if a.benchmark == benchmark}
    if all(seeds == next(iter(homes.values())) for seeds in homes.values()):
        return ""
    shared = len(set.intersection(*homes.values()))
    each = ", ".join(f"{label} {len(seeds)}" for label, seeds in homes.items())
    if len(homes) > MOST_NAMED:
        sizes = Counter(len(seeds) for seeds in homes.values())
        each = ", ".join(f"{plural(n, 'row')} over {size}" for size, n in sizes.items())
    return (
        f"{TITLES[benchmark]}: not every row is over the same homes ({each}; "
        f"{plural(shared, 'home')} in common). Means of such rows may differ because their "
        "homes do; only the relations, and the differences between agents, compare the same homes."
    )


def missing(arms: Sequence[Arm], asked: Mapping[Identity, set[int]]) -> dict[Identity, int]:
    """Number of requested episodes that are not played yet, by the identity of their arm."""
    played = {arm.identity: {r.seed for r in arm.records} for arm in arms}
    found = {i: len(seeds - played.get(i, set())) for i, seeds in asked.items()}
    return {identity: n for identity, n in found.items() if n}


def _not_complete(lacking: Mapping[Identity, int], asked: Mapping[Identity, set[int]]) -> str:
    whole, absent = sum(map(len, asked.values())), sum(lacking.values())
    return (
        f"Not complete: {absent} of the {plural(whole, 'episode')} that were asked for are "
        "not played yet. What is told here holds for those that are there, and whoever looks often "
        "enough while a run goes on sees something settle by chance: the answer is that of the "
        "whole run. The same commands play the rest."
    )


def _progress(
    arms: Sequence[Arm], asked: Mapping[Identity, set[int]], lacking: Mapping[Identity, int]
) -> Table:
    """Table of played and requested episodes, for arms that lack some."""
    labels = {arm.identity: arm.label for arm in arms}
    rows = Rows()
    for identity, absent in lacking.items():
        benchmark, agent, semantics, _, noise, settings = identity
        name = labels.get(identity) or " · ".join(
            [agent, *(f"{k}={v}" for k, v in settings)]
            + (noise_parts(noise) if noise else [semantics])
        )
        n = len(asked[identity])
        rows.add([name, TITLES[benchmark], str(n - absent), str(n)])
    return rows.table(
        "Not complete", ["agent", "benchmark", "played", "asked for"], words=["benchmark"]
    )


def _versions(arms: Sequence[Arm]) -> str:
    """Notice with the number of episodes per commit.

    Agents of one commit may be compared; those of several may differ by the changes between them.
    """
    parts = [(arm.label, arm.records) for arm in arms]
    if len(parts) > MOST_NAMED:
        parts = [("all rows", [r for arm in arms for r in arm.records])]
    described = []
    for label, records in parts:
        counts = Counter(r.commit for r in records)
        each = ", ".join(f"{n} by {commit}" for commit, n in counts.most_common())
        described.append(f"{label} {each}")
    return (
        f"The episodes come from more than one commit: {'; '.join(described)}. What changed "
        "between them may be a part of a difference."
    )


def _changed_homes(records: Sequence[EpisodeRecord]) -> list[int]:
    """Seeds whose homes are known to differ between episodes of one preset."""
    homes: dict[tuple[str, int], set[str]] = {}
    for r in records:
        homes.setdefault((r.preset, r.seed), set()).add(r.structure_hash)
    return sorted({seed for (_, seed), found in homes.items() if len(found - {""}) > 1})


def is_dirty(commit: str) -> bool:
    """True if files differed from the commit."""
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
        (
            "seeds",
            f"{ranges(seeds)} ({plural(len(set(seeds)), 'home')})",
        ),
        *played_before.fact(records, run),
        ("preset", ", ".join(_hashed([(r.preset, r.preset_hash) for r in records]))),
        ("semantics", ", ".join(dict.fromkeys(a.semantics for a in arms))),
        *detectors(arms),
        *_noise(records),
        ("image-text scorer", ", ".join(dict.fromkeys(a.scorer for a in arms))),
        *_pick_rules(arms),
        *_absent(records, arms),
        ("settings that differ", _settings(arms)),
        ("commit", ", ".join(_marked(c) for c in commits)),
    ]
    if machines := machines_of(run):
        facts.append(("machine", "; ".join(machines)))
    for name in ("jobs", "cores", "started", "date"):
        if name in run:
            facts.append((name, str(run[name])))
    if isinstance(run.get("wall_s"), int | float):
        facts.append(("wall time of the last run", number_format.duration(float(run["wall_s"]))))
    if isinstance(run.get("versions"), dict):
        facts.append(("versions", ", ".join(f"{k} {v}" for k, v in run["versions"].items())))
    facts.append(("time of all episodes", number_format.duration(sum(r.wall_s for r in records))))
    return facts


def _marked(commit: str) -> str:
    return f"{commit} (not committed in full)" if is_dirty(commit) else commit


def _hashed(pairs: Sequence[tuple[str, str]]) -> list[str]:
    return [f"{name} ({digest[:12]})" for name, digest in dict.fromkeys(pairs)]


def _noise(records: Sequence[EpisodeRecord]) -> list[tuple[str, str]]:
    noises = [n for n in dict.fromkeys(r.noise for r in records) if n is not None]
    if not noises:
        return [("noise of the detector", NO_SIMULATION if all_real(records) else NO_NOISE)]
    tables = _hashed([(n.table, n.digest) for n in noises])
    levels = dict.fromkeys(f"{n.level:g}" for n in noises)
    correlations = dict.fromkeys(correlation_name(n) for n in noises)
    return [
        ("noise table", ", ".join(tables)),
        ("noise level", ", ".join(levels)),
        ("noise correlation", ", ".join(correlations)),
    ]


def _pick_rules(arms: Sequence[Arm]) -> list[tuple[str, str]]:
    """Fact on the pick rule; none without a benchmark that picks."""
    rules = dict.fromkeys(a.pick_rule for a in arms if a.benchmark == "ovmm")
    described = [": ".join(filter(None, (rule, PICK_RULE_TEXTS.get(rule)))) for rule in rules]
    return [("pick rule", "; ".join(described))] if rules else []


def _absent(records: Sequence[EpisodeRecord], arms: Sequence[Arm]) -> list[tuple[str, str]]:
    """Fact on absent targets; empty if no arm was to have them."""
    shares = [f"{a.absent_share:g}" for a in arms if a.absent_share]
    if not shares:
        return []
    drawn = sum(r.absent for r in records)
    return [
        (
            "absent targets",
            f"{drawn} of {plural(len(records), 'episode')} "
            f"(--absent {', '.join(dict.fromkeys(shares))}); "
            "agents with absent targets are not held against the paper",
        )
    ]


def _settings(arms: Sequence[Arm]) -> str:
    """Settings of all arms, then those of single agents, as text."""
    every = [{k: v for k, v in a.settings if k not in OWN_FACT} for a in arms]
    shared = {k: v for k, v in every[0].items() if all(s.get(k) == v for s in every)}
    parts = [f"{k}={v}" for k, v in shared.items()]
    for arm in arms:
        own = [f"{k}={v}" for k, v in arm.settings if k not in (*shared, *OWN_FACT)]
        if own:
            parts.append(f"{arm.agent}: {' '.join(own)}")
    return "; ".join(dict.fromkeys(parts)) or "none: the defaults of the services"


def title(records: Sequence[EpisodeRecord], arms: Sequence[Arm]) -> tuple[str, str]:
    """Title of the report, and the line below it."""
    benchmarks = " and ".join(TITLES[b] for b in benchmarks_of(arms))
    agents = list(dict.fromkeys(a.agent for a in arms))
    causes = counts_of_causes(records)
    most = max((n for c, n in causes.items() if c), default=0)
    worst = sorted(c for c, n in causes.items() if c and n == most)
    lead = (
        f"{plural(len(records), 'episode')} of {plural(len(agents), 'agent')} in "
        f"{plural(len({r.seed for r in records}), 'home')}."
    )
    if len(worst) == 1:
        lead += f" The most frequent cause of failure: {worst[0]}."
    lacking = sum(max(0, a.requested_episodes - len(a.records)) for a in arms)
    if lacking:
        lead += f" Not complete: {plural(lacking, 'episode')} of these are not played yet."
    return f"HELIOS evaluation: {benchmarks}", lead
