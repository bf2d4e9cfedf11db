"""Registry of instances: stable labels of Gaussians, and a record of each instance.

An update clusters only the voxels that it filled or emptied, with those beside them. Distances
between the other voxels do not change, so the partition equals that of clustering everything.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from helios_core.types import Detection
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.fusion.label_image import LabelImage
from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore
from helios_objectmap.instances.clustering import (
    Regrouped,
    Voxels,
    components,
    distinct,
    relabel,
    voxel_keys,
)
from helios_objectmap.instances.co_detections import CoDetections
from helios_objectmap.instances.detector_precision import (
    N_BANDS,
    FormerDetections,
    bands,
    mean_share,
    true_share,
)

MOST_HISTORY = 256

Rows = NDArray[np.integer]
VoxelSize = Callable[[str], float]  # class name -> voxel size, metres


class Group(NamedTuple):
    """Gaussians that are clustered together: those of one class, its core and the rest apart."""

    class_name: str
    in_core: bool


@dataclass(frozen=True)
class Moment:
    """Scores of an instance after an update that gave it evidence."""

    stamp_ns: int  # the robot's clock
    views: float
    score: float  # Psi, eq. 7
    class_score: float


@dataclass
class InstanceRecord:
    """Data of an instance besides its Gaussians."""

    class_name: str
    views: float = 0.0  # sum of the weights of the views that gave evidence
    detected: float = 0.0  # the same sum, over views that detected its class
    detected_at: NDArray[np.float64] = field(default_factory=lambda: np.zeros(N_BANDS))  # per band
    history: list[Moment] = field(default_factory=list)
    in_core: bool = True  # False if the evidence of all its Gaussians is faint

    @property
    def group(self) -> Group:
        return Group(self.class_name, self.in_core)

    def note(self, moment: Moment) -> None:
        """Append to the history; a full one loses every second moment."""
        self.history.append(moment)
        if len(self.history) > MOST_HISTORY:
            self.history = self.history[::2]

    @property
    def detection_rate(self) -> float:
        """Share of its views that detected it as its class."""
        return self.detected / self.views if self.views else 0.0

    def inherit(self, ancestor: InstanceRecord) -> None:
        """Take over the views of an ancestor that has more of them.

        Parts of one object are seen in the same views, so the part with the most views counts.
        """
        if ancestor.views > self.views:
            self.views, self.detected = ancestor.views, ancestor.detected
            self.detected_at = ancestor.detected_at.copy()
            self.history = list(ancestor.history)


@dataclass
class _Crossed:
    """Gaussians that change between the core and the rest of their class."""

    former: dict[Group, Rows] = field(default_factory=dict)  # former label of each joining row
    records: dict[int, InstanceRecord] = field(default_factory=dict)  # by former label


class InstanceRegistry:
    """Instances by label. Labels never change their class and are never reused.

    A Gaussian that changes its class, or is removed, first leaves its instance. After all changes
    have left, the Gaussians with a class join, and the partition is complete again.
    """

    def __init__(self) -> None:
        self.records: dict[int, InstanceRecord] = {}
        self.next_label = NO_INSTANCE + 1
        self.ended: dict[str, FormerDetections] = {}  # class -> detections of its former instances
        self._voxels: dict[Group, Voxels] = {}  # only groups that have changed
        self.separations: dict[str, CoDetections] = {}  # class -> neighbours that are kept apart
        self._left: dict[Group, set[int]] = {}  # instances that lost Gaussians since `join`
        self._came_from: list[tuple[Rows, Rows]] = []  # rows that left since `join`, their labels

    def leave(self, store: GaussianStore, rows: NDArray[np.integer], voxel_m: VoxelSize) -> None:
        """Remove rows from their instances; their positions and classes must be the old ones."""
        rows = rows[store.instance[rows] != NO_INSTANCE]
        for group, own in _by_group(store, rows):
            voxels = self._voxels_of(store, group, voxel_m(group.class_name))
            labels = store.instance[own]
            self._left.setdefault(group, set()).update(distinct(labels)[0].tolist())
            self._came_from.append((own, labels))
            voxels.leave(store.means[own])
            store.instances.move(own, NO_INSTANCE)

    def join(
        self,
        store: GaussianStore,
        rows: NDArray[np.integer],
        voxel_m: VoxelSize,
        *,
        taken_out: bool = False,
    ) -> set[int]:
        """Update the partition. Returns the labels of all instances that changed.

        rows: rows without an instance whose class is new. taken_out: instances that end were taken
        out of the map, and not seen to be false.
        """
        left, self._left = self._left, {}
        joining = dict(_by_group(store, rows))
        crossed = self._crossed(joining)
        changed: set[int] = set().union(*left.values())
        loose = {group for group, voxels in self._voxels.items() if voxels.is_loose}
        for group in sorted(left.keys() | joining.keys() | loose):
            own = joining.get(group, rows[:0])
            voxels = self._voxels_of(store, group, voxel_m(group.class_name))
            regrouped, self.next_label = voxels.join(store.means[own], self.next_label)
            for label in regrouped.moved:
                members = store.instances.rows_of(np.array([label]))
                store.instances.move(members, voxels.labels_of(store.means[members]))
            labels = voxels.labels_of(store.means[own])
            store.instances.move(own, labels)
            self._renew_records(group, regrouped, taken_out, crossed.records)
            if group in crossed.former:
                self._inherit_across(labels, crossed.former[group], regrouped, crossed.records)
            changed |= regrouped.labels
        return changed

    def recluster(self, store: GaussianStore, group: Group, voxel_m: float) -> None:
        """Cluster all Gaussians of a group, whose voxels are unknown or changed their size."""
        old = {label for label, record in self.records.items() if record.group == group}
        rows = store.instances.rows_of(np.array(sorted(old), np.int64))
        former = store.instance[rows]
        separations = self._separations_of(group.class_name, voxel_m)
        labels, self.next_label = relabel(
            components(store.means[rows], voxel_m, separations),
            former,
            np.ones(len(rows), np.int64),
            self.next_label,
        )
        if not np.array_equal(labels, former):
            ancestors: dict[int, set[int]] = {}
            for pair in distinct((labels.astype(np.int64) << 32) | former)[0].tolist():
                ancestors.setdefault(pair >> 32, set()).add(pair & 0xFFFFFFFF)
            self._renew_records(group, Regrouped(regrouped=old, ancestors=ancestors), False)
            store.instances.move(rows, labels)
        self._voxels[group] = Voxels(voxel_m, separations)
        self._voxels[group].fill(store.means[rows], labels)

    def note_co_detections(
        self, reading: LabelImage, stride: int, detections: Iterable[Detection], voxel_m: VoxelSize
    ) -> None:
        """Note which neighbouring voxels the detections of each class show together. stride: that
        of the reading, in pixels of the masks."""
        by_class: dict[str, list[Detection]] = {}
        for d in detections:
            by_class.setdefault(d.class_name, []).append(d)
        for name, own in by_class.items():
            changed = self.co_detections(name, voxel_m(name)).note(reading, stride, own)
            self.cluster_again(name, changed)

    def co_detections(self, class_name: str, voxel_m: float) -> CoDetections:
        """Co-detections of a class; the voxels where they change belong to `cluster_again`."""
        known = self._separations_of(class_name, voxel_m)
        if known is None:
            known = self.separations[class_name] = CoDetections(voxel_m)
            self._voxels = {g: v for g, v in self._voxels.items() if g.class_name != class_name}
        return known

    def cluster_again(self, class_name: str, keys: NDArray[np.integer]) -> None:
        """Cluster the instances of a class that have these voxels [n] again at the next `join`."""
        for in_core in (True, False):
            voxels = self._voxels.get(Group(class_name, in_core))
            if voxels is not None:
                voxels.loosen(keys)

    def keep_apart(self, store: GaussianStore, class_name: str, voxel_m: float) -> None:
        """Keep the instances of a class that touch apart, whatever detections will show."""
        separations = self.separations[class_name] = CoDetections(voxel_m)
        for in_core in (True, False):
            group = Group(class_name, in_core)
            mine = [label for label, record in self.records.items() if record.group == group]
            rows = store.instances.rows_of(np.array(sorted(mine), np.int64))
            keys, first = np.unique(voxel_keys(store.means[rows], voxel_m), return_index=True)
            separations.keep_apart(keys, store.instance[rows[first]])

    def _separations_of(self, class_name: str, voxel_m: float) -> CoDetections | None:
        """Separations with voxels of that size; others are out of date."""
        known = self.separations.get(class_name)
        return known if known is not None and known.voxel_m == voxel_m else None

    def inherit_from(
        self, labels: NDArray[np.int32], there: NDArray[np.int32], other: InstanceRegistry
    ) -> None:
        """Give instances the views of the instances of another registry that they came from.

        labels, there: [n] labels of the same Gaussians here and there; NO_INSTANCE for none.
        """
        both = (labels != NO_INSTANCE) & (there != NO_INSTANCE)
        for here, label in sorted(
            set(zip(labels[both].tolist(), there[both].tolist(), strict=True))
        ):
            if here in self.records and label in other.records:
                self.records[here].inherit(other.records[label])
        for name, ended in other.ended.items():
            self.ended.setdefault(name, ended)

    def is_beside_core(self, label: int) -> bool:
        """True for an instance with faint evidence that touches the core of one of its class."""
        record = self.records[label]
        if record.in_core:
            return False
        faint, core = (self._voxels.get(Group(record.class_name, c)) for c in (False, True))
        return faint is not None and core is not None and faint.touches(label, core)

    def _voxels_of(self, store: GaussianStore, group: Group, voxel_m: float) -> Voxels:
        known = self._voxels.get(group)
        if known is None or known.voxel_m != voxel_m:
            self.recluster(store, group, voxel_m)
        return self._voxels[group]

    def _crossed(self, joining: Mapping[Group, Rows]) -> _Crossed:
        """Rows that join the other part of their class than the one that they left."""
        came_from, self._came_from = self._came_from, []
        out = _Crossed()
        if not came_from or all(group.in_core for group in (*joining, *self._voxels)):
            return out
        rows = np.concatenate([rows for rows, _ in came_from])
        order = np.argsort(rows)
        rows, labels = rows[order], np.concatenate([labels for _, labels in came_from])[order]
        for group, own in joining.items():
            at = np.minimum(np.searchsorted(rows, own), len(rows) - 1)
            former = np.where(rows[at] == own, labels[at], NO_INSTANCE)
            other = Group(group.class_name, not group.in_core)
            for label in distinct(np.sort(former))[0].tolist():
                record = self.records.get(label)
                if record is not None and record.group == other:
                    out.records[label] = record
                else:
                    former[former == label] = NO_INSTANCE
            out.former[group] = former
        return out

    def _inherit_across(
        self,
        labels: Rows,
        former: Rows,
        regrouped: Regrouped,
        records: Mapping[int, InstanceRecord],
    ) -> None:
        """Give new instances the views of the instances of the other part that they came from."""
        for label in distinct(np.sort(labels))[0].tolist():
            if regrouped.ancestors.get(label) == set():
                for ancestor in distinct(np.sort(former[labels == label]))[0].tolist():
                    if ancestor != NO_INSTANCE:
                        self.records[label].inherit(records[ancestor])

    def _renew_records(
        self, group: Group, regrouped: Regrouped, taken_out: bool, crossed: Container[int] = ()
    ) -> None:
        """Replace the records of instances that changed.

        An instance without a successor has ended, and its detections are added to `ended`. crossed:
        instances that have not ended although they have no successor in this group. Some of their
        Gaussians join the other part of the class: its core, or the rest.
        """
        fresh: dict[int, InstanceRecord] = {}
        for label, ancestors in regrouped.ancestors.items():
            record = fresh[label] = InstanceRecord(group.class_name, in_core=group.in_core)
            for ancestor in sorted(ancestors):
                record.inherit(self.records[ancestor])
        lives_on = set().union(*regrouped.ancestors.values())
        for label in regrouped.regrouped:
            record = self.records.pop(label)
            if label not in lives_on and label not in crossed:
                ended = self.ended.setdefault(group.class_name, FormerDetections())
                ended.add(record.detected_at, record.detection_rate * taken_out)
        self.records |= fresh

    def note_view(
        self,
        instance: NDArray[np.int32],
        took: NDArray[np.integer],
        kappa: NDArray[np.float32],
        weights: NDArray[np.float32],
        depth_m: NDArray[np.float32],
        class_names: list[str],
    ) -> list[int]:
        """Count a view for the instances it gave evidence for. Returns their labels.

        instance: [t] labels of the Gaussians that received evidence; took: [t] their indices into
        the others; kappa: [k, 1 + C] per label of the image, "other" first; weights: [k, C] of the
        view; depth_m: [k]. An instance counts as seen from a kappa sum of one pixel, and
        as detected if half of that kappa has its class.
        """
        labels, of_row = distinct(instance)
        seen = np.zeros((len(labels), kappa.shape[1]))
        weighed = np.zeros((len(labels), weights.shape[1]))
        far_m = np.zeros(len(labels))
        views_kernel(of_row, took, kappa, weights, depth_m, seen, weighed, far_m)
        given = [label for label in labels.tolist() if label != NO_INSTANCE]
        for k, label in enumerate(labels.tolist()):
            record = self.records.get(label)
            if record is None or record.class_name not in class_names or seen[k].sum() < 1:
                continue
            own = class_names.index(record.class_name)
            weight = float(weighed[k, own] / seen[k].sum())
            record.views += weight
            if seen[k, 1 + own] >= 0.5 * seen[k].sum():
                record.detected += weight
                record.detected_at[bands(far_m[k : k + 1] / seen[k].sum())] += weight
        return given

    def true_detection_share(self, label: int, by_distance: bool) -> float:
        """Estimated share of true detections of an instance."""
        record = self.records[label]
        things = (
            (r.detected_at, r.detection_rate)
            for r in self.records.values()
            if r.class_name == record.class_name
        )
        share = true_share(
            things, self.ended.get(record.class_name, FormerDetections()), by_distance
        )
        return mean_share(share, record.detected_at)


def _by_group(
    store: GaussianStore, rows: NDArray[np.integer]
) -> list[tuple[Group, NDArray[np.integer]]]:
    """Rows by most likely class and core; rows without a class are left out."""
    believed, in_core = store.class_column[rows], store.in_core[rows]
    out = []
    for column in distinct(believed)[0].tolist():
        if column == OTHER:
            continue
        for core in (True, False):
            own = rows[(believed == column) & (in_core == core)]
            if len(own):
                out.append((Group(store.class_names[column], core), own))
    return out


@njit(cache=True, nogil=True)
def views_kernel(of_row, took, kappa, weights, depth_m, seen, weighed, far_m):
    """Sum over the rows `took` [t] of each label; of_row: [t] index of the label.

    Adds kappa [k, 1 + C] to seen [labels, 1 + C]; weights [k, C] and depth_m [k], both times the
    sum of kappa, to weighed [labels, C] and far_m [labels].
    """
    for t in range(of_row.size):
        k, label, total = took[t], of_row[t], 0.0
        for c in range(kappa.shape[1]):
            seen[label, c] += kappa[k, c]
            total += kappa[k, c]
        for j in range(weights.shape[1]):
            weighed[label, j] += weights[k, j] * total
        far_m[label] += depth_m[k] * total
