"""Description of an instance: score, box, outline, grasp box, and its Gaussians."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.types import ObjectInstance
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.fusion.semantics import (
    Score,
    concentration_of,
    merged_into_other,
    score_from,
)
from helios_objectmap.gaussians import GaussianStore, InstanceGaussians
from helios_objectmap.instances.clustering import distinct, voxel_keys
from helios_objectmap.instances.registry import InstanceRecord

AREA_VOXEL_M = 0.25  # wider than the gaps between Gaussians of a surface seen from afar
BELIEVED = 0.5  # more likely than not
SURE, SUREST = 0.7, 0.95  # share of the probability at this quantile of the Gaussians
# Edge pixels that mix two depths make stray Gaussians; a few must not move the box.
BOX_QUANTILES = (0.02, 0.98)
MANY_POINTS = 2000  # above this it is faster to remove inner points before the hull
THIN_M = 0.005
_BINS = 2048


@dataclass(frozen=True)
class Belief:
    """Class probabilities and score of an instance."""

    rows: NDArray[np.integer]  # [n] in the store
    mean: NDArray[np.float64]  # [n] E[theta] of its own class, from all evidence
    trust: float  # share of the evidence for its own class that counts in the fields below
    probabilities: dict[str, float]  # class -> mean over the Gaussians, "other" too
    score: Score  # for its own class


@dataclass(frozen=True)
class Shape:
    """Extent of the Gaussians of an instance that have its class; world, metres."""

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

    trust: share of the evidence for the class that counts in the score; `mean` uses all of it.
    """
    columns = np.array([store.class_names.index(name) for name in class_names], np.int64)
    own = class_names.index(class_name)
    means, deviations, mine = np.zeros(len(columns)), np.zeros(len(columns)), np.empty(len(rows))
    beliefs_kernel(
        rows, store.class_evidence, store.total_evidence, columns, own, prior, prior * n_classes,
        trust, means, deviations, mine,
    )  # fmt: skip
    mean, deviation = means / len(rows), deviations / len(rows)
    probabilities = dict(zip(class_names, mean.tolist(), strict=True))
    probabilities["other"] = max(0.0, 1.0 - float(mean.sum()))
    scored = score_from(float(mean[own]), float(deviation[own]), alpha_cs)
    return Belief(rows, mine, trust, probabilities, scored)


def with_trust(
    belief: Belief,
    store: GaussianStore,
    class_name: str,
    prior: float,
    n_classes: int,
    alpha_cs: float,
    trust: float,
) -> Belief:
    """The belief that `believed` gives with another trust; class_name: its own class."""
    columns = np.array([store.class_names.index(class_name)], np.int64)
    rows, mean, deviation, mine = belief.rows, np.zeros(1), np.zeros(1), np.empty(len(belief.rows))
    beliefs_kernel(
        rows, store.class_evidence, store.total_evidence, columns, 0, prior, prior * n_classes,
        trust, mean, deviation, mine,
    )  # fmt: skip
    class_score, uncertainty = float(mean[0] / len(rows)), float(deviation[0] / len(rows))
    likely = {name: p for name, p in belief.probabilities.items() if name != "other"}
    likely[class_name] = class_score
    likely["other"] = max(0.0, 1.0 - float(np.array(list(likely.values())).sum()))
    return Belief(rows, mine, trust, likely, score_from(class_score, uncertainty, alpha_cs))


def sure_part(mean: NDArray[np.floating]) -> float:
    """Probability above which Gaussians count like the surest ones of their instance. mean: [n].

    Masks that overlap join small objects that stand together; the one with the higher probabilities
    is the object of that class.
    """
    return SURE * float(np.quantile(mean, SUREST))


