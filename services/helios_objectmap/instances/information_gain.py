"""Expected score and information gain of further views of an instance (eq. 6, 11 and 12, appendix).

Optimistic: each view shows the instance's own Gaussians as the wanted class. They are rendered
alone at each pose, their weights are added to a copy of the evidence by eq. 3, and the entropies
and scores before and after are compared. In the 50-50 variant (Table 5) half of the evidence goes
to "other".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from helios_objectmap.camera import View
from helios_objectmap.fusion import viewing_sectors
from helios_objectmap.fusion.semantics import concentration_of, entropy, marginal, score
from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.instances.image_text import with_evidence
from helios_objectmap.rendering.renderer_interface import Project
from helios_objectmap.settings import ObjectMapSettings

Float32 = NDArray[np.float32]

EVEN = 0.5  # share of the expected evidence for "other" in the 50-50 variant
COVERAGE_STEPS = 64  # resolution of a rendered label


@dataclass(frozen=True)
class Expected:
    """Expected score and information gain of an instance after a set of views."""

    psi: float  # the score Psi' of eq. 11
    information_gain: float  # eq. 12 in nats, summed over the instance's Gaussians, at least 0
    pixels: float = 0.0  # pixels that show the instance, by coverage, summed over the views


@dataclass(frozen=True)
class InstanceEvidence:
    """Gaussians of one instance: geometry and evidence."""

    means: Float32  # [n, 3] world, metres
    radius_m: Float32  # [n]
    opacity: Float32  # [n]
    positive: Float32  # [n, C] evidence for each class of the context
    total_evidence: Float32  # [n] all evidence of the views that searched for the wanted class
    votes_so_far: NDArray[np.uint16] | None = None  # [n, sectors] for the wanted class

    @classmethod
    def of(
        cls, store: GaussianStore, rows: NDArray[np.integer], columns: Sequence[int], column: int
    ) -> Self:
        """Evidence of some rows of the map for the classes of `columns`; `column`: the wanted one.
        Without votes, if the map keeps none."""
        return cls(
            store.means[rows],
            store.radius_m[rows],
            store.opacity[rows],
            store.class_evidence[rows][:, columns],
            store.total_evidence[rows, column],
            store.votes[rows, column, :, 1] if store.votes.shape[2] else None,
        )


@dataclass(frozen=True)
class EvidenceParameters:
    """Weights with which evidence counts."""

    prior: float  # concentration of each class before any view
    alpha_cpa: float  # factor of each observation in eq. 3; with votes, of each sector
    alpha_cs: float  # weight of the uncertainty (eq. 7)
    other: float = 0.0  # share of the expected evidence for "other"; 0 is optimistic
    n_classes: int = 0  # classes with "other", if more than the member's and "other"
    trust: float = 1.0  # share of the evidence for the wanted class that counts
    side_views: float = 1.0  # with votes: views of a sector until it counts in full
    image_text_nats: float = 0.0  # log-likelihood ratio by image-text scores, in the score

    @classmethod
    def of(
        cls, settings: ObjectMapSettings, trust: float, other: float | None, image_text_nats: float
    ) -> Self:
        """Weights by the settings. `other`: None for the settings' own assumption."""
        if other is None:
            other = EVEN if settings.assumption == "50-50" else 0.0
        return cls(
            settings.prior_concentration,
            settings.alpha_side if settings.by_sides else settings.alpha_cpa,
            settings.alpha_cs,
            other,
            settings.prior_classes,
            trust,
            settings.side_views,
            image_text_nats,
        )


@dataclass(frozen=True)
class ExpectedView:
    """Weights that one view gives the Gaussians of an instance."""

    kappa: Float32  # [n] weight as evidence (eq. 12), summed over the pixels
    pixels: float  # pixels that show the instance, each by its coverage


