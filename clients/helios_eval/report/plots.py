"""Drawings of the report as SVG. Text stays text; colours are CSS variables."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import contextmanager

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from helios_eval.report import colors, number_format
from helios_eval.report.interval_statistics import Interval
from helios_eval.report.report_model import Graphic

WIDTH_IN = 9.6
MOST_ARMS = len(colors.SERIES)  # per drawing; the tables have all
LABEL_LETTERS = 38  # in a line of a label


@contextmanager
def _look():
    with mpl.rc_context({
        "svg.fonttype": "none", "svg.hashsalt": "helios", "font.family": "sans-serif",
        "font.size": 10.5, "text.parse_math": False, "axes.edgecolor": colors.LINE.light,
        "axes.labelcolor": colors.MUTED.light, "text.color": colors.INK.light,
        "xtick.color": colors.MUTED.light, "ytick.color": colors.MUTED.light,
        "xtick.labelcolor": colors.MUTED.light, "ytick.labelcolor": colors.INK.light,
        "axes.spines.top": False, "axes.spines.right": False, "axes.spines.left": False,
        "grid.color": colors.LINE.light, "grid.linewidth": 0.8, "axes.axisbelow": True,
        "legend.frameon": False,
    }):  # fmt: skip
        yield


def _in_lines(label: str) -> str:
    """The label with its parts in lines of at most LABEL_LETTERS, as far as parts allow it."""
    lines: list[str] = []
    for part in re.split(r"(?= [·−] )", label):
        if lines and len(lines[-1]) + len(part) <= LABEL_LETTERS:
            lines[-1] += part
        else:
            lines.append(part.removeprefix(" · ").lstrip())
    return "\n".join(lines)


def _rows_in(labels: Sequence[str], row_in: float) -> float:
    """Height of rows with these labels, in inches: rows of one height, for the tallest label."""
    most = max((label.count("\n") + 1 for label in labels), default=1)
    return len(labels) * max(row_in, 0.19 * most)


def _columns(labels: Sequence[str]) -> int:
    """Columns of a legend that the width of a drawing has room for."""
    longest = max((len(line) for label in labels for line in label.split("\n")), default=1)
    return max(1, min(4, 100 // (longest + 6)))


def _axes(height_in: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    axes = figure.add_subplot()
    axes.tick_params(length=0)
    return figure, axes


def _svg(figure: Figure) -> str:
    out = io.StringIO()
    figure.savefig(out, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = out.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r"font: ([\d.]+px) 'sans-serif'", r"font: \1 var(--sans)", svg)
    return colors.with_variables(svg)


def dots(
    agents: Sequence[str], metrics: Sequence[str], points: Sequence[Sequence[Interval]], title: str
) -> Graphic:
    """Drawing of shares with intervals, `points[agent][metric]`, 0 to 1: one panel per metric."""
    agents = [_in_lines(agent) for agent in agents]
    with _look():
        n = len(agents)
        figure = Figure(figsize=(WIDTH_IN, 0.85 + _rows_in(agents, 0.42)), layout="constrained")
        all_axes = np.atleast_1d(figure.subplots(1, len(metrics), sharex=True, sharey=True))
        for k, (axes, metric) in enumerate(zip(all_axes, metrics, strict=True)):
            axes.tick_params(length=0)
            for y, row in enumerate(points):
                p, colour = row[k], colors.SERIES[y % len(colors.SERIES)].light
                axes.hlines(y, 100 * p.low, 100 * p.high, color=colour, linewidth=3, alpha=0.5)
                axes.plot(100 * p.value, y, "o", color=colour, markersize=6.5)
                axes.annotate(
                    f"{100 * p.value:.1f}",
                    (100 * p.value, y),
                    xytext=(0, 7),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8.5,
                    color=colors.MUTED.light,
                )
            axes.set_title(metric, fontsize=12, loc="left", color=colors.INK.light)
            axes.set_xlim(-4, 104)
            axes.set_xticks([0, 50, 100], ["0", "50", "100"])
            axes.grid(axis="x")
        all_axes[0].set_yticks(range(n), agents)
        all_axes[0].set_ylim(n - 0.45, -0.7)
        return Graphic(
            f"{title}: percent of the episodes, with 95 % Wilson intervals.", _svg(figure)
        )


def anytime(
    agents: Sequence[str], steps: Sequence[Sequence[float]], episodes: Sequence[int]
) -> Graphic:
    """Drawing of the share of the episodes that succeed within a number of steps, a line for each
    agent. steps: of each successful episode; episodes: number of all."""
    last = max((max(s) for s in steps if len(s)), default=1.0)
    agents = [_in_lines(agent) for agent in agents]
    columns = _columns(agents)
    with _look():
        figure, axes = _axes(3.2 + _rows_in(agents, 0.2) / columns)
        for k, (agent, done, n) in enumerate(zip(agents, steps, episodes, strict=True)):
            x = np.concatenate([[0.0], np.sort(np.asarray(done, float)), [last]])
            y = 100 * np.minimum(np.arange(len(x)), len(done)) / n
            colour = colors.SERIES[k % len(colors.SERIES)].light
            axes.step(x, y, where="post", color=colour, linewidth=2.2, label=agent)
        axes.set_xlim(0, last)
        axes.set_ylim(0, 100)
        axes.set_xlabel("steps", fontsize=9.5)
        axes.set_ylabel("whole task, % of the episodes", fontsize=9.5)
        axes.grid()
        figure.legend(loc="outside upper left", ncols=columns, fontsize=9.5, handlelength=1.1)
        return Graphic(
            "Success by steps: percent of the episodes that succeeded in the whole task within so "
            "many steps.",
            _svg(figure),
        )


def forest(rows: Sequence[tuple[str, str, Interval]]) -> Graphic:
    """Drawing of differences in percent points with their intervals: (metric, pair, interval)."""
    labels = [_in_lines(f"{metric}: {who}") for metric, who, _ in rows]
    with _look():
        figure, axes = _axes(0.7 + _rows_in(labels, 0.34))
        for y, (_, _, d) in enumerate(rows):
            colour = colors.SERIES[0 if d.excludes_zero else 7].light
            axes.plot(100 * d.value, y, "o", color=colour, markersize=7.5)
            label = number_format.signed(100 * d.value, 1)
            if d.has_bounds:
                axes.hlines(y, 100 * d.low, 100 * d.high, color=colour, linewidth=3, alpha=0.5)
                label += f"  {number_format.bounds(100 * d.low, 100 * d.high, 1, plus=True)}"
            axes.text(
                1.015,
                y,
                label,
                va="center",
                fontsize=9.5,
                color=colors.MUTED.light,
                transform=axes.get_yaxis_transform(),
            )
        axes.axvline(0, color=colors.INK.light, linewidth=1)
        axes.set_yticks(range(len(rows)), labels)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xlabel("percent points; right of 0: the first is better", fontsize=9.5)
        axes.grid(axis="x")
        return Graphic(
            "Paired differences with 95 % intervals; grey where the interval holds 0, or where too "
            "few homes differ for one.",
            _svg(figure),
        )


def causes(agents: Sequence[str], counts: Sequence[Mapping[str, int]]) -> Graphic:
    """Drawing of the outcomes of the episodes: one stacked bar per agent, success first."""
    order = ["", *colors.CAUSES]
    order += sorted({c for row in counts for c in row} - set(order))
    agents = [_in_lines(agent) for agent in agents]
    with _look():
        figure, axes = _axes(1.15 + _rows_in(agents, 0.5))
        left = np.zeros(len(agents))
        totals = np.array([sum(row.values()) for row in counts], dtype=np.float64)
        for cause in order:
            widths = np.array([row.get(cause, 0) for row in counts]) / totals * 100
            if not widths.any():
                continue
            colour = colors.of_cause(cause)
            axes.barh(
                range(len(agents)),
                widths,
                left=left,
                height=0.66,
                color=colour.light,
                edgecolor=colors.PAPER.light,
                linewidth=1.2,
                label=cause or colors.SUCCESS,
            )
            for y, (start, width) in enumerate(zip(left, widths, strict=True)):
                if width >= 4:
                    axes.text(
                        start + width / 2,
                        y,
                        f"{width:.0f}",
                        ha="center",
                        va="center",
                        fontsize=9.5,
                        color=_on(colour),
                    )
            left += widths
        axes.set_yticks(range(len(agents)), agents)
        axes.set_ylim(len(agents) - 0.5, -0.5)
        axes.set_xlim(0, 100)
        axes.set_xticks(range(0, 101, 20), [f"{v} %" for v in range(0, 101, 20)])
        figure.legend(loc="outside upper left", ncols=4, fontsize=9.5, handlelength=1.1)
        return Graphic("How the episodes ended, in percent of each agent's.", _svg(figure))


def effort(
    agents: Sequence[str], steps: Sequence[Sequence[float]], hits: Sequence[Interval]
) -> Graphic:
    """Drawing of the steps per episode and the share of episodes with a collision, by agent."""
    n, agents = len(agents), [_in_lines(agent) for agent in agents]
    colours = [colors.SERIES[i % len(colors.SERIES)].light for i in range(n)]
    with _look():
        figure = Figure(figsize=(WIDTH_IN, 0.9 + _rows_in(agents, 0.42)), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        line = {"color": colors.MUTED.light, "linewidth": 1.2}
        drawn = left.boxplot(
            [list(s) for s in steps],
            positions=range(n),
            orientation="horizontal",
            widths=0.55,
            patch_artist=True,
            showmeans=True,
            whiskerprops=line,
            capprops=line,
            boxprops={"linewidth": 0},
            medianprops={"color": colors.PAPER.light, "linewidth": 2.2},
            meanprops={"marker": "D", "markerfacecolor": colors.PAPER.light, "markersize": 5,
                       "markeredgecolor": colors.INK.light},
            flierprops={"marker": ".", "markersize": 4, "markeredgewidth": 0,
                        "markerfacecolor": colors.MUTED.light},
        )  # fmt: skip
        for box, colour in zip(drawn["boxes"], colours, strict=True):
            box.set_facecolor(colour)
        for y, (hit, colour) in enumerate(zip(hits, colours, strict=True)):
            right.hlines(y, 100 * hit.low, 100 * hit.high, color=colour, linewidth=3, alpha=0.5)
            right.plot(100 * hit.value, y, "o", color=colour, markersize=7, clip_on=False)
            right.annotate(
                f"{100 * hit.value:.1f}",
                (100 * hit.high, y),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.5,
                color=colors.MUTED.light,
            )
        for axes, title in ((left, "steps"), (right, "episodes with a collision (%)")):
            axes.tick_params(length=0)
            axes.set_title(title, fontsize=11, loc="left", color=colors.INK.light)
            axes.set_xlim(left=0)
            axes.grid(axis="x")
        left.set_yticks(range(n), agents)
        left.set_ylim(n - 0.5, -0.5)
        return Graphic(
            "Steps: quartiles over the episodes, diamond: mean, whiskers to 1.5 times the box. "
            "Collisions: 95 % Wilson interval.",
            _svg(figure),
        )


def stages(agents: Sequence[str], names: Sequence[str], ms: Sequence[Sequence[float]]) -> Graphic:
    """Drawing of the milliseconds per step: a row per stage, a dot per agent.

    ms: `ms[agent][stage]`; NaN if an agent has no such stage.
    """
    with _look():
        figure, axes = _axes(0.9 + 0.34 * len(names))
        table = np.array(ms, dtype=np.float64)
        rows = np.arange(len(names))
        longest = np.nanmax(table, axis=0)
        axes.hlines(rows, 0, longest, color=colors.LINE.light, linewidth=3)
        for i, agent in enumerate(agents):
            colour = colors.SERIES[i % len(colors.SERIES)].light
            axes.plot(table[i], rows, "o", color=colour, markersize=8, alpha=0.85, label=agent,
                      clip_on=False)  # fmt: skip
        for y, value in enumerate(longest):
            axes.annotate(
                f"{value:.1f}",
                (value, y),
                xytext=(9, 0),
                va="center",
                fontsize=8.5,
                textcoords="offset points",
                color=colors.MUTED.light,
            )
        axes.set_yticks(rows, names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlim(left=0)
        axes.margins(x=0.08)
        axes.set_xlabel("ms a step", fontsize=9.5)
        axes.grid(axis="x")
        figure.legend(loc="outside upper left", ncols=min(4, len(agents)), fontsize=10)
        return Graphic(
            "Time of a step by stage: median over the episodes, the largest written out. A stage "
            "may hold others, so they do not add up.",
            _svg(figure),
        )


def _on(colour: colors.Colour) -> str:
    """Text colour with the better contrast; differs from white and black, which follow the page."""
    return "#fffffe" if colors.is_dark(colour) else "#000001"
