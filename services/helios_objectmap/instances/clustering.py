"""Instances: 26-connected voxels of Gaussians of one class (appendix, instance creation).

The paper's 20 rounds of min-pooling bound the size of an object; a union-find gives the same
partition without a bound. Gaussians closer than a voxel are always joined, and Gaussians farther
apart than two voxels along an axis never. Two mugs with centres 0.3 m apart have a gap of 0.15 to
0.2 m between them, so they stay two with voxels of 7 cm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.gaussians import NO_INSTANCE

BITS = 21  # bits per axis in a voxel key
PRECEDING = np.array(
    [
        (dx << (2 * BITS)) + (dy << BITS) + dz
        for dx in (-1, 0, 1)
        for dy in (-1, 0, 1)
        for dz in (-1, 0, 1)
        if (dx, dy, dz) < (0, 0, 0)
    ],
    np.int64,
)
# Steps to the 26 neighbours of a voxel: 13 come before it in the order of keys, 13 after.
PLACE = {step: k for k, step in enumerate(PRECEDING.tolist())}
STEPS = np.concatenate([PRECEDING, -PRECEDING])
NEIGHBOURS: tuple[int, ...] = tuple(STEPS.tolist())
# Up to this many emptied voxels are checked singly; beyond, whole instances are clustered again.
FEW = 32


def voxel_keys(points: NDArray[np.float32], voxel_m: float) -> NDArray[np.int64]:
    """Voxel key of each point [n, 3], one integer. The map reaches 2^20 voxels from the origin."""
    keys = np.empty(len(points), np.int64)
    voxel_keys_kernel(points, voxel_m, BITS, keys)
    return keys


def voxel_centers_m(keys: NDArray[np.integer], voxel_m: float) -> NDArray[np.float64]:
    """Middle of each voxel [n, 3], world, metres; the inverse of `voxel_keys`."""
    parts = [(keys >> (BITS * k)) & ((1 << BITS) - 1) for k in (2, 1, 0)]
    steps = np.stack(parts, -1).astype(np.float64) - (1 << (BITS - 1))
    return (steps + 0.5) * voxel_m


class Separations(Protocol):
    """Neighbouring voxels that belong to different things although they touch."""

    def apart(self, keys: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Which of its 13 neighbours `PRECEDING` each voxel [n] is apart from: [n, 13]."""
        ...


def connected(
    voxels: NDArray[np.integer], separations: Separations | None = None
) -> NDArray[np.int64]:
    """Number of the connected component of each voxel [n], 0, 1, ... without gaps.

    voxels: distinct keys in rising order. Components are numbered by their first voxel.
    """
    parent = np.empty(len(voxels), np.int64)
    apart = np.zeros((0, 0), np.bool_) if separations is None else separations.apart(voxels)
    components_kernel(voxels, PRECEDING, apart, parent)
    return np.unique(parent, return_inverse=True)[1]


def components(
    points: NDArray[np.float32], voxel_m: float, separations: Separations | None = None
) -> NDArray[np.int64]:
    """Number of the connected component of each point [n], 0, 1, ... without gaps."""
    voxels, of_point = distinct(voxel_keys(points, voxel_m))
    return connected(voxels, separations)[of_point]


def relabel(
    component: NDArray[np.int64],
    former: NDArray[np.int32],
    count: NDArray[np.int64],
    next_label: int,
) -> tuple[NDArray[np.int32], int]:
    """Stable labels [n] for components, and the next free label.

    Each of the n entries is a point or a voxel. former: [n] former label, NO_INSTANCE for none;
    count: [n] number of its points with that label. The component with the largest part of a former
    instance inherits its label, the smallest if it inherits several. So a merge keeps the smaller
    label, and in a split the largest part keeps it. Other components get new labels.
    """
    n_components = int(component.max(initial=-1)) + 1
    label_of = np.zeros(n_components, np.int32)
    known = former != NO_INSTANCE
    pair, of_pair = distinct((former[known].astype(np.int64) << 32) | component[known])
    labels, parts = pair >> 32, pair & 0xFFFFFFFF
    counts = np.bincount(of_pair, count[known], len(pair))
    # Largest part first; between equal parts the component with the smaller number.
    by_size = np.lexsort((parts, -counts, labels))
    heirs: set[int] = set()
    for label, part in zip(labels[by_size].tolist(), parts[by_size].tolist(), strict=True):
        if label not in heirs:
            heirs.add(label)
            if label_of[part] == 0:  # labels are in rising order: the first is the smallest
                label_of[part] = label
    for part in np.flatnonzero(label_of == 0):
        label_of[part] = next_label
        next_label += 1
    return label_of[component], next_label


