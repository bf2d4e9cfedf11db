"""Report section with the research questions of the runs and their answers.

Every difference is between the same homes, with unlimited picks. A question whose agents were not
run is listed as such; one answered by only some of the homes states their number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from helios_eval.report import number_format, paper_figures, plots
from helios_eval.report.agent_groups import (
    KNOWN,
    Arm,
    comparable,
    has_other_table,
    in_common,
    noise_parts,
    plain_arm,
    plain_arm_like,
)
from helios_eval.report.interval_statistics import (
    Interval,
    paired_difference,
    paired_ratio,
    score_difference,
    why_unbounded,
)
from helios_eval.report.number_format import bounds, interval, number, scale, signed
from helios_eval.report.our_results import missing_homes_text, tone_of
from helios_eval.report.paper_comparison import has_conditions_of_the_paper
from helios_eval.report.record_metrics import METRICS, paired_values
from helios_eval.report.report_model import Block, Cell, Paragraph, Rows, Section, Table

NOISY, TRUE = "noisy", "ground-truth"
SO_FAR = ", so far"
IDEA_METRICS = ("FindObj", "Pick", "SR", "partial", "collisions", "steps")


@dataclass(frozen=True)
class Question:
    """Claim that the first agent is ahead of the second, each with its semantics."""

    asks: str
    first: tuple[str, str]
    second: tuple[str, str]
    metrics: tuple[str, ...]
    benchmark: str = "ovmm"


QUESTIONS = (
    Question("Primary claim: HELIOS above the trusting agent",
             ("helios-paper", NOISY), ("trusting", NOISY), ("Pick", "SR")),
    Question("Beyond the paper: helios above the paper's method",
             ("helios", NOISY), ("helios-paper", NOISY), ("Pick", "SR")),
    Question("The global search objective: HELIOS above HELIOS without it (Table 1)",
             ("helios-paper", NOISY), ("no-global-objective", NOISY), ("FindObj", "Pick", "SR")),
    Question("HELIOS above the trusting agent, both with ground-truth semantics (Table 4)",
             ("helios-paper", TRUE), ("trusting", TRUE), ("Pick", "SR")),
    Question("Information gain of an optimistic measurement above 50-50 (Table 5)",
             ("helios-paper", NOISY), ("helios-5050", NOISY), ("Pick", "SR")),
    Question("VLFM with the stop decision of HELIOS above VLFM (Table 2)",
             ("vlfm-helios-stop", NOISY), ("vlfm", NOISY), ("SR", "SPL"), "objectnav"),
)  # fmt: skip


def section(arms: Sequence[Arm]) -> Section | None:
    """Section with the answers; None if the arms answer nothing."""
    rows, bars, unanswered, unlike = Rows(), [], [], []
    for question in QUESTIONS:
        top, bottom = (
            plain_arm(arms, question.benchmark, *who) for who in (question.first, question.second)
        )
        if top is not None:
            bottom = plain_arm_like(arms, top, *question.second) or bottom
        if top is None or bottom is None or not in_common(top, bottom)[0]:
            unanswered.append(question.asks)
            continue
        if not comparable(top, bottom):
            unlike.append(question.asks)
            continue
        asks = ", ".join([question.asks, *_noise_of(top)])
        for metric in question.metrics:
            bars.append(_row(rows, question, metric, top, bottom, asks, top.semantics))
        for first, second, noise in _other_noise(arms) if question is QUESTIONS[0] else ():
            for metric in question.metrics:
                group = f"The same at {noise}"
                bars.append(_row(rows, question, metric, first, second, group, noise))
    ideas = _ideas(arms)
    plain = plain_arm(arms, "ovmm", "helios-paper", NOISY)
    alone = plain is not None and bool(plain.own_settings)
    if alone:
        unanswered.append(
            "HELIOS without settings of its own, beside which the rows with settings say something "
            "(name the folder that has it, too)"
        )
    if not rows.rows and ideas is None and not alone:
        return None
    blocks: list[Block] = [
        Paragraph(
            "Judged by the truth of this project's simulator, unlimited picks. What was run, and "
            "why only relations may be held against the paper's, stands below."
        )
    ]
    if rows.rows:
        table = rows.table(
            "Paired differences",
            ["of the same homes", "first", "second", "difference", "95 %", "ratio", "n", "verdict"],
            "First minus second and first over second, unlimited picks, each with the 95 % "
            "interval of a paired bootstrap, and of a difference with Newcombe's score interval "
            "where fewer than six homes differ; below a ratio the paper's own. A difference is "
            f"settled where its interval leaves 0 out. {number_format.RULE}",
            words=["verdict"],
        )
        blocks += [plots.forest(bars), table]
    blocks += [ideas] if ideas is not None else []
    if unanswered:
        blocks.append(Paragraph(f"Not run: {'; '.join(unanswered)}."))
    if unlike:
        asks = "; ".join(unlike)
        blocks.append(Paragraph(f"Not compared, since both ran with other settings: {asks}."))
    return Section("answers", "The questions and their answers", tuple(blocks))


def _row(
    rows: Rows, question: Question, metric: str, top: Arm, bottom: Arm, group: str, under: str
) -> tuple[str, str, Interval]:
    """Add a row; return its entry for the drawing. under: its semantics or noise."""
    mine, theirs = in_common(top, bottom)
    x, y = paired_values(mine, theirs, metric)
    d, ratio, k = paired_difference(x, y), paired_ratio(x, y), scale(metric)
    shown = d if d.has_bounds or not METRICS[metric].binary else score_difference(x, y)
    published = [
        r.published
        for r in paper_figures.RELATIONS
        if (r.metric, r.top, r.bottom) == (metric, question.first, question.second)
        and has_conditions_of_the_paper(top)
    ]
    of = missing_homes_text(top, bottom, len(mine))
    rows.add([
        Cell(metric, "", "strong"), number(x.mean() * k, 1), number(y.mean() * k, 1),
        Cell(signed(d.value * k, 1), "", tone_of(metric, d)),
        bounds(shown.low * k, shown.high * k, 1, plus=True) if shown.has_bounds
        else number_format.NONE,
        Cell(interval(ratio, 2) if ratio.has_bounds else number(ratio.value, 2),
             f"paper {number(published[0], 2)}" if published else ""),
        Cell(str(len(mine)), of),
        (_so(d) or why_unbounded(x, y)) + (SO_FAR if of else ""),
    ], group)  # fmt: skip
    where = "" if under == NOISY else f", {under}"
    return metric, f"{top.agent} − {bottom.agent}{where}", d


def _so(d: Interval) -> str:
    """Verdict of an interval; empty if it has no bounds."""
    if not d.has_bounds:
        return ""
    return "not settled: holds 0" if not d.excludes_zero else ("ahead" if d.low > 0 else "behind")


def _other_noise(arms: Sequence[Arm]) -> Iterator[tuple[Arm, Arm, str]]:
    """Arms of the primary claim under every other noise that both were run under, with its name."""
    (one, semantics), (other, _) = QUESTIONS[0].first, QUESTIONS[0].second
    main = plain_arm(arms, "ovmm", one, semantics)
    for top in arms:
        if main is None or top.condition == main.condition or top.noise is None:
            continue
        if (top.benchmark, top.agent, top.settings) != ("ovmm", one, main.settings):
            continue
        here = [a for a in arms if a.condition == top.condition and a.agent == other]
        same = [a for a in here if comparable(top, a)]
        bottom = min(same, key=Arm.sort_key, default=None)
        if bottom is not None and in_common(top, bottom)[0]:
            homes = [] if top.preset == main.preset else [f"homes {top.preset}"]
            yield top, bottom, ", ".join([*_noise_of(top), *homes]) or "other noise"


def _noise_of(arm: Arm) -> list[str]:
    """Differences from the preset's noise, as text."""
    if arm.noise is None:
        return []
    table = [f"noise {arm.noise.table}"] if has_other_table(arm) else []
    return table + noise_parts(arm.noise)


