"""Evidence, expectation, variance, entropy and score against float64 references (eq. 2-7)."""

from __future__ import annotations

import numpy as np
import pytest
from helios_objectmap.fusion import semantics
from helios_objectmap.fusion.semantics import (
    NAMED_FROM,
    accumulate,
    most_likely_columns,
    score,
)
from helios_objectmap.gaussians import OTHER, GaussianStore
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

CONCENTRATIONS = st.lists(st.floats(0.1, 500), min_size=2, max_size=8)


@settings(max_examples=50, deadline=None)
@given(CONCENTRATIONS)
def test_expectation_variance_and_entropy_equal_scipys_dirichlet_distribution(gamma):
    concentration = np.array(gamma)
    twin = stats.dirichlet(concentration)
    assert np.allclose(semantics.expectation(concentration), twin.mean())
    assert np.allclose(semantics.variance(concentration), twin.var())
    # eq. 5 subtracts numbers of up to a thousand: 1e-9 of that is lost.
    assert semantics.entropy(concentration) == pytest.approx(twin.entropy(), abs=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0, 100), min_size=3, max_size=6), st.floats(0.2, 5))
def test_marginals_within_one_context_equal_those_of_the_whole_distribution(evidence, prior):
    hits = np.array(evidence)  # "other" first
    concentration = hits + prior
    mean, deviation = semantics.marginal(
        hits[1:], np.full(len(hits) - 1, hits.sum()), prior, len(hits)
    )
    assert np.allclose(mean, semantics.expectation(concentration)[1:])
    assert np.allclose(deviation, np.sqrt(semantics.variance(concentration)[1:]))
    rebuilt = semantics.concentration_of(hits[None, 1:], np.array([hits.sum()]), prior)
    assert np.allclose(rebuilt[0], concentration)


def reference_update(gamma, kappa, alpha_cpa):
    """eq. 3: gamma [n][C], kappa [n][C] summed over the pixels of each class, plain Python."""
    return [
        [g + alpha_cpa * k for g, k in zip(gs, ks, strict=True)]
        for gs, ks in zip(gamma, kappa, strict=True)
    ]


def store_of(n: int, class_names: list[str]) -> GaussianStore:
    store = GaussianStore()
    for name in class_names:
        store.column(name)
    store.append(
        np.zeros((n, 3), np.float32), np.ones(n, np.float32), 0.9, np.zeros((n, 3), np.uint8), 0
    )
    return store


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 12), st.integers(1, 4), st.floats(0.1, 10), st.integers(0, 2**32 - 1))
def test_accumulated_evidence_gives_the_concentration_of_eq_3(n, classes, alpha_cpa, seed):
    rng = np.random.default_rng(seed)
    store = store_of(n, [f"c{i}" for i in range(classes)])
    gamma = [[1.0] * (classes + 1) for _ in range(n)]
    everything = np.ones((n, classes), np.float32)
    for _ in range(3):
        kappa = rng.uniform(0, 5, (n, classes + 1)).astype(np.float32)
        before = store.class_evidence.copy(), store.total_evidence.copy()
        accumulate(store, np.arange(n), kappa, list(range(classes)), everything, alpha_cpa)
        assert (store.class_evidence >= before[0]).all()
        assert (store.total_evidence >= before[1]).all()
        gamma = reference_update(gamma, kappa.astype(float), alpha_cpa)
    rebuilt = semantics.concentration_of(store.class_evidence, store.total_evidence[:, 0], 1.0)
    assert np.allclose(rebuilt, gamma, rtol=1e-4, atol=1e-3)  # float32 sums


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 10), st.floats(1.1, 5))
def test_accumulate_is_linear_in_alpha_cpa(alpha_cpa, factor):
    kappa = np.array([[0.3, 0.7], [2.0, 0.0]], np.float32)
    once, more = store_of(2, ["a"]), store_of(2, ["a"])
    everything = np.ones((2, 1), np.float32)
    accumulate(once, np.arange(2), kappa, [0], everything, alpha_cpa)
    accumulate(more, np.arange(2), kappa, [0], everything, alpha_cpa * factor)
    assert np.allclose(more.class_evidence, once.class_evidence * factor, rtol=1e-5)
    assert np.allclose(more.total_evidence, once.total_evidence * factor, rtol=1e-5)


