"""Calibration statistics of every group: setting, role, number of views, score."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from helios_eval.calibration import statistics as st
from helios_eval.calibration.samples import ROLES, VIEWS, Samples

ALL = "all"
MIN_SAMPLES = 20  # samples; smaller groups are left out
FEWEST_EPISODES = 6  # fewer are too few for a bootstrap over episodes
RESAMPLES = 1000
SEED = 20250101  # resampling seed: equal records give an equal report
EDGES = st.equal_width_edges(10)
SCORES = ("S", "Ψ", "−U")


@dataclass(frozen=True)
class Row:
    """Statistics of one score in one group.

    NaN where a statistic is undefined: −U is no probability, AUROC needs right and wrong beliefs,
    and an interval needs `FEWEST_EPISODES` episodes.
    """

    setting: str
    role: str  # one of samples.ROLES
    views: str  # a name in samples.VIEWS, or ALL
    score: str  # one of SCORES
    samples: int
    episodes: int
    true: float  # share of correct beliefs
    mean: float  # mean score
    ece: float
    ece_low: float  # 95 % interval by bootstrap over episodes
    ece_high: float
    ece_by_chance: float  # 95th percentile if the score were calibrated
    ece_adaptive: float
    mce: float
    brier: float
    brier_reliability: float
    brier_resolution: float
    brier_uncertainty: float
    brier_within: float
    auroc: float
    auroc_low: float
    auroc_high: float

    def cells(self) -> dict[str, object]:
        """Columns for tables and JSON: rounded to four digits, None for NaN."""
        return {name: _cell(value) for name, value in asdict(self).items()}


def rows_of(groups: Mapping[str, Samples]) -> list[Row]:
    """Rows of all settings; groups with fewer than `MIN_SAMPLES` samples are left out."""
    out = []
    for setting, samples in groups.items():
        for role in ROLES:
            of_role = samples.of_role(role)
            parts = [(ALL, of_role), *((name, of_role.of_views(name)) for name, _, _ in VIEWS)]
            for views, part in parts:
                if len(part) >= MIN_SAMPLES:
                    out += [_row(setting, role, views, name, part) for name in SCORES]
    return out


def score_of(samples: Samples, name: str) -> st.Scores:
    """Values [n] of a score by its name in SCORES."""
    return {"S": samples.class_score, "Ψ": samples.score, "−U": -samples.uncertainty}[name]


def adaptive_edges(score: st.Scores) -> st.Scores:
    """Edges of at most ten bins of equal counts, with at least 25 samples each if there are 50."""
    return st.equal_count_edges(score, int(np.clip(len(score) // 25, 2, 10)))


def _row(setting: str, role: str, views: str, name: str, samples: Samples) -> Row:
    score, truth = score_of(samples, name), samples.correct
    rng = np.random.default_rng(SEED)
    nan = math.nan

    def interval(figure: Callable[[st.Weights], st.Scores]) -> tuple[float, float]:
        if samples.episodes < FEWEST_EPISODES:
            return nan, nan
        return st.percentile_interval(st.bootstrap(figure, samples.episode, RESAMPLES, rng))

    area = float(st.auroc(score, truth)[0])
    area_low, area_high = interval(lambda w: st.auroc(score, truth, w))
    found = chance = low = high = adaptive = most = nan
    parts = st.Brier(nan, nan, nan, nan, nan)
    if name != "−U":
        found = float(st.ece(score, truth, EDGES)[0])
        low, high = interval(lambda w: st.ece(score, truth, EDGES, w))
        _, chance = st.ece_if_calibrated(score, EDGES, RESAMPLES, rng)
        adaptive = float(st.ece(score, truth, adaptive_edges(score))[0])
        most = st.mce(st.reliability(score, truth, EDGES))
        parts = st.brier(score, truth, EDGES)
    return Row(
        setting, role, views, name, len(samples), samples.episodes, float(truth.mean()),
        float(score.mean()), found, low, high, chance, adaptive, most, parts.total,
        parts.reliability, parts.resolution, parts.uncertainty, parts.within, area, area_low,
        area_high,
    )  # fmt: skip


def _cell(value: object) -> object:
    if isinstance(value, float):
        return None if math.isnan(value) else round(value, 4)
    return value
