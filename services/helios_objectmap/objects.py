"""What the map answers: instances with their figures, and their Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.types import ObjectInstance
from numpy.typing import NDArray

from helios_objectmap.dirichlet import concentration_of
from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.registry import InstanceRecord
from helios_objectmap.score import score

BELIEVED = 0.5  # Gaussians more likely than not of the class make up an instance's box
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


def describe(
    label: int,
    record: InstanceRecord,
    means: NDArray[np.float32],
    mean: NDArray[np.floating],
    deviation: NDArray[np.floating],
    class_names: list[str],
    alpha_cs: float,
) -> ObjectInstance:
    """Figures of an instance. means: [n, 3]; mean, deviation: [n, C] of the classes named."""
    own = class_names.index(record.class_name)
    believed = mean[:, own] > BELIEVED
    chosen = means[believed] if believed.any() else means
    xyz = np.ascontiguousarray(chosen.T, np.float64)  # axis by axis is faster
    box = np.quantile(xyz, BOX_QUANTILES, axis=1)
    inside = ((xyz >= box[0][:, None]) & (xyz <= box[1][:, None])).all(axis=0)
    solid = xyz[:, inside].T if inside.any() else xyz.T
    scored = score(mean[:, own], deviation[:, own], alpha_cs)
    probability = mean.mean(axis=0, dtype=np.float64)
    probabilities = {name: float(p) for name, p in zip(class_names, probability, strict=True)}
    probabilities["other"] = max(0.0, 1.0 - float(probability.sum()))
    return ObjectInstance(
        id=label,
        class_name=record.class_name,
        center_m=box.mean(axis=0),
        size_m=box[1] - box[0],
        score=scored.psi,
        class_score=scored.class_score,
        uncertainty=scored.uncertainty,
        views=round(record.views),
        gaussians=len(means),
        probabilities=probabilities,
        top_m=float(solid[:, 2].max()),
        outline_m=outline(solid),
        detection_rate=record.detected / record.views if record.views else 0.0,
    )


def outline(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convex hull [k, 2] of the ground projection of points [n, 3]."""
    xy = np.ascontiguousarray(points[:, :2], np.float32)
    if len(xy) > MANY_POINTS:
        xy = xy[~_inside_of_extremes(xy)]
    hull = cv2.convexHull(xy)
    return np.asarray(hull, np.float64).reshape(-1, 2)


def _inside_of_extremes(xy: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Points [n, 2] well inside of the octagon of the extreme ones: no corner of the hull."""
    x, y = np.ascontiguousarray(xy.T, np.float64)
    towards = (x, x + y, y, y - x)  # counter-clockwise
    corner = np.array([np.argmax(d) for d in towards] + [np.argmin(d) for d in towards])
    edge = xy[np.roll(corner, -1)].astype(np.float64) - xy[corner]
    inside = np.ones(len(xy), bool)
    for i, (along_x, along_y) in zip(corner, edge, strict=True):
        if along_x or along_y:
            inside &= along_x * (y - y[i]) - along_y * (x - x[i]) > 1e-9
    return inside & bool(edge.any())  # all in one place: nothing is inside


def gaussians_of(
    store: GaussianStore, rows: NDArray[np.integer], prior: float
) -> InstanceGaussians:
    """Copies of some Gaussians of the store."""
    asked = store.asked[rows]
    most_asked = asked.max(axis=1, initial=0)
    concentration = concentration_of(store.positive[rows], most_asked, prior)
    return InstanceGaussians(
        store.means[rows],
        store.radius_m[rows],
        store.opacity[rows],
        store.color[rows],
        store.instance[rows],
        ("other", *store.class_names),
        concentration.astype(np.float32),
    )
