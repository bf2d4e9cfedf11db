"""The paper's tables with our results beside the published ones, and ratios of both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from helios_sim.home.presets import LARGE

from helios_eval.report import number_format, paper_figures
from helios_eval.report.agent_groups import (
    Arm,
    has_other_table,
    in_common,
    plain_arm,
    plain_arm_like,
    swept_arm,
)
from helios_eval.report.interval_statistics import Interval, mean_sem, paired_ratio, why_unbounded
from helios_eval.report.our_results import count, missing_homes_text
from helios_eval.report.record_metrics import paired_values, values
from helios_eval.report.report_model import Block, Cell, Paragraph, Rows, Section, Table

TAG = "another simulator"
_TABLES = (
    paper_figures.TABLE_1,
    paper_figures.TABLE_2,
    paper_figures.TABLE_4,
    paper_figures.TABLE_5,
    *paper_figures.SWEEPS,
)


def relations(arms: Sequence[Arm]) -> Table | None:
    """Table of the ratios that the paper claims, with ours; None if no pair of agents was run
    under the same conditions."""
    rows = Rows()
    for r in paper_figures.RELATIONS:
        top = plain_arm(arms, r.benchmark, *r.top)
        bottom = plain_arm_like(arms, top, *r.bottom) if top is not None else None
        if top is None or bottom is None:
            continue
        mine, theirs = in_common(top, bottom)
        if not mine:
            continue
        x, y = paired_values(mine, theirs, r.metric)
        ratio = paired_ratio(x, y)
        if math.isnan(ratio.value):
            ours = Cell(number_format.NONE, "nothing to divide by")
        else:
            note = (
                number_format.bounds(ratio.low, ratio.high, 2)
                if ratio.has_bounds
                else "no interval"
            )
            ours = Cell(number_format.number(ratio.value, 2), note, "strong")
        verdict = verdict_of(ratio, r.published) or why_unbounded(x, y)
        rows.add(
            [
                f"{r.metric}: {r.claim}",
                Cell(number_format.number(r.published, 2), r.where),
                ours,
                Cell(str(len(mine)), missing_homes_text(top, bottom, len(mine))),
                verdict,
            ]
        )
    if not rows.rows:
        return None
    return rows.table(
        "Relations: the paper's and ours",
        ["ratio of", "paper", "here", "n", "verdict"],
        "Ratio of the means over the same homes, with the 95 % interval of a paired bootstrap. "
        "Agents that ran with different settings or under different conditions are left out. "
        f"Ratios may be held against the paper's, absolute figures may not. {number_format.RULE}",
        TAG,
        words=["verdict"],
    )


def has_conditions_of_the_paper(arm: Arm) -> bool:
    """True if homes and noise of an arm are those meant to resemble the paper's: no larger homes,
    and the noise table of the preset."""
    return arm.preset != LARGE and not has_other_table(arm)


def verdict_of(ratio: Interval, published: float) -> str:
    """Comparison of our ratio with the paper's; empty if ours has no bounds."""
    if not ratio.has_bounds:
        return ""
    if ratio.low > published:
        return "larger here"
    return "smaller here" if ratio.high < published else "the paper's lies in our interval"


def section(arms: Sequence[Arm]) -> Section | None:
    """Section with the paper's tables that have results, and the numbers of the others.

    arms: those with tasks as in the paper. None if not one of them fits a row of a table.
    """
    benchmarks = {a.benchmark for a in arms}
    tables = [(table, _found(arms, table)) for table in _TABLES]
    if not any(any(found.values()) for _, found in tables):
        return None
    blocks: list[Block] = [
        Paragraph(
            "Below each figure of this run stands the published one. The paper drove a robot in "
            "Habitat with scanned or modelled homes and the detector DETIC; here it is a simulator "
            "and a detector of this project. Percent, mean ± standard error."
        )
    ]
    missing: list[str] = []
    for table, found in tables:
        always = table.number in (1, 2, 4) and table.benchmark in benchmarks
        worth_a_table = table.number < 5 or any(
            found[id(row)] for row in table.rows if row.agent == "helios-5050" or _changed(row)
        )
        if always or (worth_a_table and any(found.values())):
            blocks.append(_table(table, found, _caption(arms, table, found)))
        else:
            missing.append(str(table.number))
    if missing:
        blocks.append(Paragraph(f"{number_format.NOT_RUN.capitalize()}: Table {_listed(missing)}."))
    return Section("paper", "Beside the paper", tuple(blocks))


