"""Report section on the time of a step and of its stages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report import plots
from helios_eval.report.agent_groups import Arm, most_common
from helios_eval.report.number_format import duration, number
from helios_eval.report.report_model import Block, Cell, Paragraph, Rows, Section, Table


def section(arms: Sequence[Arm]) -> Section:
    """Section with the median time of a step, in total and by stage."""
    arms = [replace(a, records=tuple(r for r in a.records if r.steps > 0)) for a in arms]
    arms = [a for a in arms if a.records]  # episodes that never began have no step
    if not arms:
        return Section("time", "Time of a step", (Paragraph("No episode took a step."),))
    named = most_common(name for a in arms for r in a.records for name in r.stage_ms)
    medians = [[_stage(arm, name) for name in named] for arm in arms]
    order = sorted(
        range(len(named)), key=lambda i: -max(np.nan_to_num([row[i] for row in medians]))
    )
    names = [named[i].replace("_", " ") for i in order]
    medians = [[row[i] for i in order] for row in medians]
    blocks: list[Block] = [_table(arms, names, medians)]
    if names:
        n = plots.MOST_ARMS
        whole = [float(np.median([r.step_ms for r in a.records])) for a in arms[:n]]
        rows = [[step, *row] for step, row in zip(whole, medians[:n], strict=True)]
        drawn = plots.stages([a.label for a in arms[:n]], ["whole step", *names], rows)
        blocks.insert(0, drawn)
    else:
        blocks.append(Paragraph("The episodes do not say how long each stage took."))
    return Section("time", "Time of a step", tuple(blocks))


def episodes_per_hour(records: Sequence[EpisodeRecord]) -> float:
    """Episodes that one core plays in an hour of CPU time; NaN if no record has its CPU time."""
    cpu_s = [r.cpu_s for r in records if r.cpu_s]
    return 3600 * len(cpu_s) / sum(cpu_s) if cpu_s else math.nan


def _stage(arm: Arm, name: str) -> float:
    """Median (ms) over the episodes that have the stage; NaN if none has."""
    found = [r.stage_ms[name] for r in arm.records if name in r.stage_ms]
    return float(np.median(found)) if found else math.nan


def _table(arms: Sequence[Arm], names: Sequence[str], medians: Sequence[Sequence[float]]) -> Table:
    """Table with agents as columns and stages as rows."""
    rows = Rows()
    steps = [np.array([r.step_ms for r in a.records]) for a in arms]
    rows.add(
        [
            Cell("whole step", "90 % of the episodes below", "strong"),
            *(
                Cell(
                    number(float(np.median(s)), 1), number(float(np.quantile(s, 0.9)), 1), "strong"
                )
                for s in steps
            ),
        ]
    )
    for i, name in enumerate(names):
        rows.add([name, *(number(row[i], 1) for row in medians)])
    walls = [sum(r.wall_s for r in a.records) for a in arms]
    rows.add(
        [
            Cell("whole episode (s)", "sum"),
            *(
                Cell(number(w / len(a.records), 1), duration(w))
                for a, w in zip(arms, walls, strict=True)
            ),
        ]
    )
    if any(r.cpu_s for a in arms for r in a.records):
        rows.add(
            [
                Cell("episodes per hour and core", "from their CPU time"),
                *(number(episodes_per_hour(a.records), 1) for a in arms),
            ]
        )
    return rows.table(
        "Time by stage",
        ["ms a step", *(a.label for a in arms)],
        "Each value is a median: over the steps of an episode, then over the episodes; a stage "
        "may hold others, so they do not add up. Measured while the episodes of the other "
        "cores ran.",
    )
