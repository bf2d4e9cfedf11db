"""Charts of the beliefs about objects, and of the number of Gaussians, over the frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helios_core.atomic_file import replacing
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from helios_eval.palette import BLUE, GREEN, GREY, INK, ORANGE, PINK, SKY, VERMILION
from helios_eval.studies.real_frames_beliefs import EpisodeProgress, names_in

BELIEVED = 0.5  # the planner's acceptance threshold for Psi
CLAIMED = 2.0  # times the probability of an undetected class, from which a class claims an object
WIDE = 5.0  # numbers of Gaussians that differ by more than this factor get a log scale
COLORS = (GREEN, BLUE, VERMILION, PINK, ORANGE, SKY, INK)
STYLES = ("-", ":", "-.", (0, (4, 1)), (0, (1, 3)))  # Psi first, then rival classes
WIDTH_IN, DPI = 9.0, 110


@dataclass(frozen=True)
class Curve:
    """One line of a chart."""

    thing: str  # curves of one object share a colour
    label: str
    frames: NDArray[np.int64]  # [n]
    values: NDArray[np.float64]  # [n] NaN where there is no such object
    rival: int = 0  # 0 for Psi; from 1 on for probabilities of rival classes


def drawn(found: dict[str, EpisodeProgress], named: Sequence[str]) -> list[str]:
    """Names of the objects to draw.

    With `named` these; otherwise those accepted at some frame, or all if none was.
    """
    names = names_in(found)
    if named:
        return [name for name in named if name in names]
    return [
        n for n in names if any(course.highest(n) >= BELIEVED for course in found.values())
    ] or names


def belief_curves(course: EpisodeProgress, things: Sequence[str]) -> list[Curve]:
    """Psi of each object, and the mean probability of each rival class."""
    out, frames = [], np.array(course.frames)
    for thing in things:
        rows = [row.get(thing) for row in course.seen]
        own = next((s.class_name for s in rows if s is not None), None)
        if own is None:
            continue
        alias = f"{thing} as {own}" if own not in thing else thing
        psi = np.array([np.nan if s is None else s.psi for s in rows])
        out.append(Curve(thing, f"{alias}: Ψ", frames, psi))
        for rank, rival in enumerate(rivals_of(course, thing), start=1):
            claim = np.array([np.nan if s is None else s.probabilities[rival] for s in rows])
            label = f"{thing} as {rival}: mean probability"
            out.append(Curve(thing, label, frames, claim, rank))
    return out


def rivals_of(course: EpisodeProgress, thing: str) -> list[str]:
    """Rival classes of an object, sorted: classes besides its own that claim it.

    Classes that were never detected at an object are equally likely there. A class that at some
    frame is more than `CLAIMED` times as likely as the least likely one was thus detected there.
    This takes at least two other classes.
    """
    rivals: set[str] = set()
    for seen in (row[thing] for row in course.seen if thing in row):
        own = (seen.class_name, "other")
        others = {name: p for name, p in seen.probabilities.items() if name not in own}
        if others:
            least = min(others.values())
            rivals |= {name for name, p in others.items() if p > CLAIMED * least}
    return sorted(rivals)


def count_curves(found: dict[str, EpisodeProgress]) -> list[Curve]:
    """Thousands of Gaussians of each map."""
    return [
        Curve(arm, c.title(arm), np.array(c.frames), np.array(c.gaussians) / 1e3)
        for arm, c in found.items()
    ]


def draw_beliefs(found: dict[str, EpisodeProgress], named: Sequence[str], path: Path) -> None:
    """Draw the beliefs, one panel per map."""
    things = drawn(found, named)
    colors = {thing: COLORS[i % len(COLORS)] for i, thing in enumerate(things)}
    panels = len(found)
    figure = Figure(figsize=(WIDTH_IN, 0.7 + 3.4 * panels), dpi=DPI, layout="constrained")
    axes = figure.subplots(panels, 1, sharex=True, squeeze=False)
    for (arm, course), axis in zip(found.items(), axes[:, 0], strict=True):
        for curve in belief_curves(course, things):
            axis.plot(
                curve.frames,
                curve.values,
                color=colors[curve.thing],
                label=curve.label,
                ls=STYLES[min(curve.rival, len(STYLES) - 1)],
                lw=1.2 if curve.rival else 1.6,
            )
        axis.axhline(BELIEVED, color=GREY, lw=0.8, ls="--")
        axis.text(
            1.005, BELIEVED, "τ", color=GREY, va="center", transform=axis.get_yaxis_transform()
        )
        axis.set_title(course.title(arm), loc="left", fontsize=10)
        axis.set(ylabel="belief", ylim=(0, 1))
        if axis.get_legend_handles_labels()[0]:
            axis.legend(frameon=False, ncol=2, fontsize=8, loc="best")
    axes[-1, 0].set_xlabel("frame")
    _finish(figure, axes[:, 0].tolist(), path)


def draw_counts(found: dict[str, EpisodeProgress], path: Path) -> None:
    """Draw the numbers of Gaussians of all maps in one panel."""
    figure = Figure(figsize=(WIDTH_IN, 3.6), dpi=DPI, layout="constrained")
    axis = figure.subplots()
    curves = count_curves(found)
    for i, curve in enumerate(curves):
        axis.plot(curve.frames, curve.values, color=COLORS[i % len(COLORS)], label=curve.label)
    ends = [curve.values[-1] for curve in curves]
    axis.set(xlabel="frame", ylabel="thousand Gaussians")
    if min(ends) > 0 and max(ends) > WIDE * min(ends):
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())
    else:
        axis.set_ylim(0, None)
    axis.legend(frameon=False, fontsize=9, loc="best")
    _finish(figure, [axis], path)


def _finish(figure: Figure, axes: Sequence[Axes], path: Path) -> None:
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0.01)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        figure.savefig(temporary)
