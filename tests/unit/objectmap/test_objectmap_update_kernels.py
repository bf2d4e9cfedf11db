"""The kernels of an update give the same bits as readable code."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest
from helios_core.types import Detection
from helios_objectmap.camera import View
from helios_objectmap.fusion import viewing_sectors
from helios_objectmap.fusion.geometry import (
    CARVE_FRONT_M,
    CREATE_FRONT_M,
    MODELLED,
    compare_with_depth,
    creation_mask,
    tolerance_m,
)
from helios_objectmap.fusion.label_image import LabelImage
from helios_objectmap.fusion.view_history import PastView, VisiblePoints
from helios_objectmap.gaussians import GaussianStore, mark_seen_kernel
from helios_objectmap.instances.clustering import voxel_keys
from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.instances.name_sightings import (
    LEAST_OF_LARGEST,
    OWN_OVERLAP,
    VOXEL_M,
    NameSightings,
    voxels_and_mean,
)
from helios_objectmap.instances.summary import believed, with_trust
from helios_objectmap.instances.voxel_numbers import VoxelNumbers
from helios_objectmap.rendering import cpu
from helios_objectmap.rendering.renderer_interface import Projection, Rendering
from hypothesis import given, settings
from hypothesis import strategies as st

SEEDS = st.integers(0, 2**32 - 1)
WIDTH, HEIGHT = 64, 48
NAMES = ("mug", "glass", "table", "bookcase")


def a_view(rng: np.random.Generator) -> View:
    T = np.eye(4)
    T[:3, 3] = rng.uniform(-0.3, 0.3, 3)
    return View(60.0, 60.0, 31.5, 23.5, WIDTH, HEIGHT, T)


def a_store(rng: np.random.Generator, n: int, sectors: int = 0) -> GaussianStore:
    """Gaussians in front of the camera of `a_view`, with random evidence for two classes."""
    store = GaussianStore(sectors)
    for name in NAMES[:2]:
        store.column(name)
    means = rng.uniform((-0.8, -0.6, 0.5), (0.8, 0.6, 2.0), (n, 3)).astype(np.float32)
    store.append(means, np.full(n, 0.02, np.float32), 0.99, np.zeros((n, 3), np.uint8), 0)
    store.class_evidence[:] = rng.uniform(0, 3, store.class_evidence.shape)
    store.total_evidence[:] = store.class_evidence.sum(axis=1, keepdims=True) + rng.uniform(0, 2)
    return store


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(1, 3000))
def test_voxels_and_mean_of_some_points_are_those_of_numpy(seed, n):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 9, (n, 3)).astype(np.float32)
    rows = np.sort(rng.permutation(n)[: n // 2 + 1]).astype(np.int32)
    keys, mean = voxels_and_mean(points, rows)
    assert np.array_equal(keys, voxel_keys(points[rows], VOXEL_M))
    assert mean.tobytes() == points[rows].mean(axis=0).tobytes()


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_voxels_are_numbered_in_the_order_in_which_they_come(seed):
    rng = np.random.default_rng(seed)
    numbers, wanted = VoxelNumbers(), {}
    for n in (0, 1, 40, 3000):
        keys = rng.integers(0, 2**62, n // 2 + 1).repeat(2)[:n]
        assert numbers.of_keys(keys).tolist() == [
            wanted.setdefault(key, len(wanted)) for key in keys.tolist()
        ]
    assert numbers.keys.tolist() == list(wanted)


@pytest.mark.parametrize("seed", range(4))
def test_depth_alone_is_rendered_as_beside_features(seed):
    rng = np.random.default_rng(seed)
    store, view = a_store(rng, 4000), a_view(rng)
    projection = cpu.project(store.means, store.radius_m, store.opacity, view)
    alone = projection.render()
    beside = projection.render(np.ones((len(projection.rows), 2), np.float32))
    assert alone.depth_m.tobytes() == beside.depth_m.tobytes()
    assert alone.coverage.tobytes() == beside.coverage.tobytes()


@pytest.mark.parametrize("seed", range(4))
def test_rows_without_a_label_change_no_sum(seed):
    """The kernel leaves them out; pixels of another label make it compute them."""
    rng = np.random.default_rng(seed)
    store, view = a_store(rng, 4000), a_view(rng)
    projection = cpu.project(store.means, store.radius_m, store.opacity, view)
    labels = rng.integers(-1, 2, (HEIGHT, WIDTH)).astype(np.int32)
    labels[rng.random(HEIGHT) < 0.5] = -1
    everywhere = np.where(labels < 0, 2, labels).astype(np.int32)
    sums, more = projection.kappa_sums(labels, 2), projection.kappa_sums(everywhere, 3)
    assert sums.tobytes() == np.ascontiguousarray(more[:, :2]).tobytes()


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(0.01, 1.0))
def test_another_trust_gives_the_belief_that_a_new_estimate_would(seed, trust):
    rng = np.random.default_rng(seed)
    store, rows = a_store(rng, 50), np.arange(3, 47)
    first = believed(store, rows, "glass", list(NAMES[:2]), 1.0, 4, 1.0, 0.9)
    again = with_trust(first, store, "glass", 1.0, 4, 1.0, trust)
    wanted = believed(store, rows, "glass", list(NAMES[:2]), 1.0, 4, 1.0, trust)
    assert again.score == wanted.score
    assert again.probabilities == wanted.probabilities
    assert again.mean.tobytes() == wanted.mean.tobytes()


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_only_gaussians_with_some_kappa_count_as_seen(seed):
    rng = np.random.default_rng(seed)
    rows = rng.permutation(30)[:20].astype(np.int32)
    kappa = np.maximum(rng.normal(-0.5, 1, (20, 3)), 0).astype(np.float32)
    seen, wanted = np.zeros(30, np.int64), np.zeros(30, np.int64)
    mark_seen_kernel(rows, kappa, seen, 7)
    wanted[rows[kappa.sum(axis=1) > 0]] = 7
    assert np.array_equal(seen, wanted)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(1, 6))
def test_past_views_vote_as_if_each_were_fused_on_its_own(seed, n_views):
    rng = np.random.default_rng(seed)
    together, single = (a_store(np.random.default_rng(seed), 40, 12) for _ in range(2))
    rows, shown = np.arange(10, 40), []
    for _ in range(n_views):
        names = tuple(rng.choice([*NAMES, ""], 3, replace=False).tolist())
        points = np.flatnonzero(rng.random(30) < 0.6)
        labels = rng.integers(0, 4, len(points)).astype(np.uint8)
        weights = rng.choice([0.0, 0.3, 1.0], 3).astype(np.float32)
        view = a_view(rng)
        empty = np.zeros((1, 1), np.uint8)
        past = PastView(view, empty.astype(np.uint16), empty, names, weights, view.T_cam_world)
        shown.append(VisiblePoints(past, points, labels))
    viewing_sectors.add_past_votes(together, rows, shown, 6.0, 6.0)
    for s in shown:
        vote_of_one_view(single, rows, s)
    for name, array in together.arrays().items():
        assert array.tobytes() == single.arrays()[name].tobytes(), name


def vote_of_one_view(store: GaussianStore, rows, shown: VisiblePoints) -> None:
    known = [i for i, name in enumerate(shown.past.names) if name in store.class_names]
    kappa = shown.labels[:, None] == [0, *(1 + i for i in known)]
    kappa[:, 0] |= ~kappa.any(axis=1)
    viewing_sectors.add_votes(
        store,
        rows[shown.points],
        kappa.astype(np.float32),
        [store.class_names.index(shown.past.names[i]) for i in known],
        np.tile(shown.past.weights[known], (len(shown.points), 1)),
        shown.past.view.T_world_cam[:3, 3],
        6.0,
        6.0,
    )


# --- geometry -------------------------------------------------------------------------------------
def a_wall(rng: np.random.Generator) -> tuple[np.ndarray, Rendering]:
    """Measured depth of a wall, and a rendering with surfaces before and behind it."""
    shape = (int(rng.integers(1, 40)), int(rng.integers(1, 40)))
    depth_m = (rng.uniform(0.4, 5) + rng.normal(0, 0.01, shape)).astype(np.float32)
    depth_m[rng.random(shape) < 0.05] = 0
    steps = rng.choice([0.0, 0.04, 0.06, 0.3], (-(-shape[0] // 5), -(-shape[1] // 5)))
    off = np.kron(steps, np.ones((5, 5)))[: shape[0], : shape[1]]
    coverage = rng.choice([0.2, 0.5, 0.9], shape, p=[0.1, 0.1, 0.8]).astype(np.float32)
    return depth_m, Rendering(
        (depth_m + off).astype(np.float32), coverage, np.empty((0, *shape), np.float32)
    )


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_new_surfaces_are_those_of_whole_images(seed):
    rng = np.random.default_rng(seed)
    depth_m, rendering = a_wall(rng)
    detected = rng.random(depth_m.shape) < 0.8
    tolerance = tolerance_m(depth_m, CREATE_FRONT_M)
    modelled = rendering.coverage >= MODELLED
    in_front = modelled & (depth_m < rendering.depth_m - tolerance)
    whole = cv2.erode(in_front.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    wanted = detected & (depth_m > 0) & (~modelled | whole)
    assert np.array_equal(creation_mask(depth_m, rendering, detected), wanted)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_gaussians_are_seen_through_as_in_whole_images(seed):
    rng = np.random.default_rng(seed)
    depth_m, _ = a_wall(rng)
    height, width = depth_m.shape
    uv = rng.uniform(-2, (width + 2, height + 2), (300, 2)).astype(np.float32)
    z = (rng.choice(depth_m.ravel(), 300) - rng.choice([0, 0.05, 0.2], 300)).astype(np.float32)
    projection = cast(Projection, SimpleNamespace(uv=uv, depth_m=z, rows=np.arange(300)))
    found = compare_with_depth(projection, depth_m)
    eroded = cv2.erode(depth_m, np.ones((3, 3), np.uint8), borderValue=0.0)
    nearest = eroded.reshape(height, width).astype(np.float32)
    through, there = [], []
    nearer_m, close_m = (tolerance_m(a, CARVE_FRONT_M) for a in (nearest, depth_m))
    for k, (u, v) in enumerate(np.rint(uv).astype(int)):
        if not (0 <= u < width and 0 <= v < height):
            continue
        here, around = depth_m[v, u], nearest[v, u]
        if around > 0 and z[k] < around - nearer_m[v, u]:
            through.append(k)
        elif here > 0 and abs(z[k] - here) < close_m[v, u]:
            there.append(k)
    assert found.through.tolist() == through
    assert found.there.tolist() == there


# --- names ---------------------------------------------------------------------------------------
@settings(max_examples=15, deadline=None)
@given(SEEDS, st.sampled_from([4, 100]))
def test_names_of_an_instance_are_those_of_sets_of_voxels(seed, most_views):
    rng = np.random.default_rng(seed)
    sightings, noted = NameSightings(most_views), []  # per view: eye, [(name, voxels)]
    for k in range(10):
        reading, detections, found = a_sighting(rng)
        sightings.note(reading, 1, detections)
        if len(noted) == most_views:
            del noted[: most_views // 2]
        noted.append((reading.view.T_world_cam[:3, 3], found))
        if k == 6:  # an object is taken away
            taken = some_points(reading, rng, 30)
            sightings.forget_at(taken)
            gone = set(voxel_keys(taken, VOXEL_M).tolist())
            noted = [(eye, [(n, v, v_now - gone) for n, v, v_now in ds]) for eye, ds in noted]
        keys = voxel_keys(some_points(reading, rng, 200), VOXEL_M)
        for name in NAMES:
            assert_same_names(sightings.named(keys, name), set(keys.tolist()), name, noted)


def a_sighting(rng: np.random.Generator):
    """A view of a rough wall, its detections, and for each its name and voxels, twice."""
    view = a_view(rng)
    depth_m = rng.uniform(0.8, 1.2, (HEIGHT, WIDTH)).astype(np.float32)
    depth_m[rng.random((HEIGHT, WIDTH)) < 0.1] = 0
    labels = np.zeros((HEIGHT, WIDTH), np.int32)
    reading = LabelImage(view, depth_m, np.zeros((HEIGHT, WIDTH, 3), np.uint8), labels)
    detections, found = [], []
    for name in rng.choice(NAMES, 3):
        mask = np.zeros((HEIGHT, WIDTH), bool)
        x, y = int(rng.integers(0, 40)), int(rng.integers(0, 30))
        box = (x, y, x + int(rng.integers(1, 24)), y + int(rng.integers(1, 18)))
        mask[box[1] : box[3], box[0] : box[2]] = rng.random((box[3] - y, box[2] - x)) < 0.8
        detections.append(Detection(str(name), 0.5, box, mask))
        voxels = set(voxel_keys(view.lift(depth_m, mask & (depth_m > 0)), VOXEL_M).tolist())
        if voxels:
            found.append((str(name), voxels, voxels))
    return reading, detections, found


def some_points(reading: LabelImage, rng: np.random.Generator, n: int):
    x, y = int(rng.integers(0, 40)), int(rng.integers(0, 30))
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[y : y + 16, x : x + 20] = True
    return reading.view.lift(reading.depth_m, mask & (reading.depth_m > 0))[:n]


def assert_same_names(named, keys: set[int], class_name: str, noted) -> None:
    views = []
    for eye, detections in noted:
        shared = [
            (name, len(now & keys))
            for name, all_voxels, now in detections
            if now & keys
            and is_furniture(name) == is_furniture(class_name)
            and len(now & keys) >= OWN_OVERLAP * min(len(all_voxels), len(keys))
        ]
        if shared:
            largest = max(n for _, n in shared)
            views.append((eye, {name for name, n in shared if n >= LEAST_OF_LARGEST * largest}))
    if not views:
        assert named is None
        return
    assert np.array_equal(named.eyes_m, [eye for eye, _ in views])
    given = [{named.names[j] for j in np.flatnonzero(row)} for row in named.given]
    assert given == [names for _, names in views]
