"""Furniture that stands side by side stays two instances where detections tell it apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helios_core.types import Detection, SearchContext
from helios_objectmap.fusion.label_image import LabelImage, read
from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.instances.clustering import components, connected, distinct, voxel_keys
from helios_objectmap.instances.co_detections import CoDetections
from helios_objectmap.instances.registry import InstanceRegistry
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.persistence import arrays_of, to_bytes
from helios_objectmap.persistence import read as read_map
from helios_objectmap.settings import ObjectMapSettings
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import CONTEXT, FLOOR, MUG, SETTINGS, TABLE, WALL, looking_at, observe

LEFT = ("table", (1.2, 0.04, 0.0), (1.7, 0.6, 0.6))
RIGHT = ("table", (1.2, -0.6, 0.0), (1.7, -0.04, 0.6))  # 8 cm beside the other
SCENE = (FLOOR, WALL, LEFT, RIGHT)
EYES = [(0.0, y) for y in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)]
BY_DISTANCE = SETTINGS.model_copy(update={"receptacle_voxel_m": 0.2, "named_from": 0.15})
TOLD_APART = BY_DISTANCE.model_copy(update={"joined_by": "detections"})


def seen(x: float, y: float, seq: int, together: bool = False, which: tuple[int, ...] = (2, 3)):
    """Both tables, detected one by one or in one detection; which: the detected boxes."""
    view = observe(SCENE, looking_at(x, y, (1.4, 0.0, 0.4)), seq=seq)
    tables = [d for d in view.detections if d.class_name == "table"]
    if together:
        mask = tables[0].mask | tables[1].mask
        rows, columns = np.nonzero(mask)
        box = int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1
        tables = [Detection("table", 0.9, box, mask)]
    else:
        tables = [tables[k - 2] for k in which]
    return view.__class__(view.frame, view.context_id, tuple(tables), {}, "truth")


def instances(setting: ObjectMapSettings, views) -> list:
    objects = ObjectMap(setting)
    for view in views:
        objects.update(view, CONTEXT)
    return [o for o in objects.objects() if o.class_name == "table"]


def test_two_tables_that_are_detected_one_by_one_are_two_instances() -> None:
    views = [seen(*eye, k) for k, eye in enumerate(EYES)]
    assert len(instances(BY_DISTANCE, views)) == 1
    two = instances(TOLD_APART, views)
    assert len(two) == 2
    assert sorted(round(float(o.center_m[1]), 1) for o in two) == [-0.3, 0.3]


def test_a_search_for_a_new_class_counts_no_pair_of_tables_again() -> None:
    cup_sought = SearchContext("c2", (replace(MUG, name="cup"), TABLE))
    objects = ObjectMap(TOLD_APART)
    counted = []
    for context in (CONTEXT, cup_sought):
        for k, eye in enumerate(EYES):
            objects.update(replace(seen(*eye, k), context_id=context.id), context)
        counted.append(objects._registry.separations["table"]._shown.sum())
    assert counted[0] == counted[1] > 0


def test_a_table_that_is_detected_in_one_piece_is_one_instance() -> None:
    views = [seen(*eye, k, together=True) for k, eye in enumerate(EYES)]
    assert len(instances(TOLD_APART, views)) == 1


def test_one_detection_over_both_does_not_join_what_most_views_tell_apart() -> None:
    keys = np.unique(voxel_keys(np.array([[0.1, 0, 0], [0.3, 0, 0]], np.float32), 0.2))
    pairs = CoDetections(0.2)
    one_by_one, together = np.array([1, 2], np.uint64), np.array([1, 1], np.uint64)
    for covering, apart in [(together, False), (one_by_one, False), (one_by_one, True)]:
        pairs.count(keys, covering)
        assert pairs.apart(keys).any() == apart
    for apart in (False, False):  # as many views now show them together
        pairs.count(keys, together)
        assert pairs.apart(keys).any() == apart


def test_a_false_detection_beside_a_table_leaves_the_table_as_it_is() -> None:
    """Joined, the two would be too large for a table, and both would be lost."""
    alone = [seen(*eye, k, which=(2,)) for k, eye in enumerate(EYES)]
    (before,) = instances(TOLD_APART, alone)
    after = instances(TOLD_APART, [*alone, seen(0.0, -0.4, 9)])
    (same,) = (o for o in after if o.id == before.id)
    assert np.abs(same.center_m - before.center_m).max() < 0.05
    assert np.abs(same.size_m - before.size_m).max() < 0.05
    joined = instances(BY_DISTANCE, [*alone, seen(0.0, -0.4, 9)])
    assert max(o.size_m[1] for o in joined) > 1.0


def test_a_saved_map_keeps_its_instances_apart() -> None:
    objects = ObjectMap(TOLD_APART)
    for k, eye in enumerate(EYES):
        objects.update(seen(*eye, k), CONTEXT)
    before = {o.id: o.center_m.round(3).tolist() for o in objects.objects()}
    again = ObjectMap(TOLD_APART)
    data = to_bytes(arrays_of(objects.content(), None, None))
    again.load_content(read_map(data, again.empty_viewpoints()).content)
    again.set_context(CONTEXT)
    assert {o.id: o.center_m.round(3).tolist() for o in again.objects()} == before


# --- the counts -----------------------------------------------------------------------------------
def reading_of(view) -> LabelImage:
    return read(view, CONTEXT, 1, 0.25, 8.0)


def pairs_of(views) -> dict[int, list[bool]]:
    """Separations of every voxel after some views."""
    pairs = CoDetections(0.2)
    for view in views:
        pairs.note(reading_of(view), 1, view.detections)
    reading = reading_of(seen(*EYES[2], 0))
    points = reading.view.lift(reading.depth_m, reading.depth_m > 0)
    keys = distinct(voxel_keys(points, 0.2))[0]
    return dict(zip(keys.tolist(), pairs.apart(keys).tolist(), strict=True))


@settings(max_examples=15, deadline=None)
@given(st.permutations(range(6)), st.lists(st.booleans(), min_size=6, max_size=6))
def test_the_order_of_the_views_does_not_matter(order, together) -> None:
    views = [seen(*eye, k, together[k]) for k, eye in enumerate(EYES)]
    assert pairs_of(views) == pairs_of([views[k] for k in order])


def test_note_reports_the_voxels_where_something_comes_apart_or_joins() -> None:
    pairs, before = CoDetections(0.2), None
    for k, eye in enumerate(EYES):
        view = seen(*eye, k, together=k >= 2)
        reading = reading_of(view)
        points = reading.view.lift(reading.depth_m, reading.depth_m > 0)
        keys = distinct(voxel_keys(points, 0.2))[0]
        before = pairs.apart(keys).copy()
        changed = set(pairs.note(reading, 1, view.detections).tolist())
        differs = (pairs.apart(keys) != before).any(axis=1)
        assert set(keys[differs].tolist()) <= changed


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_the_partition_equals_clustering_everything_with_the_separations(seed, changes) -> None:
    rng = np.random.default_rng(seed)
    store, registry = GaussianStore(), InstanceRegistry()
    store.column("table")
    size_m = 0.2

    def some_apart(pairs: CoDetections):
        """Like views that tell some voxels apart, and others not any more."""
        keys = np.unique(voxel_keys(store.means, size_m))
        if not len(keys):
            return keys
        covering = rng.integers(0, 4, len(keys)).astype(np.uint64)
        return pairs.count(keys, covering)

    for _ in range(changes):
        n = int(rng.integers(1, 40))
        means = rng.uniform(-0.8, 0.8, (n, 3)).astype(np.float32)
        new = store.append(means, np.full(n, 0.01, np.float32), 0.9, np.zeros((n, 3), np.uint8), 0)
        store.class_column[new] = 0
        registry.cluster_again("table", some_apart(registry.co_detections("table", size_m)))
        gone = np.flatnonzero(rng.random(len(store)) < 0.2)
        gone = gone[gone < new.start]
        registry.leave(store, gone, lambda _: size_m)
        registry.join(store, np.arange(new.start, new.stop), lambda _: size_m)
        store.remove(gone)
        keys, of_point = distinct(voxel_keys(store.means, size_m))
        everything = connected(keys, registry.separations["table"])[of_point]
        for labels in (store.instance, everything):
            assert len(labels) == len(store)
        groups = [
            {frozenset(np.flatnonzero(of == c).tolist()) for c in np.unique(of)}
            for of in (store.instance, everything)
        ]
        assert groups[0] == groups[1]
        assert set(np.unique(store.instance).tolist()) == set(registry.records)


def test_separations_of_other_voxels_do_not_count() -> None:
    points = np.array([[0.05, 0.0, 0.0], [0.25, 0.0, 0.0]], np.float32)
    pairs = CoDetections(0.2)
    keys = np.unique(voxel_keys(points, 0.2))
    pairs.keep_apart(keys, np.array([1, 2]))
    assert len(np.unique(components(points, 0.2, pairs))) == 2
    assert len(np.unique(components(points, 0.2))) == 1
