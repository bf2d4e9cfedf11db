"""Report sections on our own results: metrics with intervals, and differences between agents."""

from __future__ import annotations

from collections.abc import Sequence

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report import absent_targets, number_format, plots
from helios_eval.report.agent_groups import Arm, in_common, pairs, plainest_arms
from helios_eval.report.interval_statistics import (
    Interval,
    Values,
    discordant,
    mean_sem,
    paired_difference,
    paired_ratio,
    sign_test,
    why_unbounded,
    wilson,
)
from helios_eval.report.paper_figures import PICKS, picks_name
from helios_eval.report.record_metrics import METRICS, NAMES, TITLES, paired_values, values
from helios_eval.report.report_model import Block, Cell, Paragraph, Rows, Section, Table

Found = tuple[Arm, Arm, list[EpisodeRecord], list[EpisodeRecord]]  # two arms, their common homes


def benchmarks_of(arms: Sequence[Arm]) -> list[str]:
    """Benchmarks of the arms, in display order."""
    return [b for b in NAMES if any(a.benchmark == b for a in arms)]


def overview(arms: Sequence[Arm]) -> list[Block]:
    """One drawing per benchmark: the metrics of all agents with their intervals.

    Arms in which every object is absent have no metrics to draw, except SR, and are left out.
    """
    out: list[Block] = []
    for benchmark in benchmarks_of(arms):
        drawn = [a for a in arms if a.benchmark == benchmark and not _all_absent(a)]
        if not drawn:
            continue
        mine = plainest_arms(drawn, plots.MOST_ARMS)
        names = [n for n in NAMES[benchmark] if METRICS[n].binary]
        points = []
        for arm in mine:
            shares = [values(arm.records, n) for n in names]
            points.append([wilson(int(v.sum()), len(v)) for v in shares])
        labels = [a.label for a in mine]
        out.append(plots.dots(labels, names, points, TITLES[benchmark]))
        done = [[float(r.steps) for r in a.records if r.success] for a in mine]
        if any(done):
            out.append(plots.anytime(labels, done, [len(a.records) for a in mine]))
    return out


def metrics_section(arms: Sequence[Arm]) -> Section:
    """Section with every metric: mean ± standard error, interval, and shares per limit of picks."""
    blocks: list[Block] = []
    for benchmark in benchmarks_of(arms):
        mine = [a for a in arms if a.benchmark == benchmark]
        limits = PICKS if benchmark == "ovmm" else (None,)
        shares = [n for n in NAMES[benchmark] if METRICS[n].share]
        rest = [n for n in NAMES[benchmark] if not METRICS[n].share]
        caption = (
            "Percent of the episodes, mean ± standard error; below it the 95 % Wilson interval of "
            "what is either so or not."
        )
        if len(limits) > 1:
            caption += " An episode with more picks than the limit scores 0."
        if any(absent_targets.has_any(a) for a in mine):
            caption += f" {absent_targets.WHICH_EPISODES}"
        rows = Rows()
        for picks in reversed(limits):
            for arm in mine:
                group = picks_name(picks) if len(limits) > 1 else ""
                cells = [_figure(arm, name, picks) for name in shares]
                rows.add([arm.label, *cells, count(arm)], group)
        blocks.append(rows.table(TITLES[benchmark], ["agent", *shares, "n"], caption))
        rows = Rows()
        for arm in mine:
            cells = [_figure(arm, name, None) for name in rest]
            rows.add([arm.label, *cells, played_count(arm)])
        heads = ["agent", *map(_head, rest), "n"]
        caption = "Less is better. Of the episodes that were played."
        blocks.append(rows.table(f"{TITLES[benchmark]}: what it took", heads, caption))
        blocks += filter(None, [absent_targets.table(mine)])
    return Section("metrics", "Every metric of this run", tuple(blocks))


def _all_absent(arm: Arm) -> bool:
    """True if the object is absent in every episode."""
    return all(r.absent for r in arm.records)


def count(arm: Arm) -> Cell:
    """Number of episodes, with the requested number if some are not played yet."""
    n = str(len(arm.records))
    return Cell(n) if arm.is_complete else Cell(n, f"of {arm.requested_episodes}", "bad")


def played_count(arm: Arm) -> Cell:
    """Number of episodes that were played, with that of all if some could not be."""
    n, of = len(arm.played), len(arm.records)
    return Cell(str(n), f"of {of}", "bad") if n < of else count(arm)


