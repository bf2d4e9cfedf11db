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
    points = means[believed if believed.any() else slice(None)].astype(np.float64)
    box = np.quantile(points, BOX_QUANTILES, axis=0)
    inside = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
    solid = inside if len(inside) else points
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
    hull = cv2.convexHull(np.ascontiguousarray(points[:, :2], np.float32))
    return np.asarray(hull, np.float64).reshape(-1, 2)


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