def expected_view(
    project: Project,
    member: InstanceEvidence,
    view: View,
    max_depth_m: float,
    rendered: bool = False,
) -> ExpectedView:
    """Weights of a view of the instance's Gaussians, rendered alone.

    rendered: as evidence each pixel p counts by its rendered label Y*(p), the coverage
    sum_n kappa(p, n); else in full.
    """
    projection = project(member.means, member.radius_m, member.opacity, view)
    if rendered:
        coverage = projection.render().coverage
        steps = np.rint(coverage * COVERAGE_STEPS).astype(np.int32)
        labels = np.arange(COVERAGE_STEPS + 1, dtype=np.float32) / COVERAGE_STEPS
        sums = projection.kappa_sums(steps, COVERAGE_STEPS + 1)
        kappa, shown = sums @ labels, sums.sum(axis=1)
    else:
        everywhere = np.zeros((view.height, view.width), np.int32)
        kappa = shown = projection.kappa_sums(everywhere, 1)[:, 0]
    near = projection.depth_m <= max_depth_m
    out = np.zeros(len(member.means), np.float32)
    out[projection.rows] = np.where(near, kappa, 0)
    return ExpectedView(out, float(shown[near].sum(dtype=np.float64)))


def expected(
    member: InstanceEvidence, wanted: int, kappas: Sequence[Float32], rates: EvidenceParameters
) -> list[Expected]:
    """Outcome for each weight kappa [n] if such views show column `wanted` of the context.

    With votes, the weight of a view is its addition in sectors: see
    `viewing_sectors.expected_new_votes`.
    """
    base = member.positive.astype(np.float64)
    base[:, wanted] *= rates.trust
    n_classes = max(rates.n_classes, base.shape[1] + 1)
    shown = np.zeros(len(base), np.bool_)
    for kappa in kappas:
        shown |= kappa != 0
    before = np.empty(len(base))
    before[shown] = entropy(
        concentration_of(base[shown], member.total_evidence[shown], rates.prior, n_classes)
    )
    out = []
    for kappa in kappas:
        seen = np.flatnonzero(kappa)
        evidence = rates.alpha_cpa * kappa[seen].astype(np.float64)
        positive = base[seen]
        positive[:, wanted] += rates.trust * (1 - rates.other) * evidence  # eq. 3
        total_evidence = member.total_evidence.astype(np.float64)
        total_evidence[seen] += evidence
        after = entropy(concentration_of(positive, total_evidence[seen], rates.prior, n_classes))
        gain = float((before[seen] - after).sum())  # eq. 6 as eq. 12; a share may be negative
        own = base[:, wanted].copy()
        own[seen] = positive[:, wanted]
        mean, deviation = marginal(own, total_evidence, rates.prior, n_classes)
        psi = with_evidence(
            score(mean, deviation, rates.alpha_cs), rates.image_text_nats
        ).psi  # eq. 11
        out.append(Expected(psi, max(gain, 0.0)))
    return out


def what_if(
    project: Project,
    member: InstanceEvidence,
    wanted: int,
    views: Sequence[View],
    rates: EvidenceParameters,
    max_depth_m: float,
    rendered: bool = False,
) -> tuple[list[Expected], Expected]:
    """Outcome of each view alone, and of all views together. rendered: see `expected_view`."""
    seen = [expected_view(project, member, view, max_depth_m, rendered) for view in views]
    kappas, pixels = [s.kappa for s in seen], [s.pixels for s in seen]
    if member.votes_so_far is not None:
        eyes_m = [view.T_world_cam[:3, 3] for view in views]
        kappas, together = viewing_sectors.expected_new_votes(
            member.votes_so_far, member.means, kappas, eyes_m, rates.side_views
        )
    else:
        together = np.sum(kappas, axis=0) if kappas else np.zeros(len(member.means), np.float32)
    *alone, joint = (
        replace(outcome, pixels=shown)
        for outcome, shown in zip(
            expected(member, wanted, [*kappas, together], rates),
            [*pixels, sum(pixels)],
            strict=True,
        )
    )
    return alone, joint