def _found(arms: Sequence[Arm], table: paper_figures.Table) -> dict[int, Arm | None]:
    """Our arm for each row of a table, by the id of the row. All are comparable."""
    main = min(_plain(arms, table), key=lambda a: len(a.own_settings), default=None)
    return {id(row): _ours(arms, main, row) if main else None for row in table.rows}


def _plain(arms: Sequence[Arm], table: paper_figures.Table) -> list[Arm]:
    """Plain arms of the agents of a table, those with noise first."""
    named = dict.fromkeys((row.agent, row.semantics) for row in table.rows if row.agent)
    found = (plain_arm(arms, table.benchmark, *who) for who in named)
    return sorted(filter(None, found), key=lambda a: a.semantics != "noisy")


def _listed(items: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(items[:-1]), items[-1]]))


def _changed(row: paper_figures.Row) -> bool:
    return row.setting is not None and paper_figures.DEFAULTS[row.setting[0]] != row.setting[1]


def _ours(arms: Sequence[Arm], main: Arm, row: paper_figures.Row) -> Arm | None:
    """Our arm for a row: comparable with `main`, but for the setting that the row sweeps."""
    if not row.agent:
        return None
    base = plain_arm_like(arms, main, row.agent, row.semantics)
    if base is None or row.setting is None:
        return base
    swept = swept_arm(arms, base, *row.setting)
    has_another = any(key.rpartition(".")[2] == row.setting[0] for key in base.own_settings)
    return swept if swept is not None or _changed(row) or has_another else base


def _table(table: paper_figures.Table, found: dict[int, Arm | None], caption: str) -> Table:
    rows = Rows()
    for row in table.rows:
        arm = found[id(row)]
        name = Cell(row.name, row.agent if arm else "")
        n = count(arm) if arm else number_format.NONE
        cells = [_cell(row, metric, arm) for metric in table.metrics]
        rows.add([name, *cells, n], row.group)
    return rows.table(
        f"Table {table.number}: {table.title}",
        ["method", *table.metrics, "n"],
        caption,
        TAG,
    )


def _cell(row: paper_figures.Row, metric: str, arm: Arm | None) -> Cell:
    figure = row.figures.get(metric)
    note = f"paper {figure}" if figure else f"paper {number_format.NONE}"
    if not row.agent:  # not an agent of this project
        return Cell(note if figure else number_format.NONE, "", "muted")
    if arm is None:
        return Cell(number_format.NOT_RUN, note, "muted")
    ours = mean_sem(values(arm.records, metric, row.picks))
    return Cell(number_format.mean(metric, ours), note, "strong")


def _caption(arms: Sequence[Arm], table: paper_figures.Table, found: dict[int, Arm | None]) -> str:
    """Caption: the noise and settings of our results, and the agents that are left out."""
    shown = [arm for arm in found.values() if arm is not None]
    parts = [_under(shown)]
    plain = [found[id(row)] for row in table.rows if row.setting is None and found[id(row)]]
    if own := next((arm.own_settings for arm in plain if arm), {}):
        parts.append(f"Ours with {', '.join(f'{k}={v}' for k, v in own.items())}.")
    agents = {(arm.agent, arm.semantics) for arm in shown}
    left = [a.label for a in _plain(arms, table) if (a.agent, a.semantics) not in agents]
    if left:
        parts.append(
            "Left out, since the settings or conditions are not those of the other rows: "
            f"{', '.join(left)}."
        )
    return " ".join(filter(None, parts))


def _under(arms: Iterable[Arm]) -> str:
    """Caption with the noise of our results where it is not the preset's own; else empty."""
    noises = list(dict.fromkeys(a.noise for a in arms if a.noise is not None))
    odd = [n for n in noises if n.level != 1 or n.correlation is not None]
    if not odd:
        return ""
    return (
        "Ours under "
        + "; ".join(
            sorted(
                f"noise level {n.level:g}"
                + ("" if n.correlation is None else f", correlation {n.correlation:g}")
                for n in odd
            )
        )
        + "."
    )
