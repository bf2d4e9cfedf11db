"""Image-text scores as independent evidence of what an instance is (not in the paper).

The paper uses the scores of whole images for the value maps alone. A detector that takes a
washstand for a sofa does so in many views, but the scorer's errors do not depend on the detector's.
So views that show an instance should score higher for its class than the other views of the search.
With the mean and the standard deviation of all scores of the class, z is the standard score of an
image, and of a viewing sector

    z = mean over its views, weighted by the share of the image that shows the instance
    w = min(1, sum of these shares / FULL_SHARE)

If views of the class score r deviations higher, and errors are normal, the sectors have a
log-likelihood ratio of

    L = sum of w (z r - r^2 / 2) / (1 + SIDES_CORRELATE (sum of w - 1))

for the class against any other. It is added to the log odds of a score: logit(S') = logit(S) + L.

The rise r is learned from the instances of the class, by expectation maximisation from
r = USUAL_RISE on: with their scores Psi' for the last r, the next one is

    r = (USUAL_WEIGHT USUAL_RISE + sum of Psi' w z) / (USUAL_WEIGHT + sum of Psi' w)

and at least 0. If the scores of the class do not agree with the detector, r falls and L becomes
small.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix, yaw_of
from helios_core.printable_text import counted
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.camera import offset
from helios_objectmap.fusion.label_image import LabelImage
from helios_objectmap.fusion.semantics import Score
from helios_objectmap.fusion.viewing_sectors import SECTORS
from helios_objectmap.instances.clustering import BITS, voxel_keys
from helios_objectmap.instances.voxel_entries import check_within, moved_keys
from helios_objectmap.instances.voxel_numbers import NO_VOXEL, VoxelNumbers

log = logging.getLogger(__name__)

VOXEL_M = 0.2
WIDTH_PX = 80  # largest width of the image from which voxels are filled
FULL_SHARE = 0.1  # of an image, summed over the views of a sector
USUAL_RISE, USUAL_WEIGHT = 1.5, 0.5  # standard deviations; sectors of a sure instance
SHOWN_RISE = 2.0  # the same of a thing that the robot holds before the camera
ROUNDS = 3  # of expectation maximisation
SIDES_CORRELATE = 0.1
FEW_VIEWS = 20.0  # views of the search at which L counts in half
LEAST_DEVIATION = 0.01  # of scores in 0 to 1; with less, L is 0
MOST_NATS = 6.0  # largest L, both ways
# Voxels times classes: 400 MB in use. Arrays grow by doubling, so twice that may be reserved; the
# operating system gives memory only to the part in use.
MOST_SUMS = 2**22
_LEAST = 1e-4  # score in the odds; also 1 minus the largest one


@dataclass
class _Distribution:
    """Scores of one class over all views."""

    views: int = 0
    mean: float = 0.0
    squares: float = 0.0  # sum of squared differences from the mean

    def add(self, score: float) -> None:
        self.views += 1
        before = score - self.mean
        self.mean += before / self.views
        self.squares += before * (score - self.mean)

    def add_views(self, views: int, mean: float, squares: float) -> None:
        """Add several scores by their number, mean and sum of squared differences from it."""
        total, apart = self.views + views, mean - self.mean
        self.squares += squares + apart**2 * self.views * views / max(total, 1)
        self.mean += apart * views / max(total, 1)
        self.views = total

    @property
    def deviation(self) -> float:
        return math.sqrt(self.squares / max(self.views, 1))


@dataclass(frozen=True)
class SectorScores:
    """Views that show an instance, by viewing sector."""

    share: NDArray[np.float64]  # [SECTORS] of the image, summed over the views
    score: NDArray[np.float64]  # [SECTORS] sum of share times score


class ImageTextScores:
    """Scores of the views of each class, spread over the voxels that they show."""

    def __init__(self) -> None:
        self._voxels = VoxelNumbers()
        self._sums: dict[str, NDArray[np.float32]] = {}  # class -> [voxels, SECTORS, 2]
        self._scores: dict[str, _Distribution] = {}
        self._told_full = False

    def note(self, reading: LabelImage, scores: Mapping[str, float]) -> None:
        """Add a view. scores: class -> image-text score, 0 to 1. A view that would exceed
        `MOST_SUMS` is left out; the log tells the first one."""
        if not scores:
            return
        coarse = max(1, -(-reading.view.width // WIDTH_PX))
        depth_m = reading.depth_m[offset(coarse) :: coarse, offset(coarse) :: coarse]
        measured = depth_m > 0
        points = reading.view.strided(coarse).lift(depth_m, measured)
        keys = voxel_keys(points, VOXEL_M)
        if not self._has_room(len(keys), scores) and not self._has_room(
            len(np.unique(keys[self._voxels.known(keys) == NO_VOXEL])), scores
        ):
            self._tell_full()
            return
        voxels = self._voxels.of_keys(keys)
        for name, score in scores.items():
            self._scores.setdefault(name, _Distribution()).add(score)
            sums = self._of_class(name)
            add_kernel(
                points, voxels, reading.view.T_world_cam[:2, 3], 1 / depth_m.size, score, sums
            )

    def rates(self, class_name: str) -> bool:
        """True if a view has a score of the class."""
        return class_name in self._scores

    def forget_at(self, points: NDArray[np.float32]) -> None:
        """Drop what was seen in the voxels of points [n, 3], where a thing was taken away."""
        voxels = np.unique(self._voxels.known(voxel_keys(points, VOXEL_M)))
        for sums in self._sums.values():
            sums[voxels[(voxels != NO_VOXEL) & (voxels < len(sums))]] = 0

    def forget(self, names: Iterable[str]) -> None:
        """Drop the scores of some classes."""
        for name in names:
            self._sums.pop(name, None)
            self._scores.pop(name, None)

    def arrays(self) -> dict[str, NDArray]:
        """Copies of all scores. A cell is a voxel, a viewing sector and a class with a score."""
        names = [name for name in self._scores if name in self._sums]
        cells = [np.flatnonzero(self._sums[name].view(np.uint64)) for name in names]
        rows = [self._sums[name].reshape(-1, 2)[c] for name, c in zip(names, cells, strict=True)]
        cell = np.concatenate([np.empty(0, np.intp), *cells])
        found = [self._scores[name] for name in names]
        return {
            "names": np.array(names, np.str_),
            "scores": np.array([(s.views, s.mean, s.squares) for s in found]).reshape(-1, 3),
            "keys": self._voxels.keys.copy(),
            "voxel": (cell // SECTORS).astype(np.int32),
            "sector": (cell % SECTORS).astype(np.int8),
            "class": np.repeat(np.arange(len(names), dtype=np.int16), [len(r) for r in rows]),
            "sums": np.concatenate([np.empty((0, 2), np.float32), *rows]),
        }

    def add_arrays(self, arrays: Mapping[str, NDArray], T_here_there: Matrix | None = None) -> None:
        """Add scores that `arrays` returned. T_here_there: their place in this frame, kept to the
        nearest viewing sector; None: the same frame. Raises ValueError for inconsistent arrays."""
        names = [str(name) for name in arrays["names"]]
        scores = arrays["scores"].astype(np.float64).reshape(len(names), 3)
        sums = arrays["sums"].astype(np.float32).reshape(-1, 2)
        voxel, sector, of_class = (arrays[k].astype(np.intp) for k in ("voxel", "sector", "class"))
        if any(a.shape != sums.shape[:1] for a in (voxel, sector, of_class)):
            raise ValueError("cells of image-text scores have columns of different lengths")
        if not (np.isfinite(sums).all() and np.isfinite(scores).all()) or scores.min(initial=1) < 0:
            raise ValueError("an image-text score is no number from 0 on")
        keys = moved_keys(arrays["keys"], VOXEL_M, T_here_there)
        for index, n in ((voxel, len(keys)), (sector, SECTORS), (of_class, len(names))):
            check_within(index, n)
        used, voxel = np.unique(voxel, return_inverse=True)
        if not self._has_room(len(used), names):
            raise ValueError(f"image-text scores of {len(used)} voxels and {len(names)} classes")
        numbers = self._voxels.of_keys(keys[used])
        turned = 0 if T_here_there is None else round(yaw_of(T_here_there) * SECTORS / math.tau)
        for k, name in enumerate(names):
            views, mean, squares = scores[k].tolist()
            self._scores.setdefault(name, _Distribution()).add_views(int(views), mean, squares)
            own = of_class == k
            at = numbers[voxel[own]], (sector[own] + turned) % SECTORS
            np.add.at(self._of_class(name), at, sums[own])

    def add_stored(self, arrays: Mapping[str, NDArray], T_here_there: Matrix) -> None:
        """Add the scores of another map as `add_arrays` does, or none if they would exceed
        `MOST_SUMS`."""
        if self._has_room(len(np.unique(arrays["voxel"])), arrays["names"].tolist()):
            self.add_arrays(arrays, T_here_there)
        else:
            log.warning("image-text scores of a stored map are left out: both maps are too large")

    def _tell_full(self) -> None:
        """Log the first view that is left out."""
        if not self._told_full:
            self._told_full = True
            log.warning(
                "image-text scores fill %s of %s: views that show more of the home, or are scored "
                "for more classes, add none from now on; to begin anew, run `helios map reset`",
                counted(len(self._voxels), "voxel"),
                counted(len(self._scores), "class", "classes"),
            )

    def _has_room(self, new_voxels: int, names: Iterable[str]) -> bool:
        classes = self._scores.keys() | set(names)
        return (len(self._voxels) + new_voxels) * len(classes) <= MOST_SUMS

    def of(
        self, points: NDArray[np.float32], rows: NDArray[np.integer], class_name: str
    ) -> SectorScores | None:
        """Views that show the instance with the rows [n] of points [., 3]; None without one."""
        sums = self._sums.get(class_name)
        if sums is None:
            return None
        keys, extent_m = np.empty(len(rows), np.int64), np.zeros(3)
        keys_and_extent_kernel(points, rows, VOXEL_M, BITS, keys, extent_m)
        total, marked = np.zeros((SECTORS, 2)), np.zeros(len(sums), np.bool_)
        n_voxels = sum_kernel(self._voxels.known(keys), sums, marked, total)
        # The voxels of a small thing show more than the thing: half of its box faces a camera.
        x_m, y_m, z_m = extent_m.tolist()
        facing_m2 = x_m * y_m + y_m * z_m + z_m * x_m
        own = min(1.0, facing_m2 / (max(n_voxels, 1) * VOXEL_M**2))
        share, score = own * total.T
        return SectorScores(share, score) if share.any() else None

    def rise(self, class_name: str, things: Iterable[tuple[float, SectorScores]]) -> float:
        """Rise r of the class. things: Psi of each of its instances, and the views that show it."""
        known = [(psi, *self._standard(seen, class_name)) for psi, seen in things]
        rise = USUAL_RISE
        for _ in range(ROUNDS if known else 0):
            weight, total = USUAL_WEIGHT, USUAL_WEIGHT * USUAL_RISE
            for psi, sides, z in known:
                now = in_odds(psi, self._nats(sides, z, class_name, rise))
                weight += now * sides
                total += now * z
            rise = max(total / weight, 0.0)
        return rise

    def log_likelihood_ratio(self, seen: SectorScores, class_name: str, rise: float) -> float:
        """L (nats) of the class for an instance that these views show; 0 if all views of the search
        score alike."""
        return self._nats(*self._standard(seen, class_name), class_name, rise)

    def shown_log_likelihood_ratio(self, class_name: str, scores: Sequence[float]) -> float | None:
        """L (nats) of the class for a thing before the camera, from the scores of these images;
        None if the scorer does not rate the class. All images together count as one sector."""
        if not scores or not self.rates(class_name):
            return None
        all_scores = self._scores[class_name]
        if all_scores.deviation < LEAST_DEVIATION:
            return 0.0
        z = (float(np.mean(scores)) - all_scores.mean) / all_scores.deviation
        return self._nats(1.0, z, class_name, SHOWN_RISE)

    def _nats(self, sides: float, z: float, class_name: str, rise: float) -> float:
        """L for the sum of w and the sum of w z."""
        nats = (z * rise - sides * rise**2 / 2) / (1 + SIDES_CORRELATE * max(sides - 1, 0))
        views = self._scores[class_name].views
        return min(max(nats * views / (views + FEW_VIEWS), -MOST_NATS), MOST_NATS)

    def _standard(self, seen: SectorScores, class_name: str) -> tuple[float, float]:
        """Sum of w, and sum of w z, over the sectors."""
        all_scores = self._scores[class_name]
        if all_scores.deviation < LEAST_DEVIATION:
            return 0.0, 0.0
        shown = seen.share > 0
        weight = np.minimum(seen.share[shown] / FULL_SHARE, 1)
        mean = seen.score[shown] / seen.share[shown]
        z = (mean - all_scores.mean) / all_scores.deviation
        return float(weight.sum()), float(weight @ z)

    def _of_class(self, name: str) -> NDArray[np.float32]:
        """Sums of a class, with room for every voxel."""
        sums, n = self._sums.get(name), len(self._voxels)
        if sums is None or len(sums) < n:
            grown = np.zeros((max(2 * n, 1024), SECTORS, 2), np.float32)
            if sums is not None:
                grown[: len(sums)] = sums
            self._sums[name] = sums = grown
        return sums


def with_evidence(score: Score, nats: float) -> Score:
    """Score after a log-likelihood ratio; the uncertainty becomes S' - Psi'."""
    if nats == 0:
        return score
    class_score, psi = in_odds(score.class_score, nats), in_odds(score.psi, nats)
    return Score(class_score, class_score - psi, psi)


def in_odds(probability: float, nats: float) -> float:
    """Probability whose log odds are larger by `nats`."""
    p = min(max(probability, _LEAST), 1 - _LEAST)
    return 1 / (1 + (1 - p) / p * math.exp(-nats))


@njit(cache=True, nogil=True)
def add_kernel(points, voxels, eye_xy, share, score, sums):
    """Add a view to sums [., SECTORS, 2]. points: [n, 3] world; voxels: [n] their numbers; eye_xy:
    [2] camera; share: of one point in the image."""
    sectors = sums.shape[1]
    for k in range(voxels.size):
        angle = math.atan2(eye_xy[1] - points[k, 1], eye_xy[0] - points[k, 0])
        side = math.floor(angle * sectors / math.tau) % sectors
        sums[voxels[k], side, 0] += share
        sums[voxels[k], side, 1] += share * score


@njit(cache=True, nogil=True)
def keys_and_extent_kernel(points, rows, voxel_m, bits, keys, extent_m):
    """Fill keys [n] with the voxels of the rows [n] of points [., 3], like
    `clustering.voxel_keys_kernel`, and extent_m [3] with the size of their box."""
    half = np.int64(1) << (bits - 1)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(rows.size):
        key = np.int64(0)
        for axis in range(3):
            at = np.float64(points[rows[k], axis])
            low[axis], high[axis] = min(low[axis], at), max(high[axis], at)
            key = (key << bits) | (np.int64(np.floor(at / voxel_m)) + half)
        keys[k] = key
    if rows.size:
        for axis in range(3):
            extent_m[axis] = high[axis] - low[axis]


@njit(cache=True, nogil=True)
def sum_kernel(voxels, sums, marked, total):
    """Add sums [v, SECTORS, 2] of the numbered voxels [n], each once, to total [SECTORS, 2].

    Numbers without a sum are left out. marked: [v] False. Returns the number of voxels.
    """
    n = 0
    for k in range(voxels.size):
        at = voxels[k]
        if at < 0 or at >= marked.size or marked[at]:
            continue
        marked[at] = True
        n += 1
        for side in range(total.shape[0]):
            total[side, 0] += sums[at, side, 0]
            total[side, 1] += sums[at, side, 1]
    return n
