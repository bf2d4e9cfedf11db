"""Instances: the partition against a plain reference, and stable labels."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helios_objectmap.instances.clustering import components, relabel
from helios_objectmap.settings import ObjectMapSettings
from hypothesis import given, settings
from hypothesis import strategies as st


def reference_components(points, voxel_m):
    """Sets of points whose float64 voxels are joined by 26-neighbours; quadratic and plain."""
    voxels = [tuple(np.floor(p.astype(np.float64) / voxel_m).astype(int)) for p in points]
    group = list(range(len(points)))
    for i, j in itertools.combinations(range(len(points)), 2):
        if max(abs(a - b) for a, b in zip(voxels[i], voxels[j], strict=True)) <= 1:
            group = [group[j] if g == group[i] else g for g in group]
    return {frozenset(k for k, g in enumerate(group) if g == label) for label in set(group)}


def parts(labels):
    return {frozenset(np.flatnonzero(labels == c).tolist()) for c in np.unique(labels)}


POINTS = st.builds(
    lambda n, seed, spread: (
        np.random.default_rng(seed).uniform(-spread, spread, (n, 3)).astype(np.float32)
    ),
    st.integers(1, 40),
    st.integers(0, 2**32 - 1),
    st.floats(0.1, 1.5),
)


@settings(max_examples=40, deadline=None)
@given(POINTS, st.floats(0.05, 0.5))
def test_partition_equals_the_components_of_26_connected_voxels(points, voxel_m):
    assert parts(components(points, voxel_m)) == reference_components(points, voxel_m)


@settings(max_examples=20, deadline=None)
@given(POINTS, st.integers(0, 2**32 - 1))
def test_partition_does_not_depend_on_the_order_of_gaussians(points, seed):
    shuffled = np.random.default_rng(seed).permutation(len(points))
    got = np.empty(len(points), np.int64)
    got[shuffled] = components(points[shuffled], 0.2)
    assert parts(got) == parts(components(points, 0.2))


def mug_surface(center, seed=0):
    """300 points of a cylinder 9 cm wide and 10 cm high."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, 300)
    height = rng.uniform(-0.05, 0.05, 300)
    around = np.stack([0.045 * np.cos(angle), 0.045 * np.sin(angle), height], axis=1)
    return (np.asarray(center) + around).astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 2 * np.pi))
def test_two_mugs_0_3_m_apart_are_two_objects_at_any_grid_offset_and_direction(x, y, angle):
    voxel_m = ObjectMapSettings().object_voxel_m
    other = (x + 0.3 * np.cos(angle), y + 0.3 * np.sin(angle), 0.8)
    both = np.concatenate([mug_surface((x, y, 0.8)), mug_surface(other, 1)])
    assert len(np.unique(components(both, voxel_m))) == 2


def test_a_table_seen_in_pieces_is_one_instance():
    x = np.concatenate([np.arange(0, 0.5, 0.02), np.arange(0.9, 1.6, 0.02)])
    table = np.stack([x, np.zeros_like(x), np.full_like(x, 0.7)], axis=1).astype(np.float32)
    assert len(np.unique(components(table, ObjectMapSettings().receptacle_voxel_m))) == 1


def label(component, former, next_label=10):
    one = np.ones(len(component), np.int64)
    return relabel(np.array(component), np.array(former, np.int32), one, next_label)


def test_new_components_get_new_labels():
    labels, next_label = label([0, 0, 1], [0, 0, 0])
    assert labels.tolist() == [10, 10, 11]
    assert next_label == 12


def test_a_merge_keeps_the_smaller_label():
    assert label([0, 0, 0], [7, 7, 3])[0].tolist() == [3, 3, 3]


def test_in_a_split_the_larger_part_keeps_the_label():
    labels, next_label = label([0, 1, 1], [5, 5, 5])
    assert labels.tolist() == [10, 5, 5]
    assert next_label == 11


def test_the_larger_part_is_the_one_with_more_points_not_with_more_voxels():
    voxels = np.array([0, 1, 1]), np.array([5, 5, 5], np.int32), np.array([9, 2, 3])
    assert relabel(*voxels, 10)[0].tolist() == [5, 10, 10]


def test_a_part_that_inherits_nothing_gets_a_new_label():
    # Instance 3 lies mostly in component 0, which also holds all of 2: component 1 is new.
    assert label([0, 0, 0, 1], [2, 3, 3, 3])[0].tolist() == [2, 2, 2, 10]


@pytest.mark.parametrize("seed", range(5))
def test_relabelling_an_unchanged_partition_changes_nothing(seed):
    component = np.random.default_rng(seed).integers(0, 4, 30)
    component = np.unique(component, return_inverse=True)[1]
    one = np.ones(30, np.int64)
    first, next_label = relabel(component, np.zeros(30, np.int32), one, 1)
    again, same = relabel(component, first, one, next_label)
    assert again.tolist() == first.tolist()
    assert same == next_label
