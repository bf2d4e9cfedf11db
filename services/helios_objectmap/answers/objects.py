"""What the map answers: instances with their figures, and their Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.types import ObjectInstance
from numpy.typing import NDArray

from helios_objectmap.answers.score import Score, weighed
from helios_objectmap.evidence.dirichlet import concentration_of
from helios_objectmap.instances.registry import InstanceRecord
from helios_objectmap.kernels.describing import (
    beliefs_kernel,
    gather_kernel,
    inside_kernel,
    outer_kernel,
    ranked_kernel,
)
from helios_objectmap.store.gaussians import GaussianStore

BELIEVED = 0.5  # more likely than not
SURE, SUREST = 0.7, 0.95  # share of the probability of the surest, and which one that is
# A pixel on an edge that mixes two depths makes a stray Gaussian; a few must not move the box.
BOX_QUANTILES = (0.02, 0.98)
MANY_POINTS = 2000  # from here on it is faster to look for points inside of the hull first


@dataclass(frozen=True)
class InstanceGaussians:
    """Gaussians for a display or a planner; rows agree."""

    means: NDArray[np.float32]  # [n, 3] world, metres
    radius_m: NDArray[np.float32]  # [n] standard deviation
    opacity: NDArray[np.float32]  # [n]
    color: NDArray[np.uint8]  # [n, 3] RGB
    instance: NDArray[np.int32]  # [n] id, 0 for none
    class_names: tuple[str, ...]  # "other" first
    concentration: NDArray[np.float32]  # [n, classes] Dirichlet parameters


@dataclass(frozen=True)
class Belief:
    """What is believed of an instance."""

    rows: NDArray[np.integer]  # [n] in the store
    mean: NDArray[np.float64]  # [n] E[theta] of its own class, by all evidence
    trust: float  # share of the evidence for its own class that counts in what follows
    probabilities: dict[str, float]  # class -> mean over the Gaussians, "other" too
    score: Score  # for its own class


@dataclass(frozen=True)
class Shape:
    """Where the believed part of an instance is, world, metres."""

    low_m: NDArray[np.float64]  # [3]
    high_m: NDArray[np.float64]  # [3]
    top_m: float  # its highest point
    outline_m: NDArray[np.float64]  # [k, 2] convex hull


def believed(
    store: GaussianStore,
    rows: NDArray[np.integer],
    class_name: str,
    class_names: list[str],
    prior: float,
    n_classes: int,
    alpha_cs: float,
    trust: float = 1.0,
) -> Belief:
    """Belief in an instance of a class, which is one of class_names; n_classes: see `marginal`.

    trust: share of the evidence for the class that counts in the score; `mean` has all of it.
    """
    columns = np.array([store.class_names.index(name) for name in class_names], np.int64)
    own = class_names.index(class_name)
    means, deviations, mine = np.zeros(len(columns)), np.zeros(len(columns)), np.empty(len(rows))
    beliefs_kernel(
        rows, store.positive, store.asked, columns, own, prior, prior * n_classes, trust,
        means, deviations, mine,
    )  # fmt: skip
    mean, deviation = means / len(rows), deviations / len(rows)
    probabilities = dict(zip(class_names, mean.tolist(), strict=True))
    probabilities["other"] = max(0.0, 1.0 - float(mean.sum()))
    scored = weighed(float(mean[own]), float(deviation[own]), alpha_cs)
    return Belief(rows, mine, trust, probabilities, scored)


def sure_part(mean: NDArray[np.floating]) -> float:
    """Probability from which Gaussians are as good as the surest of their instance. mean: [n].

    Small things that stand together are joined where masks run over from one to the other, and the
    one that is meant is the one that is believed more.
    """
    return SURE * float(np.quantile(mean, SUREST))


def shape_of(points: NDArray[np.float32], belief: Belief, least: float = BELIEVED) -> Shape:
    """Of the Gaussians that are of the class with a probability above `least`, or of all where none
    is. points: [., 3] of the store."""
    xyz = np.empty((3, len(belief.rows)), np.float32)
    least = least if (belief.mean > least).any() else -1.0
    own = gather_kernel(belief.rows, points, belief.mean, least, xyz)
    low, high = quantiles(xyz[:, :own], BOX_QUANTILES)
    xy = np.empty((own, 2), np.float32)
    inside, top_m = inside_kernel(xyz, own, low, high, xy)
    if not inside:  # few points: the box may hold none of them
        everything = np.full(3, np.inf)
        inside, top_m = inside_kernel(xyz, own, -everything, everything, xy)
    return Shape(low, high, float(top_m), outline(xy[:inside]))


def describe(label: int, record: InstanceRecord, shape: Shape, belief: Belief) -> ObjectInstance:
    """Figures of an instance."""
    return ObjectInstance(
        id=label,
        class_name=record.class_name,
        center_m=(shape.low_m + shape.high_m) / 2,
        size_m=shape.high_m - shape.low_m,
        score=belief.score.psi,
        class_score=belief.score.class_score,
        uncertainty=belief.score.uncertainty,
        views=round(record.views),
        gaussians=len(belief.rows),
        probabilities=belief.probabilities,
        top_m=shape.top_m,
        outline_m=shape.outline_m,
        detection_rate=record.detection_rate,
    )


def quantiles(values: NDArray[np.float32], shares: Sequence[float]) -> NDArray[np.float64]:
    """Quantiles [shares, k] of each row of values [k, n], as `numpy.quantile` interpolates."""
    at = np.asarray(shares) * (values.shape[1] - 1)
    low = np.floor(at).astype(np.int64)
    high = np.ceil(at).astype(np.int64)
    out = np.empty((len(shares), len(values)))
    found = np.empty((2, len(shares)), np.float32)
    for k, row in enumerate(values):
        ranked_kernel(row, np.concatenate([low, high]), found.reshape(-1))
        out[:, k] = found[0] + (found[1].astype(np.float64) - found[0]) * (at - low)
    return out


def outline(xy: NDArray[np.float32]) -> NDArray[np.float64]:
    """Convex hull [k, 2] of points [n, 2]."""
    if len(xy) > MANY_POINTS:
        corners = np.empty_like(xy)
        xy = corners[: outer_kernel(xy, corners)]
    hull = cv2.convexHull(xy)
    return np.asarray(hull, np.float64).reshape(-1, 2)


def gaussians_of(
    store: GaussianStore, rows: NDArray[np.integer], prior: float, n_classes: int
) -> InstanceGaussians:
    """Copies of some Gaussians of the store. n_classes: see `concentration_of`."""
    asked = store.asked[rows]
    most_asked = asked.max(axis=1, initial=0)
    concentration = concentration_of(store.positive[rows], most_asked, prior, n_classes)
    return InstanceGaussians(
        store.means[rows],
        store.radius_m[rows],
        store.opacity[rows],
        store.color[rows],
        store.instance[rows],
        ("other", *store.class_names),
        concentration.astype(np.float32),
    )
