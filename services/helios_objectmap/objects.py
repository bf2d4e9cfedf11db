"""What the map answers: instances with their figures, and their Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .gaussians import GaussianStore
from .registry import InstanceRecord
from .score import score

BELIEVED = 0.5  # Gaussians more likely than not of the class make up an instance's box
# A pixel on an edge that mixes two depths makes a stray Gaussian; a few must not move the box.
BOX_QUANTILES = (0.02, 0.98)


@dataclass(frozen=True)
class ObjectInstance:
    """One believed object. Positions in the world frame, metres."""

    id: int
    class_name: str
    center: NDArray[np.float64]  # [3] middle of the box of the believed Gaussians
    size: NDArray[np.float64]  # [3] extent of that box
    box: NDArray[np.float64]  # [2, 3] lowest and highest corner
    highest_point: NDArray[np.float64]  # [3] highest Gaussian in that box
    score: float  # Psi, eq. 7
    class_score: float  # S
    uncertainty: float  # U
    views: int  # distinct viewpoints that gave evidence
    detected_views: int  # those in which it was detected as its class
    gaussians: int
    probabilities: dict[str, float]  # mean probability of "other" and each class of the context


@dataclass(frozen=True)
class InstanceGaussians:
    """Gaussians for a display or a planner; rows agree."""

    means: NDArray[np.float32]  # [n, 3] world, metres
    radius_m: NDArray[np.float32]  # [n] standard deviation
    opacity: NDArray[np.float32]  # [n]
    color: NDArray[np.uint8]  # [n, 3] RGB
    instance: NDArray[np.int32]  # [n] id, 0 for none


def describe(
    label: int,
    record: InstanceRecord,
    means: NDArray[np.float32],
    mean: NDArray[np.float32],
    deviation: NDArray[np.float32],
    class_names: list[str],
    alpha_cs: float,
) -> ObjectInstance:
    """Figures of an instance. means: [n, 3]; mean, deviation: [n, C] of the classes named."""
    own = class_names.index(record.class_name)
    believed = mean[:, own] > BELIEVED
    points = means[believed if believed.any() else slice(None)].astype(np.float64)
    box = np.quantile(points, BOX_QUANTILES, axis=0)
    inside = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
    top = inside if len(inside) else points
    scored = score(mean[:, own], deviation[:, own], alpha_cs)
    probability = mean.mean(axis=0, dtype=np.float64)
    probabilities = {name: float(p) for name, p in zip(class_names, probability, strict=True)}
    probabilities["other"] = max(0.0, 1.0 - float(probability.sum()))
    return ObjectInstance(
        id=label,
        class_name=record.class_name,
        center=box.mean(axis=0),
        size=box[1] - box[0],
        box=box,
        highest_point=top[np.argmax(top[:, 2])],
        score=scored.psi,
        class_score=scored.class_score,
        uncertainty=scored.uncertainty,
        views=len(record.views),
        detected_views=len(record.detected),
        gaussians=len(means),
        probabilities=probabilities,
    )


def gaussians_of(store: GaussianStore, rows: NDArray[np.integer]) -> InstanceGaussians:
    """Copies of some Gaussians of the store."""
    return InstanceGaussians(
        store.means[rows],
        store.radius_m[rows],
        store.opacity[rows],
        store.color[rows],
        store.instance[rows],
    )
