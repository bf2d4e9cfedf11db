"""Chart of an error model: how often things get their right name, and what that is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from helios_core.atomic_file import replacing
from helios_core.detector_error_model import DetectorErrorModel, RateBand
from numpy.typing import NDArray

from helios_eval.calibration.charts import STYLE
from helios_eval.calibration.statistics import equal_width_edges, reliability
from helios_eval.error_models.model_building import Built, NamesChecked
from helios_eval.palette import BLUE, GREEN, GREY, VERMILION

mpl.use("Agg")

RIGHT, WRONG, BEFORE, AFTER = BLUE, VERMILION, GREY, GREEN
LEAST_BIN = 10  # names of a bin of the reliability diagram


def draw(built: Built, file: Path) -> None:
    """Rates by pixels (or names by distance) beside reliability (or repeats by angle)."""
    from matplotlib import pyplot as plt

    with mpl.rc_context(STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(11.5, 4.8), constrained_layout=True)
        _rates(left, built.model)
        if built.checked is not None:
            _reliability(right, built.checked)
        else:
            _repeats(right, built.model)
        with replacing(file) as part:
            figure.savefig(part, dpi=110, format="png")
        plt.close(figure)


def _rates(axes: Any, model: DetectorErrorModel) -> None:
    bands: Sequence[RateBand] = model.rates_by_pixels
    if bands:
        x = [math.sqrt(b.low * b.high) for b in bands]
        axes.plot(x, [b.right for b in bands], "o-", color=RIGHT, label="right name")
        axes.plot(x, [b.wrong for b in bands], "s--", color=WRONG, label="only a wrong name")
        axes.set(
            xscale="log",
            xlabel="visible pixels",
            ylabel="share of sightings",
            title="What an object gets in one image",
        )
    else:
        near = model.naming_by_distance
        x = [math.sqrt(b.low * b.high) for b in near]
        axes.plot(x, [b.right for b in near], "o-", color=RIGHT, label="its likeliest name")
        axes.plot(
            x, [b.other for b in near], "s--", color=WRONG, label="each other name that it got"
        )
        axes.set(
            xlabel="distance (m)",
            ylabel="share of views that name it",
            title="Names of a thing by distance",
        )
    axes.set_ylim(0, 1)
    axes.legend(loc="best")


def _reliability(axes: Any, checked: NamesChecked) -> None:
    axes.plot([0, 1], [0, 1], ":", color="black", lw=1)
    for name, score, color, mark in (
        ("broad prior", checked.before, BEFORE, "s--"),
        ("fitted to other scenes", checked.after, AFTER, "o-"),
    ):
        bins = reliability(score, checked.right, equal_width_edges())
        kept = bins.count >= LEAST_BIN
        low, high = bins.true - bins.true_low, bins.true_high - bins.true
        errors: NDArray[np.float64] = np.clip(np.stack([low, high]), 0, None)[:, kept]
        axes.errorbar(
            bins.score[kept], bins.true[kept], errors, fmt=mark, color=color, label=name, capsize=3
        )
    axes.set(
        xlabel="probability of the name by the map's rule",
        ylabel="share that is right",
        xlim=(0, 1),
        ylim=(0, 1),
        title="What the map's probability is worth",
    )
    axes.legend(loc="upper left")


def _repeats(axes: Any, model: DetectorErrorModel) -> None:
    bands = model.repeats_by_angle
    x = [(b.low_deg + b.high_deg) / 2 for b in bands]
    axes.plot(x, [b.same for b in bands], "o-", color=RIGHT, label="the same name")
    axes.plot(x, [b.other for b in bands], "s--", color=WRONG, label="another name only")
    axes.set(
        xlabel="angle between two views of a place (degrees)",
        ylabel="share of pairs",
        ylim=(0, 1),
        title="What another view says of it",
    )
    if bands:
        axes.legend(loc="upper right")
