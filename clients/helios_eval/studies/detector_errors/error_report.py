"""Tables and a chart of the error study: one column for each detector."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from helios_core.atomic_file import replacing

from helios_eval.palette import BLUE, GREEN, GREY, PINK, VERMILION
from helios_eval.studies.detector_errors.error_summary import (
    DISTANCES_M,
    PIXELS,
    QUANTILES,
    Rates,
    Summary,
)
from helios_eval.studies.detector_errors.persistence import RELATIONS, Correlation
from helios_eval.studies.detector_errors.repeat_rates import ANGLES_DEG, RepeatRates

mpl.use("Agg")

COLORS = (GREEN, VERMILION, BLUE, PINK, GREY)
LEAST_REPEATS = 30  # a share of fewer pairs is not given


def markdown(
    found: Mapping[str, Summary],
    repeats: Mapping[str, RepeatRates],
    scores: Mapping[str, Sequence[float]],
) -> str:
    """All tables of the study. scores: quantiles of all detections, by detector and images."""
    parts = [
        "# Errors of detectors\n",
        _section("Unobstructed objects: right name (95 % interval over homes), only a wrong name, "
                 "nothing; score ≥ 0.25", found, [
            ("all", lambda s: _three(s.all)),
            *((f"{low:,} to {high:,} px", lambda s, k=k: _three(s.by_pixels[k]))
              for k, (low, high) in enumerate(itertools.pairwise(PIXELS))),
            *((f"{low:g} to {high:g} m", lambda s, k=k: _three(s.by_distance[k]))
              for k, (low, high) in enumerate(itertools.pairwise(DISTANCES_M))),
            ("partly hidden objects", lambda s: _three(s.obstructed)),
            ("sightings", lambda s: f"{s.sightings:,}"),
        ]),
        _section("Wrong names and false alarms", found, [
            ("reported for an object: one asked wrong name",
             lambda s: _percent(s.wrong_per_name, 2)),
            ("a wrong name beside a right one", lambda s: _percent(s.wrong_with_right)),
            ("with a wrong name, by class: least, median, most",
             lambda s: _spread(s.wrong_by_class)),
            ("false alarms per image", lambda s: f"{s.alarms:.2f}"),
            ("false alarms per image and asked name", lambda s: f"{s.alarms_per_name:.4f}"),
            ("most frequent", lambda s: ", ".join(f"{n} {k}" for n, k in s.alarm_names) or "–"),
        ]),
        _section("False alarms per 100 images, by the pixels of the box and the median depth in it",
                 found, [
            *((f"{low:,} to {high:,} px", lambda s, k=k: f"{s.alarms_by_pixels[k]:.1f}")
              for k, (low, high) in enumerate(itertools.pairwise(PIXELS))),
            *((f"{low:g} to {high:g} m", lambda s, k=k: f"{s.alarms_by_distance[k]:.1f}")
              for k, (low, high) in enumerate(itertools.pairwise(DISTANCES_M))),
        ]),
        _section("Scores at 10, 25, 50, 75 and 90 % of those from 0.1 on", found, [
            ("right name", lambda s: _row(s.right_scores)),
            ("wrong name", lambda s: _row(s.wrong_scores)),
            ("false alarm", lambda s: _row(s.alarm_scores)),
            ("right and wrong score of one object: rank correlation",
             lambda s: _number(s.scores_together)),
        ]),
        _section("Persistence: latent correlation of “right name” in two images", found, [
            (name, lambda s, name=name: _interval(s.right_persists[name])) for name in RELATIONS
        ]),
        _section("Persistence: latent correlation of “wrong name” in two images", found, [
            (name, lambda s, name=name: _interval(s.wrong_persists[name])) for name in RELATIONS
        ]),
        _section("The same wrong name, of pairs with a wrong name each", found, [
            (name, lambda s, name=name: _percent(s.same_wrong_name[name])) for name in RELATIONS
        ]),
        _section("Rank correlation of the scores of right names in two images", found, [
            (name, lambda s, name=name: _number(s.score_persists[name])) for name in RELATIONS
        ]),
    ]  # fmt: skip
    parts.append(_score_table(scores))
    if repeats:
        parts.append(_repeat_table(repeats))
    return "\n".join(parts)


def chart(found: Mapping[str, Summary], file: Path) -> None:
    """Rates by pixels, persistence by relation, and quantiles of the scores."""
    from matplotlib import pyplot as plt

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 4.6), constrained_layout=True)
    middles = [math.sqrt(a * b) for a, b in itertools.pairwise(PIXELS)]
    for (name, s), color in zip(found.items(), COLORS, strict=False):
        shown = [k for k, rates in enumerate(s.by_pixels) if rates.n >= LEAST_REPEATS]
        x = [middles[k] for k in shown]
        left.plot(x, [s.by_pixels[k].right for k in shown], "o-", color=color, label=name)
        left.plot(x, [s.by_pixels[k].wrong for k in shown], "x--", color=color)
        values = [s.right_persists[r] for r in RELATIONS]
        y = np.array([c.value for c in values])
        errors = np.abs(np.array([[c.low for c in values], [c.high for c in values]]) - y)
        middle.errorbar(np.arange(len(y)), y, errors, fmt="o-", color=color, label=name, capsize=3)
        right.plot(QUANTILES, s.right_scores, "o-", color=color, label=name)
        right.plot(QUANTILES, s.wrong_scores, "x--", color=color)
    left.set(
        xscale="log",
        xlabel="visible pixels",
        ylabel="share of sightings",
        ylim=(0, 1),
        title="right name (–), only a wrong name (- -)",
    )
    middle.set_xticks(range(len(RELATIONS)), RELATIONS, rotation=35, ha="right", fontsize=8)
    middle.set(ylabel="latent correlation", title="persistence of “right name”", ylim=(-0.25, 1))
    right.set(
        xlabel="share of detections below",
        ylabel="score",
        ylim=(0, 1),
        title="scores: right (–), wrong (- -)",
    )
    for axes in (left, middle, right):
        axes.grid(alpha=0.3)
    left.legend(fontsize=8)
    with replacing(file) as part:
        figure.savefig(part, dpi=110, format="png")
    plt.close(figure)


def _section(
    title: str,
    found: Mapping[str, Summary],
    rows: Iterable[tuple[str, Callable[[Summary], str]]],
) -> str:
    lines = [f"## {title}", "", _head(found)]
    for name, cell in rows:
        cells = [cell(s) for s in found.values()]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _head(found: Mapping[str, object]) -> str:
    return f"| | {' | '.join(found)} |\n|---|" + "--:|" * len(found)


def _repeat_table(repeats: Mapping[str, RepeatRates]) -> str:
    lines = [
        "## The same name again, another name only, of places seen in another image",
        "",
        _head(repeats),
    ]
    for k, (low, high) in enumerate(itertools.pairwise(ANGLES_DEG)):
        cells = [
            f"{r.same[k] / r.pairs[k]:.0%}, {r.other[k] / r.pairs[k]:.0%} of {r.pairs[k]:,}"
            if r.pairs[k] >= LEAST_REPEATS
            else "–"
            for r in repeats.values()
        ]
        lines.append(f"| {low}° to {high}° | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _score_table(scores: Mapping[str, Sequence[float]]) -> str:
    lines = [
        "## Scores of all detections from 0.1 on\n",
        "Right or wrong: real frames have no truth.\n",
        "| images | 10, 25, 50, 75 and 90 % |",
        "|---|--:|",
        *(f"| {name} | {_row(values)} |" for name, values in scores.items()),
    ]
    return "\n".join(lines) + "\n"


def _three(rates: Rates) -> str:
    if not rates.n:
        return "–"
    right = f"{100 * rates.right:.0f} ({100 * rates.right_low:.0f}–{100 * rates.right_high:.0f})"
    return f"{right}, {100 * rates.wrong:.0f}, {100 * rates.none:.0f} %"


def _percent(value: float, digits: int = 0) -> str:
    return "–" if math.isnan(value) else f"{100 * value:.{digits}f} %"


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"


def _row(values: Sequence[float]) -> str:
    return ", ".join(_number(value) for value in values)


def _spread(values: Mapping[str, float]) -> str:
    if not values:
        return "–"
    shares = np.array(list(values.values()))
    return (
        ", ".join(f"{100 * q:.0f}" for q in (shares.min(), np.median(shares), shares.max())) + " %"
    )


def _interval(c: Correlation) -> str:
    return f"{c.value:.2f} ({c.low:.2f} to {c.high:.2f})" if c.pairs else "–"