def distinct(values: NDArray[np.integer]) -> tuple[NDArray[np.integer], NDArray[np.intp]]:
    """Distinct values [n] in rising order, and the index of each value among them.

    Like `numpy.unique`, but it sorts only the starts of runs of equal values: neighbours in the
    store are neighbours in space.
    """
    starts = np.flatnonzero(np.diff(values, prepend=values[:1] - 1))
    found, of_run = np.unique(values[starts], return_inverse=True)
    return found, np.repeat(of_run, np.diff(starts, append=len(values)))


@dataclass(frozen=True)
class Regrouped:
    """Changes of the partition after an update."""

    labels: set[int] = field(default_factory=set)  # all instances that changed
    regrouped: set[int] = field(default_factory=set)  # former labels of those whose voxels changed
    ancestors: dict[int, set[int]] = field(default_factory=dict)  # new label -> former labels
    moved: set[int] = field(default_factory=set)  # former labels of members that got another one


class Voxels:
    """Voxels of one class: the number of Gaussians in each, and its instance."""

    def __init__(self, voxel_m: float, separations: Separations | None = None) -> None:
        self.voxel_m, self._separations = voxel_m, separations
        self._count: dict[int, int] = {}  # voxel key -> its Gaussians; no empty voxels
        self._label: dict[int, int] = {}
        self._of: dict[int, set[int]] = {}  # label -> its voxels
        self._loose: set[int] = set()  # labels of instances that may have split, or are empty

    def fill(self, points: NDArray[np.float32], labels: NDArray[np.int32]) -> None:
        """Add the first Gaussians [n], of known instances; no two instances share a voxel."""
        keys, of_point = distinct(voxel_keys(points, self.voxel_m))
        label_of = np.empty(len(keys), np.int64)
        label_of[of_point] = labels
        counts = np.bincount(of_point, minlength=len(keys))
        for key, n, label in zip(keys.tolist(), counts.tolist(), label_of.tolist(), strict=True):
            self._count[key] = n
            self._give(key, label)

    def leave(self, points: NDArray[np.float32]) -> None:
        """Remove Gaussians [n]; `join` updates the partition."""
        keys, of_point = distinct(voxel_keys(points, self.voxel_m))
        emptied = 0
        for key, n in zip(keys.tolist(), np.bincount(of_point).tolist(), strict=True):
            self._count[key] -= n
            if self._count[key]:
                continue
            del self._count[key]
            label = self._label.pop(key)
            self._of[label].discard(key)
            emptied += 1
            checked = self._separations is None and emptied <= FEW
            if label not in self._loose and not (checked and not self._may_split_at(key)):
                self._loose.add(label)

    @property
    def is_loose(self) -> bool:
        """True if an instance may have split or merged since the last `join`."""
        return bool(self._loose)

    def loosen(self, keys: NDArray[np.integer]) -> None:
        """Cluster the instances of these voxels again at the next `join`."""
        labels = (self._label.get(key) for key in keys.tolist())
        self._loose.update(label for label in labels if label is not None)

    def join(self, points: NDArray[np.float32], next_label: int) -> tuple[Regrouped, int]:
        """Add Gaussians [n]. Returns the changes, and the next free label."""
        keys, of_point = distinct(voxel_keys(points, self.voxel_m))
        counts = dict(zip(keys.tolist(), np.bincount(of_point).tolist(), strict=True))
        fresh = [key for key in counts if key not in self._count]
        touched = {self._label[key] for key in counts.keys() - set(fresh)}
        change = Regrouped(touched)
        if fresh or self._loose:
            next_label = self._regroup(fresh, change, next_label)
        for key, n in counts.items():
            self._count[key] = self._count.get(key, 0) + n
        return change, next_label

    def labels_of(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """Instance of each point [n]; each must be in an occupied voxel."""
        keys, of_point = distinct(voxel_keys(points, self.voxel_m))
        return np.array([self._label[key] for key in keys.tolist()], np.int32)[of_point]

    def touches(self, label: int, other: Voxels) -> bool:
        """True if an instance shares a voxel with an instance of `other`, or lies beside one."""
        mine, theirs = self._of[label], other._count
        return any(k in theirs for k in mine) or any(
            k + step in theirs for k in mine for step in NEIGHBOURS
        )

    # Parts ----------------------------------------------------------------------------------------

    def _may_split_at(self, key: int) -> bool:
        """True if an emptied voxel may have connected its instance, or was all of it."""
        rest = {key + step for step in NEIGHBOURS if key + step in self._count}
        if not rest:
            return True
        reached = [rest.pop()]
        while reached:
            at = reached.pop()
            beside = {at + step for step in NEIGHBOURS} & rest
            rest -= beside
            reached.extend(beside)
        return bool(rest)

    def _regroup(self, fresh: list[int], change: Regrouped, next_label: int) -> int:
        """Cluster new voxels, those of loose instances, and whole instances that touch new ones."""
        loose, self._loose = self._loose, set()
        keys = np.array(sorted(fresh + [k for label in loose for k in self._of[label]]), np.int64)
        part = connected(keys, self._separations).tolist()
        part_of = dict(zip(keys.tolist(), part, strict=True))
        beside: dict[int, list[int]] = {}  # label of a whole instance -> parts that touch it
        for key, other in self._touching(fresh):
            label = self._label[other]
            if label not in loose:
                beside.setdefault(label, []).append(part_of[key])
        of_part = _joined(max(part, default=-1) + 1, list(beside.values()))
        # Parts in the order of their first voxels, as a clustering of all voxels numbers them.
        first: dict[int, int] = {}
        for key, k in part_of.items():
            first[of_part[k]] = min(key, first.get(of_part[k], key))
        for label, parts in beside.items():
            k = of_part[parts[0]]
            first[k] = min(min(self._of[label]), first[k])
        number = {k: i for i, k in enumerate(sorted(first, key=first.__getitem__))}
        former = [self._label.get(key, NO_INSTANCE) for key in part_of] + list(beside)
        counts = [self._count.get(key, 0) for key in part_of] + [1] * len(beside)
        component = [number[of_part[k]] for k in part]
        component += [number[of_part[parts[0]]] for parts in beside.values()]
        labels, next_label = relabel(
            np.array(component, np.int64),
            np.array(former, np.int32),
            np.array(counts, np.int64),
            next_label,
        )
        self._take(list(part_of), list(beside), loose, former, labels.tolist(), change)
        return next_label

    def _touching(self, fresh: list[int]) -> Iterator[tuple[int, int]]:
        """Pairs of a new voxel and an old one beside it that is not kept apart from it."""
        pairs = [
            (key, key + step) for key in fresh for step in NEIGHBOURS if key + step in self._label
        ]
        if self._separations is None or not pairs:
            yield from pairs
            return
        later = np.array([max(pair) for pair in pairs], np.int64)
        apart = self._separations.apart(later)
        for pair, row in zip(pairs, apart, strict=True):
            if not row[PLACE[min(pair) - max(pair)]]:
                yield pair

    def _take(
        self,
        keys: list[int],
        beside: list[int],
        loose: set[int],
        former: list[int],
        labels: list[int],
        change: Regrouped,
    ) -> None:
        """Assign the new labels to the voxels `keys`, then to the whole instances `beside`."""
        change.labels.update(loose, beside, labels)
        change.regrouped.update(loose, beside)
        for was, label in zip(former, labels, strict=True):
            ancestors = change.ancestors.setdefault(label, set())
            if was != NO_INSTANCE:
                ancestors.add(was)
                if was != label:
                    change.moved.add(was)
        given_up = {label: self._of.pop(label, set()) for label in loose | change.moved}
        for key, label in zip(keys, labels, strict=False):
            self._give(key, label)
        for was, label in zip(beside, labels[len(keys) :], strict=True):
            for key in given_up.get(was, ()):
                self._give(key, label)

    def _give(self, key: int, label: int) -> None:
        self._label[key] = label
        self._of.setdefault(label, set()).add(key)


def _joined(n: int, groups: list[list[int]]) -> list[int]:
    """Representative of each of n parts after joining; groups: parts to join."""
    stands = list(range(n))

    def standing(k: int) -> int:
        while stands[k] != k:
            stands[k] = stands[stands[k]]
            k = stands[k]
        return k

    for group in groups:
        for k in group[1:]:
            stands[standing(k)] = standing(group[0])
    return [standing(k) for k in range(n)]


@njit(cache=True, nogil=True)
def components_kernel(keys, deltas, apart, parent):
    """26-connected components of sorted voxel keys; fills parent [n] with their first voxels.

    apart: [n, 13] neighbours that are not connected, or [0, 0] for none.
    """
    n = keys.size
    for i in range(n):
        parent[i] = i
        root = i
        for d in range(deltas.size):
            j = np.searchsorted(keys, keys[i] + deltas[d])
            if j < n and keys[j] == keys[i] + deltas[d] and not (apart.size and apart[i, d]):
                other = j
                while parent[other] != other:
                    parent[other] = parent[parent[other]]
                    other = parent[other]
                if other < root:
                    parent[root] = other
                    root = other
                elif other > root:
                    parent[other] = root
    for i in range(n):
        a = i
        while parent[a] != a:
            a = parent[a]
        parent[i] = a


@njit(cache=True, nogil=True)
def voxel_keys_kernel(points, voxel_m, bits, keys):
    """Fill keys [n] with the voxel of each point [n, 3]: x, y, z in `bits` bits each."""
    half = np.int64(1) << (bits - 1)
    for i in range(points.shape[0]):
        key = np.int64(0)
        for axis in range(3):
            step = np.int64(np.floor(np.float64(points[i, axis]) / voxel_m)) + half
            key = (key << bits) | step
        keys[i] = key
