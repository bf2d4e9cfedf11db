"""Error model of a detector from what it said: parameters with intervals, and its description."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from helios_client.version import helios_version
from helios_core.detector_error_model import (
    DetectorErrorModel,
    Estimate,
    FitSource,
    NameErrorEstimates,
    NamingBand,
    RateBand,
    RepeatBand,
    ScorePoint,
    VarianceShares,
)
from helios_core.errors import InvalidInput
from helios_objectmap.instances.name_sightings import BROAD_PRIOR
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
from scipy.special import expit

from helios_eval.calibration.statistics import (
    Z_95,
    auroc,
    bin_of,
    equal_count_edges,
)
from helios_eval.error_models.name_error_fit import (
    UNKNOWN,
    NameCounts,
    NameFit,
    counts_of,
    covariance,
    fitted,
    instances,
    log_loss,
    probabilities,
    shares,
)
from helios_eval.error_models.named_things import NamedThing
from helios_eval.error_models.recordings import RecordedSightings
from helios_eval.error_models.simulated_homes import HomeSightings
from helios_eval.studies.detector_errors.error_summary import (
    DISTANCES_M,
    LEAST_SCORE,
    PIXELS,
    Rates,
    summary,
)
from helios_eval.studies.detector_errors.noise_fit import shares_of, widening
from helios_eval.studies.detector_errors.repeat_rates import ANGLES_DEG, RepeatRates
from helios_eval.studies.detector_errors.sightings import FalseAlarms, Sightings

LEAST_SCENES = 5  # scenes from which whole scenes count as independent; below, single things
LEAST_THINGS = 10  # things of a fit
FOLDS = 5
LEAST_BAND, LEAST_PAIRS = 10, 30  # of a band that is given
FITTED = ("hit", "mistaken", "sides_correlate", "rival")


@dataclass(frozen=True)
class NamesChecked:
    """The map's probability that a name is right, of names whose truth is known: [m] each."""

    right: NDArray[np.bool_]
    before: NDArray[np.float64]  # with the broad prior
    after: NDArray[np.float64]  # fitted to other scenes

    def figures(self) -> dict[str, tuple[float, float]]:
        """(log loss, AUROC) before and after."""
        return {
            name: (
                float(log_loss(p, self.right.astype(np.float64)).mean()),
                float(auroc(p, self.right)[0]),
            )
            for name, p in (("broad prior", self.before), ("fitted", self.after))
        }


@dataclass(frozen=True)
class Built:
    """An error model, the fit of its names, and its check where truth is known."""

    model: DetectorErrorModel
    fit: NameFit
    checked: NamesChecked | None


def of_homes(seen: HomeSightings, what: str, spec: str, with_truth: bool) -> Built:
    """Model from simulated homes. with_truth: False groups the detections as of a recording."""
    things = seen.true_things if with_truth else seen.found_things
    counts, fit, names, none = _names(things)
    sightings, alarms = seen.arm.log.sightings(), seen.arm.log.false_alarms()
    told = summary(sightings, alarms) if with_truth else None
    model = DetectorErrorModel(
        detector=seen.detector,
        digest=_digest(spec),
        names=names,
        none=none,
        source=_source(what, counts, seen.views),
        naming_by_distance=_naming(things, shares(counts, fit.model)),
        rates_by_pixels=_bands(PIXELS, told.by_pixels) if told else (),
        rates_by_distance=_bands(DISTANCES_M, told.by_distance) if told else (),
        false_alarms_per_image=told.alarms if told else None,
        false_alarms_per_name=told.alarms_per_name if told else None,
        variance=_variance(asdict(told)) if told else None,
        score_calibration=score_points(sightings, alarms) if told else (),
    )
    return Built(model, fit, _checked(counts))


def of_recordings(seen: RecordedSightings, what: str, spec: str) -> Built:
    """Model from recordings."""
    counts, fit, names, none = _names(seen.things)
    model = DetectorErrorModel(
        detector=seen.detector,
        digest=_digest(spec),
        names=names,
        none=none,
        source=_source(what, counts, seen.views),
        naming_by_distance=_naming(seen.things, shares(counts, fit.model)),
        repeats_by_angle=_repeats(seen.repeats),
    )
    return Built(model, fit, _checked(counts))


def _names(
    things: Sequence[NamedThing],
) -> tuple[NameCounts, NameFit, NameErrorEstimates, Estimate]:
    counts = counts_of(things)
    if len(counts) < LEAST_THINGS:
        raise InvalidInput(
            f"only {len(counts)} things got a name from enough views; wanted {LEAST_THINGS}: give "
            "a longer recording that goes around its things, or more of them"
        )
    fit = fitted(counts)
    low, high = intervals(counts, fit)
    errors = asdict(fit.errors)
    if not fit.errors.hit > fit.errors.mistaken:
        raise InvalidInput(
            "the names that the detector gives do not repeat from view to view, so no name can be "
            "told from a wrong one; give a longer recording, or another detector"
        )
    estimates = {
        name: Estimate(value=errors[name], low=low[k], high=high[k])
        for k, name in enumerate(FITTED)
    }
    return (
        counts,
        fit,
        NameErrorEstimates(**estimates),
        Estimate(value=fit.none, low=low[-1], high=high[-1]),
    )


