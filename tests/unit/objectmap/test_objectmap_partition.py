"""Clustering only what an update touched equals clustering everything."""

from __future__ import annotations

import numpy as np
import pytest
from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore
from helios_objectmap.instances.clustering import components
from helios_objectmap.instances.registry import Group, InstanceRegistry
from hypothesis import given, settings
from hypothesis import strategies as st

VOXEL_M = {"mug": 0.07, "table": 0.5, "shelf": 0.9}
CLASSES = list(VOXEL_M)


def parts(rows, labels):
    return {frozenset(rows[labels == c].tolist()) for c in np.unique(labels)}


class Scene:
    """A store whose Gaussians change class, come and go at random."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.store, self.registry = GaussianStore(), InstanceRegistry()
        for name in CLASSES:
            self.store.column(name)

    def change(self) -> None:
        """Add some, change the class of some, remove some; then update the instances."""
        rng, store = self.rng, self.store
        n = int(rng.integers(1, 60))
        middle = rng.uniform(-1.5, 1.5, 3)
        means = (middle + rng.normal(0, 0.15, (n, 3))).astype(np.float32)
        store.append(means, np.full(n, 0.01, np.float32), 0.9, np.zeros((n, 3), np.uint8), 0)
        gone = np.flatnonzero(rng.random(len(store)) < rng.choice([0.1, 0.6]))  # a few, or many
        self.registry.leave(store, gone, VOXEL_M.__getitem__)
        store.class_column[gone] = OTHER
        new = store.class_column.copy()
        flips = rng.random(len(store)) < 0.2
        flips[gone] = False
        new[flips] = rng.integers(OTHER, len(CLASSES), flips.sum())
        changed = np.flatnonzero(new != store.class_column)
        self.registry.leave(store, changed, VOXEL_M.__getitem__)
        store.class_column[changed] = new[changed]
        self.registry.join(store, changed, VOXEL_M.__getitem__)
        store.remove(gone)

    def check(self) -> None:
        store = self.store
        for column, name in enumerate(CLASSES):
            rows = np.flatnonzero(store.class_column == column)
            everything = components(store.means[rows], VOXEL_M[name])
            assert (store.instance[rows] != NO_INSTANCE).all()
            assert parts(rows, store.instance[rows]) == parts(rows, everything)
        assert (store.instance[store.class_column == OTHER] == NO_INSTANCE).all()
        present = set(np.unique(store.instance).tolist()) - {NO_INSTANCE}
        assert present == set(self.registry.records)
        for label in present:
            column = store.class_column[store.instances.rows_of(np.array([label]))[0]]
            assert self.registry.records[label].class_name == CLASSES[column]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_the_partition_equals_clustering_everything_after_any_changes(seed, changes):
    scene = Scene(seed)
    for _ in range(changes):
        scene.change()
        scene.check()


def grown(means, order, voxel_m):
    """The partition of points that are added in some order, a few at a time."""
    store, registry = GaussianStore(), InstanceRegistry()
    store.column("mug")
    for rows in np.array_split(order, 5):
        n = len(rows)
        new = store.append(
            means[rows], np.full(n, 0.01, np.float32), 0.9, np.zeros((n, 3), np.uint8), 0
        )
        store.class_column[new] = 0
        registry.join(store, np.arange(new.start, new.stop), lambda _: voxel_m)
    labels = np.empty(len(means), np.int64)
    labels[order] = store.instance
    return parts(np.arange(len(means)), labels)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.07, 0.5]))
def test_the_partition_does_not_depend_on_the_order_of_updates(seed, voxel_m):
    rng = np.random.default_rng(seed)
    means = rng.uniform(-1, 1, (120, 3)).astype(np.float32) * np.float32(voxel_m / 0.1)
    assert grown(means, np.arange(120), voxel_m) == grown(means, rng.permutation(120), voxel_m)


def test_an_instance_far_from_a_change_keeps_its_label_and_is_not_touched():
    store, registry = GaussianStore(), InstanceRegistry()
    store.column("mug")
    for x in (0.0, 2.0, 0.05):
        at = np.full((3, 3), x, np.float32)
        new = store.append(at, np.full(3, 0.01, np.float32), 0.9, np.zeros((3, 3), np.uint8), 0)
        store.class_column[new] = 0
        rows = np.arange(new.start, new.stop)
        touched = registry.join(store, rows, lambda _: 0.07)
    assert store.instance.tolist() == [1, 1, 1, 2, 2, 2, 1, 1, 1]
    assert touched == {1}


@pytest.mark.parametrize("views", [(3.0, 8.0), (8.0, 3.0)])
def test_a_merged_instance_has_the_views_of_the_part_seen_most_often(views):
    store, registry = GaussianStore(), InstanceRegistry()
    store.column("mug")
    for x, seen in ((0.0, views[0]), (0.2, views[1]), (0.1, None)):
        at = np.full((2, 3), x, np.float32)
        new = store.append(at, np.full(2, 0.01, np.float32), 0.9, np.zeros((2, 3), np.uint8), 0)
        store.class_column[new] = 0
        registry.join(store, np.arange(new.start, new.stop), lambda _: 0.07)
        if seen is not None:
            registry.records[int(store.instance[new][0])].views = seen
    assert {k: r.views for k, r in registry.records.items()} == {1: 8.0}


def row_of_mugs(places) -> tuple[GaussianStore, InstanceRegistry]:
    """Two Gaussians of a mug at each place along x, in voxels of 7 cm."""
    store, registry = GaussianStore(), InstanceRegistry()
    store.column("mug")
    means = np.repeat(np.array([[x, 0.01, 0.01] for x in places], np.float32), 2, axis=0)
    n = len(means)
    store.append(means, np.full(n, 0.01, np.float32), 0.9, np.zeros((n, 3), np.uint8), 0)
    store.class_column[:] = 0
    registry.join(store, np.arange(n), VOXEL_M.__getitem__)
    return store, registry


def test_an_instance_splits_when_its_middle_empties_and_the_larger_part_keeps_the_label():
    store, registry = row_of_mugs([0.01, 0.08, 0.15, 0.22])
    assert set(store.instance.tolist()) == {1}
    for rows in ([2], [3]):  # the second voxel: first half of it, then all
        registry.leave(store, np.array(rows), VOXEL_M.__getitem__)
        store.class_column[rows] = OTHER
        touched = registry.join(store, np.empty(0, np.int64), VOXEL_M.__getitem__)
    assert store.instance.tolist() == [2, 2, 0, 0, 1, 1, 1, 1]
    assert touched == {1, 2}
    assert registry.records.keys() == {1, 2}


def test_an_instance_that_loses_all_its_gaussians_is_removed():
    store, registry = row_of_mugs([0.01, 0.5])
    registry.leave(store, np.array([0, 1]), VOXEL_M.__getitem__)
    store.class_column[:2] = OTHER
    assert registry.join(store, np.empty(0, np.int64), VOXEL_M.__getitem__) == {1}
    assert registry.records.keys() == {2}


def test_larger_voxels_join_instances_and_smaller_ones_split_them_again():
    store, registry = row_of_mugs([0.01, 0.35])
    registry.recluster(store, Group("mug", True), 0.5)
    assert store.instance.tolist() == [1, 1, 1, 1]
    registry.recluster(store, Group("mug", True), 0.07)
    assert store.instance.tolist() == [1, 1, 3, 3]
    assert registry.records.keys() == {1, 3}
