"""Figures of the calibration report, made from episode records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from helios_eval.calibration import charts
from helios_eval.calibration.samples import by_setting, samples_of
from helios_eval.calibration.summary import (
    ALL,
    FEWEST_EPISODES,
    MIN_SAMPLES,
    RESAMPLES,
    Row,
    rows_of,
)
from helios_eval.episodes.episode_record import EpisodeRecord

_SHORT = (
    "setting", "role", "views", "score", "samples", "episodes", "true", "mean", "ece", "ece_low",
    "ece_high", "ece_by_chance", "auroc", "auroc_low", "auroc_high",
)  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """Chart for a report, with its numbers."""

    title: str
    caption: str
    png: bytes = field(repr=False)
    table: list[dict[str, object]] = field(repr=False)


def figures(records: Sequence[EpisodeRecord], every_step: bool = False) -> list[Figure]:
    """All figures, most important first; an empty list if no setting has enough beliefs.

    Episodes are grouped by the noise of their detector and by every other setting that differs.
    """
    groups = {
        name: samples_of(episodes, every_step) for name, episodes in by_setting(records).items()
    }
    rows = rows_of(groups)
    out = []
    if len({row.setting for row in rows}) > 1:
        out.append(_settings(rows))
    for setting, samples in groups.items():
        own = [row for row in rows if row.setting == setting]
        if own:
            out.append(_reliability(setting, charts.reliability_png(samples, own), own))
        if any(row.views != ALL for row in own):
            out.append(_views(setting, charts.views_png(samples, own), own))
    return out


def _settings(rows: list[Row]) -> Figure:
    return Figure(
        "Calibration by the detector's noise",
        "Expected calibration error (lower is better) and area under the ROC curve (higher is "
        "better; 0.5 is a coin) of the class score S, of Ψ = S − α U, and of −U alone, against the "
        "truth. Bars: 95 % by bootstrap over episodes, where there are at least "
        f"{FEWEST_EPISODES}.",
        charts.settings_png(rows),
        [_some(row) for row in rows if row.views == ALL],
    )


def _reliability(setting: str, png: bytes, rows: list[Row]) -> Figure:
    count = rows[0].episodes
    interval = f"its 95 % interval by bootstrap over {count} episodes ({RESAMPLES} resamples)"
    if count < FEWEST_EPISODES:
        interval = f"no interval, since {count} episodes are too few for one"
    return Figure(
        f"Reliability: {setting}",
        "How often a belief is right, by what the map says of it. On the dashed line a score of "
        "0.7 is right seven times in ten; below it the map is too sure of itself. S is meant as a "
        "probability; Ψ is S less the uncertainty, so it should lie above the line. Below: beliefs "
        "per bin, right ones in colour. "
        f"ECE with {interval}; “by chance”: 95 % of perfectly calibrated scores would show less.",
        png,
        [row.cells() for row in rows if row.views == ALL],
    )


def _views(setting: str, png: bytes, rows: list[Row]) -> Figure:
    return Figure(
        f"What more views bring: {setting}",
        "Left: how often beliefs are right (95 % interval), and the mean of S and Ψ with the "
        "middle half of their values. Middle: expected calibration error; grey marks: 95 % of "
        "calibrated scores would be below. Right: how well each score tells right from wrong. "
        f"Groups of fewer than {MIN_SAMPLES} beliefs are left out.",
        png,
        [_some(row) for row in rows if row.views != ALL],
    )


def _some(row: Row) -> dict[str, object]:
    cells = row.cells()
    return {name: cells[name] for name in _SHORT}
