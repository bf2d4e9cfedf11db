"""The Gaussian store: rows are added, removed, and found by place and by instance."""

from __future__ import annotations

import numpy as np
from helios_objectmap.camera import View
from helios_objectmap.gaussians import GaussianStore, surplus
from helios_objectmap.rendering import cpu
from helios_objectmap.spatial_index import RowGroups
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

VIEW = View(60.0, 60.0, 23.5, 17.5, 48, 36, np.eye(4))


def appended(store: GaussianStore, means, radius_m: float = 0.01) -> slice:
    n = len(means)
    return store.append(
        np.asarray(means, np.float32),
        np.full(n, radius_m, np.float32),
        0.9,
        np.zeros((n, 3), np.uint8),
        0,
    )


class Groups(RuleBasedStateMachine):
    """The linked lists against a plain dict."""

    def __init__(self) -> None:
        super().__init__()
        self.groups = RowGroups()
        self.groups.grow(30)
        self.twin: dict[int, int] = {}

    @rule(rows=st.sets(st.integers(0, 29), min_size=1), group=st.integers(0, 40))
    def move(self, rows, group):
        self.groups.move(np.array(sorted(rows)), group)
        self.twin = {r: g for r, g in self.twin.items() if r not in rows}
        self.twin |= dict.fromkeys(rows, group) if group else {}

    @rule(source=st.integers(0, 29), to=st.integers(0, 29))
    def rename(self, source, to):
        if source != to and to not in self.twin:
            self.groups.rename(np.array([source]), np.array([to]))
            if source in self.twin:
                self.twin[to] = self.twin.pop(source)

    @invariant()
    def rows_are_those_of_the_twin(self):
        for group in range(1, 41):
            wanted = sorted(r for r, g in self.twin.items() if g == group)
            assert self.groups.rows_of(np.array([group])).tolist() == wanted
        everything = self.groups.rows_of(np.arange(1, 41))
        assert everything.tolist() == sorted(self.twin)


TestGroups = Groups.TestCase
TestGroups.settings = settings(max_examples=25, stateful_step_count=20, deadline=None)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 200), st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_removal_keeps_all_data_of_the_other_gaussians(n, share, seed):
    rng = np.random.default_rng(seed)
    store = GaussianStore()
    store.column("a")
    appended(store, rng.uniform(-3, 3, (n, 3)))
    store.class_evidence[:, 0] = np.arange(n)
    store.instances.move(np.arange(n), np.arange(n) % 3)
    means = store.means.copy()
    gone = np.flatnonzero(rng.random(n) < share)
    store.remove(rng.permutation(gone))
    left = store.class_evidence[:, 0].astype(int)
    assert sorted(left) == sorted(set(range(n)) - set(gone.tolist()))
    assert np.array_equal(store.means, means[left])
    assert np.array_equal(store.instance, left % 3)
    for label in (1, 2):
        assert store.instances.rows_of(np.array([label])).tolist() == [
            row for row, i in enumerate(left) if i % 3 == label
        ]
    near = store.blocks.near(store.means, 0.1)
    assert near.tolist() == list(range(len(store)))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.005, 0.05))
def test_a_view_finds_every_gaussian_that_it_shows(seed, radius_m):
    rng = np.random.default_rng(seed)
    store = GaussianStore()
    appended(store, rng.uniform(-6, 6, (500, 3)), radius_m)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    T = np.eye(4)
    T[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    T[:3, 3] = rng.uniform(-2, 2, 3)
    view = View(60.0, 60.0, 23.5, 17.5, 48, 36, T)
    shown = cpu.project(store.means, store.radius_m, store.opacity, view, far_m=5.0)
    # Within a few radii, the projection smears Gaussians from outside the image into the image.
    wanted = shown.rows[shown.depth_m > 5 * radius_m]
    assert set(wanted.tolist()) <= set(store.seen_by(view, 5.0).tolist())


def test_a_view_ignores_gaussians_behind_the_camera():
    store = GaussianStore()
    appended(store, [(0, 0, z) for z in np.linspace(-5, -1.5, 50)])
    ahead = appended(store, [(0, 0, 2.0)])
    assert store.seen_by(VIEW, 8.0).tolist() == [ahead.start]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.2))
def test_near_finds_every_gaussian_within_reach(seed, reach_m):
    rng = np.random.default_rng(seed)
    store = GaussianStore()
    appended(store, rng.uniform(-2, 2, (300, 3)))
    points = rng.uniform(-2, 2, (5, 3)).astype(np.float32)
    gap = np.abs(store.means[:, None] - points[None]).max(axis=2).min(axis=1)
    found = set(store.blocks.near(points, reach_m).tolist())
    assert set(np.flatnonzero(gap <= reach_m).tolist()) <= found


def test_places_without_gaussians_take_no_memory():
    rng = np.random.default_rng(0)
    store, sizes = GaussianStore(), []
    for lap in range(60):
        here = rng.uniform(-4, 4, (400, 3)) + np.array([0, 0, 10 * lap])
        store.remove(np.arange(len(store)))
        appended(store, here)
        sizes.append(len(store.blocks._center_m))
        view = View(60.0, 60.0, 23.5, 17.5, 48, 36, np.eye(4))
        assert len(store.blocks.near(store.means, 0.1)) == 400
        assert set(store.seen_by(view, 5.0).tolist()) <= set(range(400))
    assert sizes[-1] == sizes[9], "blocks of places without rows are kept"


def test_a_new_column_has_no_evidence_and_a_dropped_one_is_forgotten():
    store = GaussianStore()
    store.column("a")
    appended(store, [(0, 0, 1)] * 3000)
    store.class_evidence[:] = 5
    assert store.column("b") == 1
    assert store.total_evidence.shape == (3000, 2)
    assert not store.class_evidence[:, 1].any()
    store.class_evidence[:, 1] = 7
    store.class_column[:10] = 1
    store.drop_columns(["a"])
    assert store.class_names == ["b"]
    assert (store.class_evidence == 7).all()
    assert store.class_column[:11].tolist() == [0] * 10 + [-1]


def test_surplus_gaussians_without_a_class_go_first_and_then_the_longest_unseen():
    believed = np.array([0, -1, 1, -1, 0, -1, 0, 0, 0, 0], np.int16)
    seen = np.arange(10)
    assert not len(surplus(believed, seen, 10))
    assert surplus(believed, seen, 8).tolist() == [1, 3, 5]  # down to 7 of 8
    assert surplus(believed, seen, 4).tolist() == [1, 3, 5, 0, 2, 4, 6]


def test_the_arrays_of_a_map_file_keep_their_names():
    store = GaussianStore(0)
    names = {
        "means", "radius_m", "opacity", "color", "positive", "asked", "born", "believed",
        "through", "through_from", "seen", "instance",
    }  # fmt: skip
    assert store.arrays().keys() == names
    store.append(
        np.zeros((1, 3), np.float32), np.ones(1, np.float32), 0.9, np.zeros((1, 3), np.uint8), 7
    )
    store.last_seen_update[:] = 9
    assert (store.arrays()["born"][0], store.arrays()["seen"][0]) == (7, 9)
