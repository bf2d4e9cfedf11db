"""Which instances there are: labels of Gaussians, kept stable, and what is known of each instance.

After an update only what it touched is clustered: the Gaussians whose class changed, the instances
that lost some, and those with a voxel next to one that gained some. Any other instance is as far
from the rest as it was, so the partition equals that of clustering everything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore
from helios_objectmap.instances import components, count_pairs, distinct, relabel, touching

MOST_HISTORY = 256


@dataclass(frozen=True)
class Moment:
    """What was believed of an instance after an update that gave it evidence."""

    stamp_ns: int  # the robot's clock
    views: float
    score: float  # Psi, eq. 7
    class_score: float


@dataclass
class InstanceRecord:
    """What is remembered of an instance besides its Gaussians."""

    class_name: str
    views: float = 0.0  # sum of the weights of the views that gave evidence
    detected: float = 0.0  # of those that detected it as its class
    history: list[Moment] = field(default_factory=list)

    def note(self, moment: Moment) -> None:
        """Append to the history; a full one loses every second moment."""
        self.history.append(moment)
        if len(self.history) > MOST_HISTORY:
            self.history = self.history[::2]

    def inherit(self, ancestor: InstanceRecord) -> None:
        """Parts of one thing were seen in the same views: the part seen most often speaks."""
        if ancestor.views > self.views:
            self.views, self.detected = ancestor.views, ancestor.detected
            self.history = list(ancestor.history)


class InstanceRegistry:
    """Labels never change their class and are never used again."""

    def __init__(self) -> None:
        self.records: dict[int, InstanceRecord] = {}
        self.next_label = NO_INSTANCE + 1

    def cluster(
        self,
        store: GaussianStore,
        rows: NDArray[np.integer],
        labels: Iterable[int],
        voxel_m: Callable[[str], float],
    ) -> set[int]:
        """Renew the partition after a change; returns the labels of all instances that it touched.

        rows: those that are newly believed to be what they are; they have no label. labels: of
        instances that lost Gaussians.
        """
        lost: dict[str, set[int]] = {}
        for label in labels:
            if label != NO_INSTANCE:
                lost.setdefault(self.records[label].class_name, set()).add(label)
        believed = store.believed[rows]
        gained = {store.class_names[c]: c for c in np.unique(believed[believed != OTHER]).tolist()}
        touched: set[int] = set()
        for name in sorted(lost.keys() | gained.keys()):
            own = rows[believed == gained[name]] if name in gained else rows[:0]
            touched |= self._cluster_class(store, name, own, lost.get(name, set()), voxel_m(name))
        return touched

    def _cluster_class(
        self,
        store: GaussianStore,
        name: str,
        own: NDArray[np.integer],
        lost: set[int],
        voxel_m: float,
    ) -> set[int]:
        near = store.blocks.near(store.means[own], 2 * voxel_m)
        near = near[store.instance[near] != NO_INSTANCE]
        if len(near):
            near = near[store.believed[near] == store.class_names.index(name)]
            near = near[touching(store.means[near], store.means[own], voxel_m)]
        old = lost | set(np.unique(store.instance[near]).tolist())
        rows = np.concatenate([store.instances.rows_of(np.array(sorted(old), np.int64)), own])
        former = store.instance[rows]
        labels, self.next_label = relabel(
            components(store.means[rows], voxel_m), former, self.next_label
        )
        fresh: dict[int, InstanceRecord] = {}
        for label, ancestor in sorted(zip(*count_pairs(labels, former)[:2], strict=True)):
            record = fresh.setdefault(int(label), InstanceRecord(name))
            if ancestor != NO_INSTANCE:
                record.inherit(self.records[int(ancestor)])
        for label in old:
            del self.records[label]
        self.records |= fresh
        store.instances.move(rows, labels)
        return old | fresh.keys()

    def note_view(
        self,
        instance: NDArray[np.int32],
        kappa: NDArray[np.float32],
        weights: NDArray[np.float32],
        class_names: list[str],
    ) -> None:
        """Count a view for the instances it gave evidence for.

        instance: [k] labels; kappa: [k, 1 + C] per label of the image, "other" first; weights:
        [k, C] of the view. An instance counts as seen with kappa of a pixel, and as detected with
        half of what was seen of it.
        """
        labels, of_row = distinct(instance)
        seen = np.stack(
            [np.bincount(of_row, kappa[:, c], len(labels)) for c in range(kappa.shape[1])], axis=1
        )
        everything = kappa.sum(axis=1)
        for k, label in enumerate(labels.tolist()):
            record = self.records.get(label)
            if record is None or record.class_name not in class_names or seen[k].sum() < 1:
                continue
            own = class_names.index(record.class_name)
            mine = of_row == k
            weight = float(np.average(weights[mine, own], weights=everything[mine]))
            record.views += weight
            if seen[k, 1 + own] >= 0.5 * seen[k].sum():
                record.detected += weight