def shape_of(points: NDArray[np.float32], belief: Belief, least: float = BELIEVED) -> Shape:
    """Shape of the Gaussians with a class probability above `least`, or of all if there is none.

    points: [., 3] of the store.
    """
    xyz = np.empty((3, len(belief.rows)), np.float32)
    least = least if (belief.mean > least).any() else -1.0
    own = gather_kernel(belief.rows, points, belief.mean, least, xyz)
    low, high = quantiles(xyz[:, :own], BOX_QUANTILES)
    xy = np.empty((own, 2), np.float32)
    inside, top_m = inside_kernel(xyz, own, low, high, xy)
    if not inside:  # with few points the box may contain none of them
        everything = np.full(3, np.inf)
        inside, top_m = inside_kernel(xyz, own, -everything, everything, xy)
    return Shape(low, high, float(top_m), outline(xy[:inside]))


def describe(label: int, record: InstanceRecord, shape: Shape, belief: Belief) -> ObjectInstance:
    """`ObjectInstance` from the record, shape and belief of an instance."""
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
    """Quantiles [shares, k] of each row of values [k, n], interpolated like `numpy.quantile`."""
    at = np.asarray(shares) * (values.shape[1] - 1)
    low = np.floor(at).astype(np.int64)
    high = np.ceil(at).astype(np.int64)
    out = np.empty((len(shares), len(values)))
    found = np.empty((2, len(shares)), np.float32)
    for k, row in enumerate(values):
        ranked_kernel(row, np.concatenate([low, high]), found.reshape(-1))
        out[:, k] = found[0] + (found[1].astype(np.float64) - found[0]) * (at - low)
    return out


def seen_area_m2(points: NDArray[np.float32]) -> float:
    """Surface of an instance seen so far. points: [n, 3] centres of its Gaussians.

    It is the number of voxels of 0.25 m that hold a Gaussian, times the face of a voxel. A surface
    fills the same voxels from near and from afar, where its Gaussians are fewer and larger. Within
    one voxel the size of a thing does not count.
    """
    filled, _ = distinct(voxel_keys(points, AREA_VOXEL_M))
    return len(filled) * AREA_VOXEL_M**2


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
    total_evidence = store.total_evidence[rows]
    most_evidence = total_evidence.max(axis=1, initial=0)
    concentration = merged_into_other(
        concentration_of(store.class_evidence[rows], most_evidence, prior, n_classes),
        len(store.class_names),
    )
    return InstanceGaussians(
        store.means[rows],
        store.radius_m[rows],
        store.opacity[rows],
        store.color[rows],
        store.instance[rows],
        ("other", *store.class_names),
        concentration.astype(np.float32),
    )


@dataclass(frozen=True)
class Grasp:
    """Points and grasp box of the Gaussians of an object that have its class."""

    points_m: NDArray[np.float32]  # [k, 3] world, one per cube of THIN_M
    center_m: NDArray[np.float64]  # [3] centre of the box
    size_m: NDArray[np.float64]  # [3] along the box's own axes; x is the narrow side
    yaw_rad: float  # direction of the box's x axis, in which a gripper closes