def homes_of(a: Arm, b: Arm, homes: int) -> str:
    """Homes in common: "37 homes", or "37 of 200 homes" if more were requested of both arms."""
    of = missing_homes_text(a, b, homes)
    return f"{homes} {of}" if of else number_format.plural(homes, "home")


def missing_homes_text(a: Arm, b: Arm, homes: int) -> str:
    """Text "of 200 homes" if two arms lack common homes that were requested of both; else empty."""
    wanted = min(max(arm.requested_episodes, len(arm.records)) for arm in (a, b))
    return f"of {wanted} homes" if homes < wanted and not (a.is_complete and b.is_complete) else ""


def _head(name: str) -> str:
    return name.replace("_", " ")


def _figure(arm: Arm, name: str, picks: int | None) -> Cell:
    found = values(arm.records, name, picks)
    if not len(found):
        return Cell(number_format.NONE, "", "muted")
    note = ""
    if METRICS[name].binary:
        i = wilson(int(found.sum()), len(found))
        note = number_format.bounds(100 * i.low, 100 * i.high, 1)
    return Cell(number_format.mean(name, mean_sem(found)), note, "strong" if name == "SR" else "")


def paired_section(arms: Sequence[Arm]) -> Section:
    """Section with differences and ratios over the same homes."""
    found = [(a, b, *in_common(a, b)) for a, b in pairs(arms)]
    found = [p for p in found if p[2]]
    if not found:
        return Section(
            "differences",
            "Differences between agents",
            (Paragraph("There is one agent only, or no two have an episode in common."),),
        )
    absent = any(absent_targets.has_any(arm) for pair in found for arm in pair[:2])
    note = f" {absent_targets.WHICH_EPISODES}" if absent else ""
    blocks: list[Block] = [
        Paragraph(
            "The same homes, one agent against another. Difference: first minus second; ratio: "
            "first over second; both with 95 % intervals of a bootstrap over episodes (10,000 "
            "draws, fixed seed). p: McNemar's exact test where a metric is either so or not, the "
            "sign test elsewhere; two-sided, not corrected for the number of rows. Picks are "
            f"unlimited. {number_format.RULE}{note}"
        )
    ]
    bars = []
    for a, b, mine, theirs in found:
        for name in ("Pick", "SPL", "SR"):
            if name in NAMES[a.benchmark] and len(values(mine, name)):
                d = paired_difference(*paired_values(mine, theirs, name))
                bars.append((name, f"{a.label} − {b.label}", d))
    blocks.append(plots.forest(bars))
    blocks.append(_pair_table(found))
    return Section("differences", "Differences between agents", tuple(blocks))


def _pair_table(found: Sequence[Found]) -> Table:
    rows = Rows()
    for a, b, mine, theirs in found:
        group = f"{a.label} against {b.label} ({homes_of(a, b, len(mine))})"
        for name in NAMES[a.benchmark]:
            x, y = paired_values(mine, theirs, name)
            if name != "seconds_per_step" and len(x):
                rows.add(_pair_row(name, x, y), group)
    return rows.table(
        "Paired differences and ratios",
        ["metric", "first", "second", "difference", "95 %", "ratio", "95 %", "more : less", "p"],
        "Coloured where the interval of the difference leaves 0 out. More : less counts the homes "
        "in which the first, and the second, has the larger value. Of collisions and steps less is "
        "better.",
    )


def tone_of(name: str, d: Interval) -> str:
    """Tone "good" or "bad" of the first of two; empty if the difference is not significant."""
    if not d.excludes_zero:
        return ""
    return "good" if (d.value > 0) == (METRICS[name].better > 0) else "bad"


def _pair_row(name: str, x: Values, y: Values) -> list[Cell | str]:
    metric, k = METRICS[name], number_format.scale(name)
    d, ratio, digits = paired_difference(x, y), paired_ratio(x, y), metric.digits
    more, less = discordant(x, y)
    return [
        name,
        number_format.number(x.mean() * k, digits),
        number_format.number(y.mean() * k, digits),
        Cell(number_format.signed(d.value * k, digits), tone=tone_of(name, d)),
        number_format.bounds(d.low * k, d.high * k, digits, plus=True)
        if d.has_bounds
        else why_unbounded(x, y),
        number_format.number(ratio.value, 2),
        number_format.bounds(ratio.low, ratio.high, 2) if ratio.has_bounds else number_format.NONE,
        f"{more} : {less}",
        number_format.p_value(sign_test(x, y)),
    ]
