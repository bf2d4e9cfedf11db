"""Charts of the calibration report: rows and samples in, PNG out."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from helios_eval.calibration import statistics as st
from helios_eval.calibration.samples import ROLES, VIEWS, Samples
from helios_eval.calibration.summary import (
    ALL,
    EDGES,
    MIN_SAMPLES,
    SCORES,
    Row,
    adaptive_edges,
    score_of,
)
from helios_eval.palette import BLUE, GREEN, GRID, INK, MUTED, VERMILION

mpl.use("Agg")

DPI = 120
COLOR = {"S": BLUE, "Ψ": VERMILION, "−U": GREEN, "true": INK}
MARKER = {"S": "o", "Ψ": "s", "−U": "^", "true": "D"}
NAME = {"S": "class score S", "Ψ": "score Ψ", "−U": "−U", "true": "share that is right"}
ROLE_NAME = {"object": "Objects", "receptacle": "Receptacles"}
STYLE: Any = {
    "font.size": 12, "axes.titlesize": 13, "axes.labelsize": 12, "axes.edgecolor": MUTED,
    "axes.labelcolor": INK, "text.color": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": GRID,
    "axes.axisbelow": True, "figure.facecolor": "white", "legend.frameon": False,
    "font.family": "DejaVu Sans", "axes.titlelocation": "left", "axes.titleweight": "bold",
}  # fmt: skip


def reliability_png(samples: Samples, rows: Sequence[Row]) -> bytes:
    """Reliability diagrams of S and Ψ for objects and receptacles, under one setting."""
    with mpl.rc_context(STYLE):
        canvas = plt.figure(figsize=(10.4, 13.4))
        grid = canvas.add_gridspec(
            5,
            2,
            height_ratios=[4.4, 1, 1.15, 4.4, 1],
            hspace=0.1,
            wspace=0.16,
            left=0.085,
            right=0.985,
            top=0.895,
            bottom=0.048,
        )
        for down, role in enumerate(ROLES):
            part = samples.of_role(role)
            for across, name in enumerate(("S", "Ψ")):
                axes = canvas.add_subplot(grid[3 * down, across])
                below = canvas.add_subplot(grid[3 * down + 1, across], sharex=axes)
                row = next(
                    (r for r in rows if r.role == role and r.score == name and r.views == ALL), None
                )
                axes.set_title(f"{ROLE_NAME[role]}: {NAME[name]}", pad=42)
                _diagram(axes, below, part, name, row)
                if across == 0:
                    axes.set_ylabel("share that is right")
                    below.set_ylabel("beliefs")
                below.set_xlabel(f"what the map says ({NAME[name]})")
        handles, labels = canvas.axes[0].get_legend_handles_labels()
        canvas.legend(
            handles,
            labels,
            loc="upper center",
            ncols=3,
            bbox_to_anchor=(0.53, 0.985),
            fontsize=11.5,
        )
        return _png(canvas)


def views_png(samples: Samples, rows: Sequence[Row]) -> bytes:
    """Claimed and true shares, ECE and AUROC by number of views, under one setting."""
    names = [name for name, _, _ in VIEWS]
    with mpl.rc_context(STYLE):
        canvas, panels = plt.subplots(2, 3, figsize=(14.2, 8.4), squeeze=False)
        for line, role in zip(panels, ROLES, strict=True):
            claimed, error, area = line
            part = samples.of_role(role)
            known = {(r.views, r.score): r for r in rows if r.role == role and r.views != ALL}
            claimed.set_title(f"{ROLE_NAME[role]}: claim and truth")
            error.set_title("Expected calibration error")
            area.set_title("AUROC against the truth")
            _claims(claimed, part, names)
            for shift, name in ((-0.09, "S"), (0.09, "Ψ")):
                _points(error, names, known, name, shift, "ece")
                for k, views in enumerate(names):
                    row = known.get((views, name))
                    if row:
                        error.plot(
                            [k + shift - 0.08, k + shift + 0.08],
                            [row.ece_by_chance] * 2,
                            color=MUTED,
                            lw=2,
                            label="_",
                        )
            error.plot([], [], color=MUTED, lw=2, label="calibrated: 95 % below")
            for shift, name in ((-0.14, "S"), (0.0, "Ψ"), (0.14, "−U")):
                _points(area, names, known, name, shift, "auroc")
            area.axhline(0.5, color=MUTED, lw=1.3, ls=(0, (4, 3)), label="a coin")
            claimed.set_ylim(-0.03, 1.03)
            error.set_ylim(0, max(0.1, 1.05 * error.get_ylim()[1]))
            area.set_ylim(min(0.35, area.get_ylim()[0]), 1.02)
            for axes in line:
                if not known:
                    axes.text(
                        0.5,
                        0.5,
                        f"no group of {MIN_SAMPLES} beliefs",
                        ha="center",
                        va="center",
                        color=MUTED,
                        transform=axes.transAxes,
                    )
                counts = [len(part.of_views(name)) for name in names]
                ticks = [f"{n}\nn = {c}" for n, c in zip(names, counts, strict=True)]
                axes.set_xticks(range(len(names)), ticks)
                axes.set_xlim(-0.5, len(names) - 0.5)
                axes.grid(axis="x", visible=False)
        for axes in panels[1]:
            axes.set_xlabel("views of the instance")
        canvas.tight_layout(h_pad=2.0, w_pad=2.0, rect=(0, 0, 1, 0.93))
        for axes in panels[0]:
            box = axes.get_position()
            handles, labels = axes.get_legend_handles_labels()
            canvas.legend(handles, labels, loc="upper left", fontsize=10.5, ncols=2,
                          bbox_to_anchor=(box.x0 - 0.008, 0.995), columnspacing=1.2,
                          borderaxespad=0.0, handletextpad=0.5)  # fmt: skip
        return _png(canvas)


def settings_png(rows: Sequence[Row]) -> bytes:
    """ECE and AUROC of every setting, one row per setting."""
    settings = list(dict.fromkeys(row.setting for row in rows))
    with mpl.rc_context(STYLE):
        height = 2.6 + 0.62 * len(settings)
        canvas, panels = plt.subplots(
            1,
            4,
            figsize=(15.0, height),
            sharey=True,
            squeeze=False,
            gridspec_kw={"width_ratios": [1, 1, 1, 1]},
        )
        for k, (role, figure) in enumerate((r, f) for r in ROLES for f in ("ece", "auroc")):
            axes: Axes = panels[0][k]
            title = "ECE" if figure == "ece" else "AUROC"
            axes.set_title(f"{ROLE_NAME[role]}: {title}")
            known = {(r.setting, r.score): r for r in rows if r.role == role and r.views == ALL}
            names = SCORES if figure == "auroc" else ("S", "Ψ")
            shifts = np.linspace(-0.22, 0.22, len(names)) if len(names) > 2 else (-0.13, 0.13)
            for name, shift in zip(names, shifts, strict=True):
                _points(axes, settings, known, name, shift, figure, upright=False)
            if figure == "auroc":
                axes.axvline(0.5, color=MUTED, lw=1.3, ls=(0, (4, 3)), label="a coin")
                axes.set_xlim(min(0.4, axes.get_xlim()[0]), 1.01)
            else:
                axes.set_xlim(0, max(0.1, 1.05 * axes.get_xlim()[1]))
            axes.grid(axis="y", visible=False)
            for edge in np.arange(0.5, len(settings) - 1):
                axes.axhline(edge, color=GRID, lw=1)
        panels[0][0].set_yticks(range(len(settings)), [_cut(name, 44) for name in settings])
        panels[0][0].set_ylim(len(settings) - 0.5, -0.5)
        canvas.tight_layout(w_pad=1.6, rect=(0, 0, 1, 1 - 0.5 / height))
        handles, labels = panels[0][1].get_legend_handles_labels()
        handles, labels = [*handles[1:], handles[0]], [*labels[1:], labels[0]]
        canvas.legend(handles, labels, loc="upper right", ncols=4, bbox_to_anchor=(0.99, 1.0))
        return _png(canvas)


def _diagram(axes: Axes, below: Axes, part: Samples, name: str, row: Row | None) -> None:
    color = COLOR[name]
    axes.plot([0, 1], [0, 1], color=MUTED, lw=1.3, ls=(0, (4, 3)), label="perfectly calibrated")
    axes.set_xlim(0, 1)
    axes.set_ylim(-0.02, 1.02)
    axes.tick_params(labelbottom=False)
    below.spines["left"].set_visible(False)
    below.set_yticks([])
    below.grid(visible=False)
    if row is None:
        axes.text(
            0.5, 0.5, f"fewer than {MIN_SAMPLES} beliefs", ha="center", va="center", color=MUTED
        )
        return
    score, truth = score_of(part, name), part.correct
    even = st.reliability(score, truth, adaptive_edges(score))
    axes.plot(even.score, even.true, color=INK, lw=1.4, marker=".", ms=5, alpha=0.55,
              label="bins of equal counts")  # fmt: skip
    wide = st.reliability(score, truth, EDGES)
    spread = np.maximum(0.0, [wide.true - wide.true_low, wide.true_high - wide.true])
    axes.errorbar(wide.score, wide.true, spread, fmt=MARKER[name], ms=8, color=color,
                  capsize=3, lw=1.8, mec="white", mew=1,
                  label="bins of equal width, 95 % interval")  # fmt: skip
    has_interval = np.isfinite(row.ece_low)
    spread_of_ece = f" ({row.ece_low:.3f}–{row.ece_high:.3f})" if has_interval else ""
    lines = [
        f"ECE {row.ece:.3f}{spread_of_ece}, by chance ≤ {row.ece_by_chance:.3f}",
        f"widest gap {row.mce:.2f}    Brier {row.brier:.3f}    AUROC {_figure(row.auroc)}",
    ]
    axes.text(0, 1.025, "\n".join(lines), transform=axes.transAxes, va="bottom", fontsize=11,
              linespacing=1.4, color=MUTED)  # fmt: skip
    middle = (wide.low + wide.high) / 2
    right = np.rint(wide.true * wide.count)
    below.bar(middle, right, 0.088, color=color, lw=0)
    below.bar(middle, wide.count - right, 0.088, bottom=right, color=GRID, lw=0)
    for x, count in zip(middle, wide.count, strict=True):
        below.text(x, count, f"{count}", ha="center", va="bottom", fontsize=9.5, color=MUTED)
    below.set_ylim(0, wide.count.max() * 1.32)


def _claims(axes: Axes, part: Samples, names: Sequence[str]) -> None:
    for k, views in enumerate(names):
        group = part.of_views(views)
        if len(group) < MIN_SAMPLES:
            continue
        right, count = np.array([group.correct.sum()]), np.array([len(group)])
        low, high = st.wilson(right, count)
        share = right / count
        spread = np.maximum(0.0, [share - low, high - share])
        axes.errorbar([k - 0.16], share, spread, fmt=MARKER["true"], ms=7,
                      color=INK, capsize=3, lw=1.6, mec="white", label="_")  # fmt: skip
        for shift, name in ((0.0, "S"), (0.16, "Ψ")):
            score = score_of(group, name)
            low, high = np.quantile(score, [0.25, 0.75])
            axes.plot([k + shift] * 2, [low, high], color=COLOR[name], lw=5, alpha=0.35, label="_")
            axes.plot(
                [k + shift],
                [score.mean()],
                MARKER[name],
                color=COLOR[name],
                ms=7,
                mec="white",
                label="_",
            )
    for name in ("true", "S", "Ψ"):
        label = NAME[name] if name == "true" else f"mean {name}, half of all"
        axes.plot([], [], MARKER[name], color=COLOR[name], ms=7, mec="white", label=label)


def _points(
    axes: Axes,
    places: Sequence[str],
    known: dict[tuple[str, str], Row],
    name: str,
    shift: float,
    figure: str,
    upright: bool = True,
) -> None:
    """Plot one statistic of a score with its interval, at each place that has a value."""
    at, values, low, high = [], [], [], []
    for k, place in enumerate(places):
        row = known.get((place, name))
        value = getattr(row, figure) if row else np.nan
        if row is None or not np.isfinite(value):
            continue
        at.append(k + shift)
        values.append(value)
        spread = value - getattr(row, f"{figure}_low"), getattr(row, f"{figure}_high") - value
        low.append(max(0.0, spread[0]) if np.isfinite(spread[0]) else np.nan)
        high.append(max(0.0, spread[1]) if np.isfinite(spread[1]) else np.nan)
    look = {"fmt": MARKER[name], "color": COLOR[name], "ms": 8, "capsize": 3, "lw": 1.8,
            "mec": "white", "mew": 1, "label": name}  # fmt: skip
    if upright:
        axes.errorbar(at, values, [low, high], **look)
    else:
        axes.errorbar(values, at, xerr=[low, high], **look)


def _figure(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "–"


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _png(canvas: Canvas) -> bytes:
    out = io.BytesIO()
    canvas.savefig(out, format="png", dpi=DPI)
    plt.close(canvas)
    return out.getvalue()
