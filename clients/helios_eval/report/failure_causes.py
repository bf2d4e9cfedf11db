"""Report sections on failures: their causes, collisions, and pictures."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from helios_core.errors import InvalidInput
from helios_sim.plans.plan_source import MARK

from helios_eval.episodes import failure_snapshot, home_presets
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.episode_spec import (
    CONDITIONS,
    DEFAULT_SCORER,
    DETECTOR,
    REAL_SCORER,
    SCORER,
    TASK_CLASSES,
    WALKER,
    scorer_of,
)
from helios_eval.episodes.plan_homes import level_in
from helios_eval.report import colors, episode_map, number_format, plots
from helios_eval.report.agent_groups import Arm, plainest_arms
from helios_eval.report.interval_statistics import mean_sem, wilson
from helios_eval.report.number_format import plural
from helios_eval.report.our_results import benchmarks_of, count, played_count
from helios_eval.report.record_metrics import counts_of_causes, values
from helios_eval.report.report_model import (
    Block,
    Cell,
    Gallery,
    Notice,
    Paragraph,
    Picture,
    Rows,
    Section,
    Table,
)

MOST_PICTURES = 12  # maps per agent
MOST_BODIES = 3


def causes_section(arms: Sequence[Arm]) -> Section:
    """Section with the causes of failure, and with steps and collisions."""
    blocks: list[Block] = []
    for benchmark in benchmarks_of(arms):
        mine = [a for a in arms if a.benchmark == benchmark]
        shown = plainest_arms(mine, plots.MOST_ARMS)
        counts = [counts_of_causes(a.records) for a in shown]
        blocks.append(plots.causes([a.label for a in shown], counts))
        blocks.append(_table_of_causes(mine))
        if played := [a for a in shown if a.played]:
            hits = [sum(r.collisions > 0 for r in a.played) for a in played]
            blocks.append(
                plots.effort(
                    [a.label for a in played],
                    [list(values(a.played, "steps")) for a in played],
                    [wilson(hit, len(a.played)) for a, hit in zip(played, hits, strict=True)],
                )
            )
        blocks.append(_table_of_collisions(mine))
    return Section("failures", "Why episodes failed", tuple(blocks))


def _table_of_causes(arms: Sequence[Arm]) -> Table:
    counts = [counts_of_causes(a.records) for a in arms]
    found = {c for row in counts for c in row if c}
    named = [c for c in colors.CAUSES if c in found] + sorted(found.difference(colors.CAUSES))
    rows = Rows()
    for arm, row in zip(arms, counts, strict=True):
        n = len(arm.records)
        cells = [_count(row.get(cause, 0), n) for cause in ["", *named]]
        rows.add([arm.label, count(arm), *cells])
    return rows.table(
        "Causes of failure",
        ["agent", "n", colors.SUCCESS, *named],
        "Episodes, and below it their share. Judged by the simulator's truth; a cause of the "
        "closed list that is not here did not occur.",
    )


def _count(count: int, n: int) -> Cell:
    if count == 0:
        return Cell("0", "", "muted")
    return Cell(str(count), f"{number_format.number(100 * count / n, 1)} %")


def _table_of_collisions(arms: Sequence[Arm]) -> Table:
    rows = Rows()
    for arm in arms:
        played, n = arm.played, len(arm.played)
        if not n:
            rows.add([arm.label, played_count(arm), *[number_format.NONE] * 7])
            continue
        bodies = Counter(body for r in played for body in r.collided_with)
        often = ", ".join(f"{name} ({n})" for name, n in bodies.most_common(MOST_BODIES))
        hit = sum(r.collisions > 0 for r in played)
        rows.add(
            [
                arm.label,
                played_count(arm),
                number_format.mean("steps", mean_sem(values(played, "steps"))),
                number_format.number(sum(r.path_m for r in played) / n, 1),
                number_format.number(sum(r.picks for r in played) / n, 2),
                _wrong_picks(played),
                number_format.mean("collisions", mean_sem(values(played, "collisions"))),
                _count(hit, n),
                often or number_format.NONE,
            ]
        )
    return rows.table(
        "Steps and collisions",
        ["agent", "n", "steps", "path (m)", "picks tried", "wrong objects picked", "collisions",
         "episodes with one", "touched most often"],
        "Means over the episodes that were played. A wrong object that is picked is disturbed, "
        "even if the robot puts it back.",
        words=["touched most often"],
    )  # fmt: skip


def _wrong_picks(records: Sequence[EpisodeRecord]) -> str:
    known = [r.wrong_picks for r in records if r.wrong_picks is not None]
    return number_format.number(sum(known) / len(known), 2) if known else number_format.NONE


def gallery_section(folder: Path, arms: Sequence[Arm]) -> Section:
    """Section with maps of failed episodes, at most 12 per agent, spread over the causes."""
    by_key, damaged = _kept(folder)
    galleries: list[Block] = []
    for arm in arms:
        failed = [(r, by_key.get(r.key)) for r in arm.records]
        pairs = [
            (r, k) for r, k in failed if k and r.cause == k.cause and r.instruction == k.instruction
        ]
        if not pairs:
            continue
        chosen = _pick_across_causes(pairs)
        pictures = tuple(_picture(r, k) for r, k in chosen)
        n_failed = sum(bool(r.cause) for r in arm.records)
        caption = f"{len(pictures)} of {plural(n_failed, 'failure')}, spread over the causes."
        galleries.append(Gallery(arm.label, pictures, caption))
    if not galleries:
        why = "No picture of a failed episode was kept, or none failed."
        return Section("pictures", "Failed episodes", (*damaged, Paragraph(why)))
    intro = Paragraph(
        "Each map is what the robot knew at the end: free floor white, what stands in the way "
        "dark, unknown grey. Blue: where the robot drove; green: the truth that was asked for; "
        "orange: what the object map believed. The commands play the episode again, and film it."
    )
    return Section("pictures", "Failed episodes", (*damaged, intro, *galleries))


def _kept(folder: Path) -> tuple[dict[str, failure_snapshot.FailureSnapshot], list[Notice]]:
    """Snapshots of a folder by episode key, and a notice that lists unreadable files."""
    by_key: dict[str, failure_snapshot.FailureSnapshot] = {}
    damaged: list[str] = []
    for path in failure_snapshot.all_of(folder):
        try:
            kept = failure_snapshot.load(path)
        except InvalidInput:
            damaged.append(path.name)
        else:
            by_key[kept.key] = kept
    if not damaged:
        return by_key, []
    what = plural(len(damaged), "picture")
    note = f"Without {what}: {', '.join(damaged)} cannot be read; delete what is damaged."
    return by_key, [Notice(note)]


Kept = tuple[EpisodeRecord, failure_snapshot.FailureSnapshot]


def _pick_across_causes(pairs: Sequence[Kept]) -> list[Kept]:
    """At most `MOST_PICTURES` of the pairs, one of each cause in turn; sorted by cause and seed."""
    by_cause: dict[str, list[Kept]] = {}
    for pair in pairs:
        by_cause.setdefault(pair[0].cause, []).append(pair)
    ranks = {id(p): i for group in by_cause.values() for i, p in enumerate(group)}
    chosen = sorted(pairs, key=lambda p: ranks[id(p)])[:MOST_PICTURES]
    return sorted(chosen, key=lambda p: (p[0].cause, p[0].seed))


def _picture(record: EpisodeRecord, kept: failure_snapshot.FailureSnapshot) -> Picture:
    return Picture(
        title=f"seed {record.seed}",
        cause=record.cause,
        instruction=record.instruction,
        message=record.message,
        png=episode_map.draw(kept),
        jpeg=kept.camera_jpeg,
        commands=tuple(filter(None, (replay(record), film(record)))),
    )


def replay(record: EpisodeRecord) -> str:
    """Command that plays one episode again."""
    words = ["helios", "eval", record.benchmark, "--agents", record.agent]
    words += ["--episodes", "1", "--seed0", str(record.seed), *_condition(record)]
    return shlex.join([*words, "--out", "runs/again"])


def film(record: EpisodeRecord) -> str:
    """Command that films the episode; empty for an agent that cannot be filmed."""
    if record.agent == WALKER:
        return ""
    words = ["helios", "eval", "video", "--seed", str(record.seed), "--agent", record.agent]
    if record.benchmark != "ovmm":
        words += ["--benchmark", record.benchmark]
    return shlex.join([*words, *_condition(record)])


def _condition(record: EpisodeRecord) -> list[str]:
    """Flags for the conditions of an episode; noise and settings only where they differ."""
    settings = dict(record.settings)
    homes, plan, _ = record.preset.partition(MARK)
    words = ["--homes", homes] if plan else ["--preset", record.preset]
    if level := level_in(record.home_file):
        words += ["--level", level]
    words += ["--semantics", record.semantics]
    if record.noise is not None and record.noise.table != home_presets.noise_of(record.preset):
        words += ["--noise", record.noise.table]
    if record.noise is not None and record.noise.level != 1:
        words += ["--noise-level", f"{record.noise.level:g}"]
    if record.noise is not None and record.noise.correlation is not None:
        words += ["--noise-correlation", f"{record.noise.correlation:g}"]
    default = REAL_SCORER if record.semantics == "detector" else DEFAULT_SCORER
    if (scorer := scorer_of(settings)) == default:
        settings.pop(SCORER, None)  # a record lacks a setting that is the service's own
    else:
        settings[SCORER] = scorer
    for name in CONDITIONS:
        if name in settings:
            flag = name.rpartition(".")[2].replace("_", "-")
            value = str(settings.pop(name))
            digested = name in (DETECTOR, TASK_CLASSES)  # the flag has no digest
            words += [f"--{flag}", value.partition("@")[0] if digested else value]
    if record.semantics == "detector" and TASK_CLASSES not in record.settings:
        words += ["--task-classes", "all"]
    for key, setting in settings.items():
        words += ["--set", f"{key}={setting}"]
    return words