def test_evidence_is_proportional_to_the_weight_of_the_view():
    store = store_of(3, ["a"])
    kappa = np.ones((3, 2), np.float32)
    accumulate(store, np.arange(3), kappa, [0], np.array([[1.0], [0.5], [0.0]], np.float32), 3.0)
    assert store.total_evidence[:, 0].tolist() == [6.0, 3.0, 0.0]
    assert store.class_evidence[:, 0].tolist() == [3.0, 1.5, 0.0]


def test_score_is_the_mean_less_the_mean_deviation():
    mean, deviation = np.array([0.8, 0.6]), np.array([0.1, 0.3])
    got = score(mean, deviation, alpha_cs=2.0)
    assert (got.class_score, got.uncertainty) == pytest.approx((0.7, 0.2))
    assert got.psi == pytest.approx(0.7 - 2.0 * 0.2)  # eq. 7


def most_likely_class(positive, total, context, named_from=NAMED_FROM):
    positive, total = np.array([positive], np.float32), np.array([total], np.float32)
    columns, _ = most_likely_columns(
        positive, total, np.arange(1), context, 1.0, len(context) + 1, named_from
    )
    return columns[0]


def test_ties_go_to_other_and_then_to_the_first_class():
    assert most_likely_class([0, 0], [0, 0], [0, 1]) == OTHER
    assert most_likely_class([3, 3], [6, 6], [0, 1]) == 0
    assert most_likely_class([3, 3], [6, 6], [1, 0]) == 1


def test_a_class_of_an_earlier_context_holds_until_the_present_context_names_one():
    assert most_likely_class([9, 0], [10, 0], [1]) == 0
    assert most_likely_class([9, 9], [10, 10], [1]) == 1


def test_a_class_of_an_earlier_context_needs_evidence_above_its_share():
    for positive, total in [(0, 0), (0, 10), (1, 10)]:
        assert most_likely_class([positive, 0], [total, 0], [1], named_from=0.15) == OTHER
    assert most_likely_class([2, 0], [10, 0], [1], named_from=0.15) == 0
    assert most_likely_class([0, 2, 0], [0, 10, 0], [2], named_from=0.15) == 1


def reference_belief(positive, total, context, prior, named_from):
    """The most likely class in float64, plain Python: (column, by how much it leads)."""
    n_classes = len(context) + 1
    mean = (positive + prior) / (total + prior * n_classes)
    earlier = [c for c in range(len(positive)) if c not in context]
    above = {c: positive[c] - named_from * total[c] for c in earlier}
    likely = [c for c in earlier if above[c] > 0]
    best = max(likely, key=mean.__getitem__, default=OTHER)
    lead = min([*map(abs, above.values()), *np.diff(sorted(mean[likely])[-2:])], default=np.inf)
    ranked = sorted(mean[context])
    top = max(context, key=mean.__getitem__)
    other = max(total[top] - positive[context].sum(), 0)
    named = positive[top] - named_from * (positive[top] + other)
    if named > 0:
        best = top
    lead = min(lead, abs(named), *np.diff(ranked[-2:]))
    return best, lead


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 5),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.3, 1.0, 10.0]),
    st.sampled_from([0.5, 0.3, 0.8]),
)
def test_the_most_likely_class_equals_the_reference(columns, seed, prior, named_from):
    rng = np.random.default_rng(seed)
    context = rng.permutation(columns)[: rng.integers(1, columns + 1)].tolist()
    share = rng.dirichlet(np.ones(columns + 1), 40)[:, 1:]
    total = rng.uniform(0, 30, (40, 1)) * np.ones((1, columns))
    positive, total = (share * total).astype(np.float32), total.astype(np.float32)
    rows = rng.permutation(40)
    got, _ = most_likely_columns(
        positive, total, rows, context, prior, len(context) + 1, named_from
    )
    for row, column in zip(rows, got, strict=True):
        expected, lead = reference_belief(
            positive[row].astype(float), total[row].astype(float), context, prior, named_from
        )
        assert column == expected or lead < 1e-3  # near-ties go to the first, or to "other"
