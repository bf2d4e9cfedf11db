"""The summary of an instance and its view counts, against plain numpy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helios_objectmap.fusion.semantics import marginal, score
from helios_objectmap.gaussians import NO_INSTANCE, GaussianStore
from helios_objectmap.instances.registry import InstanceRecord, InstanceRegistry
from helios_objectmap.instances.summary import BELIEVED, BOX_QUANTILES, believed, describe, shape_of
from hypothesis import given, settings
from hypothesis import strategies as st

NAMES = ["mug", "table", "shelf"]


def scene(seed: int, n: int) -> GaussianStore:
    rng = np.random.default_rng(seed)
    store = GaussianStore()
    for name in NAMES:
        store.column(name)
    means = rng.normal(0, [0.1, 0.3, 0.05], (n, 3)).astype(np.float32)
    store.append(means, np.full(n, 0.01, np.float32), 0.9, np.zeros((n, 3), np.uint8), 0)
    store.total_evidence[:] = rng.uniform(0, 30, (n, 1))
    store.class_evidence[:] = (
        store.total_evidence * rng.dirichlet(np.ones(len(NAMES) + 1), n)[:, 1:]
    )
    return store


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 7, 300, 5000]), st.floats(0.1, 3))
def test_the_summary_of_an_instance_follows_from_its_gaussians(seed, n, prior):
    store = scene(seed, n)
    rows = np.flatnonzero(np.random.default_rng(seed).random(n) < 0.8).astype(np.int32)
    if not len(rows):
        return
    belief = believed(store, rows, "table", NAMES, prior, 4, alpha_cs=0.7)
    record = InstanceRecord("table", views=4.2, detected=2.1)
    o = describe(3, record, shape_of(store.means, belief), belief)

    mean, deviation = marginal(store.class_evidence[rows], store.total_evidence[rows], prior, 4)
    scored = score(mean[:, 1], deviation[:, 1], 0.7)
    assert o.score == pytest.approx(scored.psi, abs=1e-5)
    assert (o.class_score, o.uncertainty) == pytest.approx(
        (scored.class_score, scored.uncertainty), abs=1e-5
    )
    for j, name in enumerate(NAMES):
        assert o.probabilities[name] == pytest.approx(mean[:, j].mean(), abs=1e-5)
    assert sum(o.probabilities.values()) == pytest.approx(1.0)
    assert (o.gaussians, o.views, o.detection_rate) == (len(rows), 4, pytest.approx(0.5))

    own = mean[:, 1] > BELIEVED
    points = store.means[rows[own] if own.any() else rows].astype(np.float64)
    low, high = np.quantile(points, BOX_QUANTILES, axis=0)
    assert np.allclose(o.center_m, (low + high) / 2, atol=1e-6)
    assert np.allclose(o.size_m, high - low, atol=1e-6)
    inside = ((points >= low) & (points <= high)).all(axis=1)
    solid = points[inside] if inside.any() else points
    assert o.top_m == pytest.approx(solid[:, 2].max())
    hull = cv2.convexHull(solid[:, :2].astype(np.float32))
    found = np.ascontiguousarray(o.outline_m, np.float32)
    assert cv2.contourArea(found) == pytest.approx(cv2.contourArea(hull), abs=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_view_is_counted_for_the_instances_that_it_shows(seed):
    rng = np.random.default_rng(seed)
    k = 60
    labels = rng.integers(NO_INSTANCE, 4, k).astype(np.int32)
    kappa = (rng.uniform(0, 1, (k, 3)) * rng.uniform(0, 0.4)).astype(np.float32)
    weights = rng.choice([0.25, 1.0], (k, 2)).astype(np.float32)
    registry = InstanceRegistry()
    registry.records = {
        1: InstanceRecord("mug"),
        2: InstanceRecord("table"),
        3: InstanceRecord("x"),
    }
    depth_m = (1 + 1.25 * labels).astype(np.float32)  # the mug at 2.25 m, the table at 3.5 m
    everyone, names = np.arange(len(labels)), ["mug", "table"]
    given_labels = registry.note_view(labels, everyone, kappa, weights, depth_m, names)
    assert given_labels == sorted(set(labels.tolist()) - {NO_INSTANCE})
    for label, own in ((1, 0), (2, 1)):
        mine = labels == label
        seen = kappa[mine].sum(axis=0)
        record = registry.records[label]
        if not mine.any() or seen.sum() < 1:
            assert record.views == 0
            continue
        share = np.average(weights[mine, own], weights=kappa[mine].sum(axis=1))
        assert record.views == pytest.approx(share, rel=1e-5)
        assert record.detected in (0.0, record.views)
        assert record.detected_at[label] == record.detected == record.detected_at.sum()
        if abs(seen[1 + own] - 0.5 * seen.sum()) > 1e-4:
            assert (record.detected > 0) == (seen[1 + own] > 0.5 * seen.sum())
    assert registry.records[3].views == 0


@given(st.integers(0, 2**32 - 1), st.integers(2, 200), st.floats(0.05, 0.95))
def test_a_merge_or_a_split_weighs_beliefs_and_makes_none(seed, n, share):
    """S and U of an instance are those of its parts, weighted by their Gaussians."""
    store = scene(seed, n)
    first = np.random.default_rng(seed).random(n) < share
    if first.all() or not first.any():
        return
    parts = [np.flatnonzero(part).astype(np.int32) for part in (first, ~first)]
    of_parts = [believed(store, rows, "mug", NAMES, 1.0, 4, alpha_cs=1.0).score for rows in parts]
    whole = believed(store, np.arange(n, dtype=np.int32), "mug", NAMES, 1.0, 4, alpha_cs=1.0).score
    weights = np.array([len(rows) for rows in parts]) / n
    for name in ("class_score", "uncertainty", "psi"):
        wanted = float(weights @ [getattr(part, name) for part in of_parts])
        assert getattr(whole, name) == pytest.approx(wanted, abs=1e-6)
