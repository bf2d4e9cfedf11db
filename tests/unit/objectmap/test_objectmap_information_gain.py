"""What-ifs against a float64 reference from the paper: eq. 1, 3, 5, 6, 11 and 12 in one."""

from __future__ import annotations

import numpy as np
import pytest
from helios_objectmap.camera import View
from helios_objectmap.instances.information_gain import (
    EvidenceParameters,
    InstanceEvidence,
    what_if,
)
from helios_objectmap.rendering import cpu
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from test_objectmap_renderer import VIEW, reference_kappa, scenes


def reference(
    member: InstanceEvidence,
    wanted: int,
    views: list[View],
    rates: EvidenceParameters,
    rendered: bool = False,
):
    """(Psi', information gain) after some views, in plain float64; "other" is class 0. rendered:
    Y* is the rendered coverage of a pixel."""
    hits = member.positive.astype(float)
    other = np.maximum(member.total_evidence - hits.sum(axis=1), 0)[:, None]
    gamma = rates.prior + np.concatenate([other, hits], axis=1)
    unlisted = np.full((len(gamma), max(rates.n_classes - gamma.shape[1], 0)), rates.prior)
    gamma = np.concatenate([gamma, unlisted], axis=1)
    after = gamma.copy()
    for view in views:
        kappa = reference_kappa(member.means, member.radius_m, member.opacity, view)
        if rendered:
            kappa = kappa * kappa.sum(axis=2, keepdims=True)
        after[:, 1 + wanted] += rates.alpha_cpa * (1 - rates.other) * kappa.sum(axis=(0, 1))
        after[:, 0] += rates.alpha_cpa * rates.other * kappa.sum(axis=(0, 1))
    beliefs = [(stats.dirichlet(g), stats.dirichlet(a)) for g, a in zip(gamma, after, strict=True)]
    gain = sum(g.entropy() - a.entropy() for g, a in beliefs)
    mean = np.mean([a.mean()[1 + wanted] for _, a in beliefs])
    deviation = np.mean([np.sqrt(a.var()[1 + wanted]) for _, a in beliefs])
    return mean - rates.alpha_cs * deviation, max(0.0, gain)


@settings(max_examples=20, deadline=None)
@given(
    scenes(most=25),
    st.integers(1, 4),
    st.sampled_from([0.0, 0.5]),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_expected_scores_and_information_gains_equal_the_papers_formulas(
    scene, classes, other, seed, rendered
):
    rng = np.random.default_rng(seed)
    means, radius_m, opacity = scene
    hits = rng.uniform(0, 10, (len(means), classes)).astype(np.float32)
    total_evidence = (hits.sum(axis=1) + rng.uniform(0, 10, len(means))).astype(np.float32)
    member = InstanceEvidence(means, radius_m, opacity, hits, total_evidence)
    wanted = int(rng.integers(classes))
    shifted = np.eye(4)
    shifted[:3, 3] = rng.uniform(-0.2, 0.2, 3)
    views = [VIEW, View(60.0, 60.0, 23.5, 17.5, 48, 36, shifted)]
    rates = EvidenceParameters(1.0, 3.0, 1.0, other, int(rng.choice([0, 4])))
    alone, together = what_if(cpu.project, member, wanted, views, rates, 100.0, rendered)
    for got, seen in [(alone[0], views[:1]), (alone[1], views[1:]), (together, views)]:
        psi, gain = reference(member, wanted, seen, rates, rendered)
        # kappa may differ by an alpha of 1/255 in each pixel of an edge; see the renderer's test.
        assert got.psi == pytest.approx(psi, abs=0.01)
        assert got.information_gain == pytest.approx(gain, rel=0.02, abs=0.05 * len(means))


def test_the_50_50_assumption_expects_less_than_the_optimistic_one():
    n = 20
    means = np.stack([np.zeros(n), np.zeros(n), np.linspace(1, 1.1, n)], axis=1).astype(np.float32)
    member = InstanceEvidence(
        means,
        np.full(n, 0.02, np.float32),
        np.full(n, 0.9, np.float32),
        np.zeros((n, 2), np.float32),
        np.zeros(n, np.float32),
    )
    best, half = (
        what_if(cpu.project, member, 0, [VIEW], EvidenceParameters(1, 3, 1, o), 8.0)[1]
        for o in (0.0, 0.5)
    )
    assert best.psi > half.psi
    assert best.information_gain > half.information_gain > 0


def test_a_what_if_without_views_changes_nothing():
    three = np.ones(3, np.float32)
    member = InstanceEvidence(
        np.ones((3, 3), np.float32), three, three, np.ones((3, 2), np.float32), three
    )
    alone, together = what_if(cpu.project, member, 0, [], EvidenceParameters(1.0, 3.0, 1.0), 8.0)
    assert alone == []
    assert together.information_gain == 0


@pytest.mark.parametrize("rendered", [False, True])
def test_the_pixels_of_a_what_if_are_the_rendered_coverage_within_reach(rendered):
    n = 30
    rng = np.random.default_rng(0)
    means = rng.uniform((-0.3, -0.3, 1.2), (0.3, 0.3, 1.8), (n, 3)).astype(np.float32)
    member = InstanceEvidence(
        means,
        np.full(n, 0.03, np.float32),
        np.full(n, 0.9, np.float32),
        np.zeros((n, 2), np.float32),
        np.zeros(n, np.float32),
    )
    covered = cpu.project(means, member.radius_m, member.opacity, VIEW).render().coverage.sum()
    rates = EvidenceParameters(1.0, 3.0, 1.0)
    (one, two), both = what_if(cpu.project, member, 0, [VIEW, VIEW], rates, 8.0, rendered)
    assert one.pixels == two.pixels == pytest.approx(covered, rel=1e-3)
    assert both.pixels == pytest.approx(2 * one.pixels)
    assert what_if(cpu.project, member, 0, [VIEW], rates, 0.5, rendered)[1].pixels == 0