def intervals(counts: NameCounts, fit: NameFit) -> tuple[list[float], list[float]]:
    """95 % intervals of `FITTED` and of `none`, over scenes, or over the things of fewer than
    `LEAST_SCENES` scenes."""
    spread = covariance(counts, fit, _units(counts))
    deviation = np.sqrt(np.diag(spread))
    slope = float(np.exp(fit.rule[0]))
    turn = np.zeros(len(spread))
    turn[[0, 4]] = 1.0, -slope  # log-odds of `mistaken` by those of `hit` and the log of the slope
    at = [fit.model[0], fit.model[0] - slope, fit.rule[1], fit.rule[2], fit.model[3]]
    of = [deviation[0], float(np.sqrt(turn @ spread @ turn)), *deviation[[5, 6, 3]]]
    scale = [expit, expit, expit, np.exp, expit]
    low, high = (
        [float(f(x + side * Z_95 * d)) for f, x, d in zip(scale, at, of, strict=True)]
        for side in (-1, 1)
    )
    return low, high


def _units(counts: NameCounts) -> NDArray[np.int64]:
    """Unit [n] of each thing: its scene, or itself with few scenes."""
    scenes, of_thing = np.unique(counts.scene, return_inverse=True)
    return of_thing if len(scenes) >= LEAST_SCENES else np.arange(len(counts))


def _checked(counts: NameCounts) -> NamesChecked | None:
    """Cross-validated check on the things whose truth is known; None with too few of them."""
    known = counts.part(counts.right != UNKNOWN)
    if len(known) < 2 * LEAST_THINGS:
        return None
    unit = _units(counts)
    fold = (unit % FOLDS)[counts.right != UNKNOWN]
    listed = instances(known)
    before = probabilities(known, BROAD_PRIOR)
    after = np.empty_like(before)
    for k in range(FOLDS):
        if (fold == k).any():
            errors = fitted(counts.part(unit % FOLDS != k)).errors
            after[fold == k] = probabilities(known.part(fold == k), errors)
    columns = np.arange(listed.shape[1])[None, :]
    right = (columns == known.right[:, None])[listed]
    if right.all() or not right.any():
        return None
    return NamesChecked(right, before[listed], after[listed])


def _source(what: str, counts: NameCounts, views: int) -> FitSource:
    known = int((counts.right != UNKNOWN).sum())
    truth = "truth" if known == len(counts) else "some truth" if known else "agreement"
    return FitSource(
        what=what,
        truth=truth,
        views=views,
        things=len(counts),
        things_with_truth=known,
        sides=round(float(counts.sides.sum()), 1),
        made_with=helios_version(),
    )


def _digest(spec: str) -> str:
    """SHA-256 of the model file of a detector, "" without one."""
    path = Path(spec.partition(":")[2])
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _naming(things: Sequence[NamedThing], share: NDArray[np.float64]) -> tuple[NamingBand, ...]:
    """Names by distance. share: [things, names + 1] probability that each name is right."""
    total = np.zeros((len(DISTANCES_M) - 1, 4))  # views, right, pairs of view and other name, given
    for thing, likely in zip(things, share, strict=True):
        given = thing.views.given
        likely = likely[: given.shape[1]]
        away_m = np.linalg.norm(thing.views.eyes_m - thing.center_m, axis=1)
        band = np.searchsorted(DISTANCES_M, away_m, "right") - 1
        inside = (band >= 0) & (band < len(total))
        known = float(likely.sum())
        row = np.stack(
            [
                np.full(len(given), known),
                given @ likely,
                np.full(len(given), float((1 - likely).sum())),
                given @ (1 - likely),
            ],
            -1,
        )
        np.add.at(total, band[inside], row[inside])
    return tuple(
        NamingBand(
            low=low,
            high=high,
            right=min(1.0, right / views),
            other=min(1.0, other / max(pairs, 1e-9)),
            views=round(views, 1),
        )
        for (low, high), (views, right, pairs, other) in zip(
            itertools.pairwise(DISTANCES_M), total.tolist(), strict=True
        )
        if views >= LEAST_BAND
    )


def _bands(borders: Sequence[float], rates: Sequence[Rates]) -> tuple[RateBand, ...]:
    return tuple(
        RateBand(low=low, high=high, right=r.right, wrong=r.wrong, none=r.none, sightings=r.n)
        for (low, high), r in zip(itertools.pairwise(borders), rates, strict=True)
        if r.n >= LEAST_BAND
    )


def _variance(figures: dict) -> VarianceShares | None:
    """Shares of variance, from the correlations of "right name" of ever wider relations."""
    try:
        return VarianceShares(**shares_of(*widening(figures)))
    except InvalidInput:  # too few pairs
        return None


def _repeats(repeats: RepeatRates) -> tuple[RepeatBand, ...]:
    bands = zip(
        itertools.pairwise(ANGLES_DEG), repeats.pairs, repeats.same, repeats.other, strict=True
    )
    return tuple(
        RepeatBand(low_deg=low, high_deg=high, same=same / n, other=other / n, pairs=int(n))
        for (low, high), n, same, other in bands
        if n >= LEAST_PAIRS
    )


def score_points(seen: Sightings, alarms: FalseAlarms) -> tuple[ScorePoint, ...]:
    """Share of right names by score, rising: isotonic regression over bins of equal counts."""
    score = np.concatenate([seen.right, seen.wrong, alarms.score])
    right = np.zeros(len(score))
    right[: len(seen)] = 1.0
    kept = score >= LEAST_SCORE
    score, right = score[kept], right[kept]
    if len(score) < LEAST_BAND:
        return ()
    edges = equal_count_edges(score, 12)
    at = bin_of(score, edges)
    n = np.bincount(at, minlength=len(edges) - 1).astype(float)
    filled = n > 0
    mean = np.bincount(at, score, len(n))[filled] / n[filled]
    share = np.bincount(at, right, len(n))[filled] / n[filled]
    rising = isotonic_regression(share, weights=n[filled]).x
    return tuple(
        ScorePoint(score=min(1.0, float(s)), right=float(np.clip(r, 0, 1)), detections=int(k))
        for s, r, k in zip(mean, rising, n[filled], strict=True)
        if not math.isnan(s)
    )