def grasp(points_m: NDArray[np.float32]) -> Grasp:
    """Grasp from points_m: [n, 3] world, n at least 1. The box is the smallest upright one."""
    cells = np.floor(points_m.astype(np.float64) / THIN_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept = points_m[np.sort(first)]
    (x, y), (width, depth), angle_deg = cv2.minAreaRect(np.ascontiguousarray(kept[:, :2]))
    yaw = np.radians(angle_deg)
    if width > depth:
        width, depth, yaw = depth, width, yaw + np.pi / 2
    low, high = float(kept[:, 2].min()), float(kept[:, 2].max())
    return Grasp(
        kept,
        np.array([x, y, (low + high) / 2]),
        np.array([width, depth, high - low]),
        float((yaw + np.pi / 2) % np.pi - np.pi / 2),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def beliefs_kernel(
    rows, positive, total_evidence, columns, own, prior, prior_total, trust, means, deviations, mine
):
    """Sum the mean and standard deviation of theta (eq. 4) over rows [n].

    Writes the sums for the columns [C] into means and deviations [C], and the mean of column
    columns[own] into mine [n]. For that column, the sums count the share `trust` of the evidence,
    and `mine` counts all.
    """
    for k in range(rows.size):
        for j in range(columns.size):
            row, column = rows[k], columns[j]
            total = total_evidence[row, column] + prior_total
            mean = (positive[row, column] + prior) / total
            if j == own:
                mine[k] = mean
                mean = (trust * positive[row, column] + prior) / total
            means[j] += mean
            deviations[j] += math.sqrt(max(mean * (1 - mean), 0.0) / (1 + total))


@njit(cache=True, nogil=True)
def gather_kernel(rows, points, mine, least, xyz):
    """Copy the points [., 3] of rows [n] with mine [n] above `least` into xyz [3, n], axis by axis.

    Returns the number of points.
    """
    n = 0
    for k in range(rows.size):
        if mine[k] > least:
            for axis in range(3):
                xyz[axis, n] = points[rows[k], axis]
            n += 1
    return n


@njit(cache=True, nogil=True)
def inside_kernel(xyz, points, low, high, xy):
    """Copy x and y of the first `points` of xyz [3, .] that lie within low and high [3] into xy.

    xy: [points, 2]. Returns the number of points copied, and their largest z.
    """
    n, top = 0, -np.inf
    for i in range(points):
        x, y, z = xyz[0, i], xyz[1, i], xyz[2, i]
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            xy[n, 0] = x
            xy[n, 1] = y
            n += 1
            top = max(top, np.float64(z))
    return n, top


@njit(cache=True, nogil=True)
def outer_kernel(xy, outer):
    """Copy to outer [n, 2] the points of xy [n, 2] that may be corners of the convex hull.

    Skips the points well inside of the octagon of the extreme points. Returns the number copied.
    """
    corner = np.zeros(8, np.int64)  # counter-clockwise: largest x, x + y, y, y - x, ...
    reach = np.full(8, -np.inf)
    along = np.empty(8)
    for i in range(xy.shape[0]):
        x, y = np.float64(xy[i, 0]), np.float64(xy[i, 1])
        along[0], along[1], along[2], along[3] = x, x + y, y, y - x
        for d in range(4):
            along[4 + d] = -along[d]
        for d in range(8):
            if along[d] > reach[d]:
                reach[d], corner[d] = along[d], i
    n = 0
    for i in range(xy.shape[0]):
        inside, some = True, False
        for d in range(8):
            a, b = corner[d], corner[(d + 1) % 8]
            edge_x, edge_y = np.float64(xy[b, 0]) - xy[a, 0], np.float64(xy[b, 1]) - xy[a, 1]
            if edge_x != 0 or edge_y != 0:
                some = True
                to_x, to_y = np.float64(xy[i, 0]) - xy[a, 0], np.float64(xy[i, 1]) - xy[a, 1]
                if edge_x * to_y - edge_y * to_x <= 1e-9:
                    inside = False
                    break
        if not (inside and some):
            outer[n] = xy[i]
            n += 1
    return n


@njit(cache=True, nogil=True)
def ranked_kernel(values, ranks, out):
    """Write the values [n] at some ranks of the sorted order to out.

    Counts the values into bins, and sorts only the bins of the ranks.
    """
    low, high = values[0], values[0]
    for i in range(values.size):
        low, high = min(low, values[i]), max(high, values[i])
    scale = np.float64(_BINS) / max(np.float64(high) - np.float64(low), 1e-30)
    bins = np.empty(values.size, np.int16)
    counts = np.zeros(_BINS, np.int64)
    for i in range(values.size):
        bins[i] = min(np.int64((np.float64(values[i]) - low) * scale), _BINS - 1)
        counts[bins[i]] += 1
    known, sorted_bin, before = -1, values[:0].copy(), 0
    for r in range(ranks.size):
        wanted, b, below = ranks[r], 0, 0
        while below + counts[b] <= wanted:
            below += counts[b]
            b += 1
        if b != known:
            known, before = b, below
            sorted_bin = np.empty(counts[b], values.dtype)
            n = 0
            for i in range(values.size):
                if bins[i] == b:
                    sorted_bin[n] = values[i]
                    n += 1
            sorted_bin.sort()
        out[r] = sorted_bin[wanted - before]
