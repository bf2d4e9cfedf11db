"""Builder of the report's data structure from episode records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from helios_eval import calibration
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report import (
    absent_targets,
    failure_causes,
    number_format,
    our_results,
    paper_comparison,
    played_before,
    plots,
    research_questions,
    run_description,
    step_timing,
)
from helios_eval.report.agent_groups import Arm, arms_of
from helios_eval.report.record_metrics import METRICS, NAMES
from helios_eval.report.report_model import (
    Block,
    Column,
    Episodes,
    Facts,
    Graphic,
    Notice,
    Paragraph,
    Report,
    Rows,
    Section,
)
from helios_eval.report.requested_episodes import seeds_asked

MOST_ROWS = 8  # longer calibration tables are folded


def build(folder: Path, records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> Report:
    """Report on a folder's episodes; `run` is the content of `run.json`."""
    arms = arms_of(records, seeds_asked(run))
    title, lead = run_description.title(records, arms)
    sections = [
        *filter(None, [research_questions.section(_with_tasks_of_the_paper(arms))]),
        run_description.section(records, arms, run),
        _glance(arms),
        our_results.metrics_section(arms),
        our_results.paired_section(arms),
        *filter(None, [paper_comparison.section(_under_conditions_of_the_paper(arms))]),
        failure_causes.causes_section(arms),
        step_timing.section(arms),
        _calibration(records),
        failure_causes.gallery_section(folder, arms),
        _episodes(arms),
        _definitions(arms),
    ]
    if told := played_before.notice(records, run):
        first, *_ = sections
        sections[0] = replace(first, blocks=(Notice(told), *first.blocks))
    return Report(title, lead, tuple(sections))


def _with_tasks_of_the_paper(arms: Sequence[Arm]) -> list[Arm]:
    """Arms whose targets are all present and of any class, as in the paper."""
    return [arm for arm in arms if not absent_targets.has_any(arm) and not arm.task_classes]


def _under_conditions_of_the_paper(arms: Sequence[Arm]) -> list[Arm]:
    return list(
        filter(paper_comparison.has_conditions_of_the_paper, _with_tasks_of_the_paper(arms))
    )


def _glance(arms: Sequence[Arm]) -> Section:
    blocks: list[Block] = list(our_results.overview(arms))
    for benchmark in our_results.benchmarks_of(arms):
        n = sum(a.benchmark == benchmark for a in arms)
        if n > plots.MOST_ARMS:
            blocks.append(
                Paragraph(
                    f"Drawings show {plots.MOST_ARMS} of {n} rows, the plain ones first; tables "
                    "show all."
                )
            )
    as_paper = _under_conditions_of_the_paper(arms)
    blocks.append(
        paper_comparison.relations(as_paper)
        or Paragraph(
            "No two agents that the paper relates were run under the same conditions."
            if as_paper
            else "The paper has no conditions like these: absent objects, chosen classes, larger "
            "homes or another noise. So nothing is compared with it."
        )
    )
    return Section("glance", "At a glance", tuple(blocks))


def _calibration(records: Sequence[EpisodeRecord]) -> Section:
    """Section on the calibration of the object map's scores."""
    with_beliefs = [r for r in records if r.beliefs]
    blocks: list[Block] = []
    for figure in calibration.figures(with_beliefs) if with_beliefs else []:
        blocks.append(Graphic(figure.caption, png=figure.png, title=figure.title))
        if figure.table:
            columns = list(figure.table[0])
            rows = Rows()
            for line in figure.table:
                rows.add([_shown(line.get(c, "")) for c in columns])
            words = [c for c in columns if isinstance(figure.table[0][c], str)]
            names = [c.replace("_", " ") for c in columns]
            words = [w.replace("_", " ") for w in words]
            table = rows.table("The numbers", names, words=words)
            blocks.append(replace(table, folded=len(rows.rows) > MOST_ROWS))
    if not blocks:
        blocks = [
            Paragraph(
                "The episodes hold too few beliefs of the object map to tell."
                if with_beliefs
                else "The episodes hold no beliefs of the object map."
            )
        ]
    return Section("calibration", "Do the scores of the object map mean anything?", tuple(blocks))


def _shown(value: object) -> str:
    if value is None:
        return number_format.NONE
    return number_format.number(value, 3) if isinstance(value, float) else str(value)


def _episodes(arms: Sequence[Arm]) -> Section:
    names = ("seed", "agent", "ended", "instruction", "FindObj", "Pick", "FindRec", "Place", "SR",
             "steps", "collisions", "picks", "s", "the agent said")  # fmt: skip
    words = {"agent", "ended", "instruction", "the agent said"}
    columns = tuple(Column(n, n not in words) for n in names)
    rows = []
    for arm in arms:
        for r in arm.records:
            met = (r.find_object, r.pick, r.find_receptacle, r.place, r.success)
            rows.append((
                str(r.seed), arm.label, r.cause or "success", r.instruction,
                *("✓" if m else "" for m in met), str(r.steps), str(r.collisions), str(r.picks),
                f"{r.wall_s:.0f}", r.message,
            ))  # fmt: skip
    return Section("episodes", "All episodes", (Episodes(columns, tuple(rows), (1, 2)),))


def _definitions(arms: Sequence[Arm]) -> Section:
    names = dict.fromkeys(n for b in our_results.benchmarks_of(arms) for n in NAMES[b])
    facts = [(n.replace("_", " "), METRICS[n].meaning) for n in names]
    if any(map(absent_targets.has_any, arms)):
        facts.append(("absent target", absent_targets.SUCCESS))
    facts += [
        ("± ", "standard error of the mean over the episodes"),
        ("Wilson interval", "95 % score interval of a share"),
        (
            "difference, ratio",
            "of the same homes; percentile bootstrap over episodes, 10,000 draws, fixed seed",
        ),
        ("p", "exact: McNemar's test for what is so or not, else the sign test; two-sided"),
    ]
    return Section(
        "definitions",
        "What the words mean",
        (
            Facts(tuple(facts)),
            Notice(
                "All metrics are judged by the simulator's truth, never by what the agent says."
            ),
        ),
    )