def _ideas(arms: Sequence[Arm]) -> Table | None:
    """Table of ideas beyond the paper against the paper's method under the same noise."""
    base = plain_arm(arms, "ovmm", "helios-paper", NOISY)
    if base is None or base.own_settings:
        return None
    rows = Rows()
    for arm in arms:
        if arm.condition != base.condition or not _is_idea(arm, base):
            continue
        mine, theirs = in_common(arm, base)
        if not mine:
            continue
        cells: list[Cell] = []
        settled: dict[str, list[str]] = {"good": [], "bad": []}
        for metric in IDEA_METRICS:
            x, y = paired_values(mine, theirs, metric)
            if not len(x):
                cells.append(Cell(number_format.NONE, "", "muted"))
                continue
            d = paired_difference(x, y)
            k, digits, tone = (
                scale(metric),
                METRICS[metric].digits,
                tone_of(metric, d),
            )
            note = bounds(d.low * k, d.high * k, digits, plus=True) if d.has_bounds else ""
            cells.append(Cell(signed(d.value * k, digits), note, tone))
            if tone:
                settled[tone].append(metric)
        of = missing_homes_text(arm, base, len(mine))
        rows.add([arm.label, *cells, Cell(str(len(mine)), of), _settled_words(settled, bool(of))])
    return (
        rows.table(
            "Ideas beyond the paper, against the paper's method",
            ["idea − helios-paper", *IDEA_METRICS, "n", "verdict"],
            "Difference of the means over the same homes, percent points or the metric's unit, "
            "with the 95 % interval of a paired bootstrap; of collisions and steps less is better. "
            "Not corrected for the number of ideas: of twenty without effect one would look "
            f"settled in any one metric. {number_format.RULE}",
            words=["verdict"],
        )
        if rows.rows
        else None
    )


def _settled_words(settled: Mapping[str, Sequence[str]], is_partial: bool) -> str:
    """Settled metrics in words. settled: names by tone."""
    words = {"good": "better", "bad": "worse"}
    parts = [f"{words[tone]}: {', '.join(names)}" for tone, names in settled.items() if names]
    return ("; ".join(parts) or "nothing settled") + (SO_FAR if is_partial else "")


def _is_idea(arm: Arm, base: Arm) -> bool:
    """True for an agent beyond the paper, or for settings that the paper did not sweep."""
    changed = {k: v for k, v in arm.own_settings.items() if (k, v) not in base.settings}
    if arm.agent not in KNOWN:
        return True
    swept = {row.setting for table in paper_figures.SWEEPS for row in table.rows}
    return arm.agent == base.agent and any(
        (k.rpartition(".")[2], v) not in swept for k, v in changed.items()
    )
