"""Which instances there are: labels of Gaussians, kept stable, and the views of each instance."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore
from helios_objectmap.instances import components, count_pairs, relabel


@dataclass
class InstanceRecord:
    """What is remembered of an instance besides its Gaussians."""

    class_name: str
    views: set[int] = field(default_factory=set)  # viewpoints that gave evidence
    detected: set[int] = field(default_factory=set)  # those that detected it as its class


class InstanceRegistry:
    """Labels never change their class and are never used again."""

    def __init__(self) -> None:
        self.records: dict[int, InstanceRecord] = {}
        self._next_label = NO_INSTANCE + 1

    def cluster(
        self, store: GaussianStore, columns: Iterable[int], voxel_m: Callable[[str], float]
    ) -> None:
        """Renew the partition of classes whose members changed."""
        for column in columns:
            if column != OTHER:
                self._cluster_class(store, column, voxel_m(store.class_names[column]))

    def _cluster_class(self, store: GaussianStore, column: int, voxel_m: float) -> None:
        name = store.class_names[column]
        rows = np.flatnonzero(store.believed == column)
        former = store.instance[rows]
        labels, self._next_label = relabel(
            components(store.means[rows], voxel_m), former, self._next_label
        )
        records: dict[int, InstanceRecord] = {}
        label_of_pair, former_of_pair, _ = count_pairs(labels, former)
        for label, ancestor in zip(label_of_pair.tolist(), former_of_pair.tolist(), strict=True):
            record = records.setdefault(label, InstanceRecord(name))
            if ancestor != NO_INSTANCE:
                record.views |= self.records[ancestor].views
                record.detected |= self.records[ancestor].detected
        kept = {k: r for k, r in self.records.items() if r.class_name != name}
        self.records = kept | records
        store.instance[rows] = labels

    def note_view(
        self,
        viewpoint: int,
        instance: NDArray[np.int32],
        kappa: NDArray[np.float32],
        class_names: list[str],
    ) -> None:
        """Count a viewpoint for the instances it gave evidence for.

        instance: [k] labels; kappa: [k, 1 + C] weights per label of the image, "other" first.
        An instance counts as seen with a weight of a pixel, and as detected with half of it.
        """
        labels, of_row = np.unique(instance, return_inverse=True)
        weight = np.stack(
            [np.bincount(of_row, kappa[:, c], len(labels)) for c in range(kappa.shape[1])], axis=1
        )
        for label, seen in zip(labels.tolist(), weight, strict=True):
            if label == NO_INSTANCE or seen.sum() < 1:
                continue
            record = self.records[label]
            record.views.add(viewpoint)
            if record.class_name in class_names:
                own = seen[1 + class_names.index(record.class_name)]
                if own >= 0.5 * seen.sum():
                    record.detected.add(viewpoint)
