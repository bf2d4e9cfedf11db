"""What further views of an instance would bring (eq. 6, 11 and 12, appendix).

Optimistic: each view shows the instance's own Gaussians as the wanted class. They are rendered at
each pose alone, their weights are added to a copy of the evidence by eq. 3, and the entropies and
scores before and after are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_objectmap import splat
from helios_objectmap.dirichlet import concentration_of, entropy, marginal
from helios_objectmap.score import score
from helios_objectmap.view import View

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Expected:
    """What a set of views would make of an instance."""

    psi: float  # the score Psi' of eq. 11
    information_gain: float  # eq. 12 in nats, summed over the instance's Gaussians, at least 0


@dataclass(frozen=True)
class Member:
    """The Gaussians of one instance: geometry and evidence."""

    means: Float32  # [n, 3] world, metres
    radius_m: Float32  # [n]
    opacity: Float32  # [n]
    positive: Float32  # [n, C] for the classes of the context
    asked: Float32  # [n] for the wanted class


def kappa_at(member: Member, view: View, max_depth_m: float) -> Float32:
    """Weight that a view gives each Gaussian [n], summed over the pixels it would see it in."""
    projection = splat.project(member.means, member.radius_m, member.opacity, view)
    everywhere = np.zeros((view.height, view.width), np.int32)
    kappa = splat.kappa_sums(projection, everywhere, 1)[:, 0]
    seen = np.zeros(len(kappa), bool)
    seen[projection.visible] = projection.depth_m[projection.visible] <= max_depth_m
    return np.where(seen, kappa, np.float32(0))


def expected(
    member: Member,
    wanted: int,
    kappa: Float32,
    prior: float,
    alpha_cpa: float,
    alpha_cs: float,
) -> Expected:
    """Outcome if views of total weight kappa [n] all show column `wanted` of the context."""
    positive = member.positive.astype(np.float64)
    before = entropy(concentration_of(positive, member.asked, prior))
    evidence = alpha_cpa * kappa.astype(np.float64)
    positive[:, wanted] += evidence  # eq. 3
    asked = member.asked + evidence
    after = entropy(concentration_of(positive, asked, prior))
    gain = float((before - after).sum())  # eq. 12; one Gaussian's share may be negative
    mean, deviation = marginal(positive[:, wanted], asked, prior, positive.shape[1] + 1)
    return Expected(score(mean, deviation, alpha_cs).psi, max(gain, 0.0))  # eq. 11


def what_if(
    member: Member,
    wanted: int,
    views: Sequence[View],
    prior: float,
    alpha_cpa: float,
    alpha_cs: float,
    max_depth_m: float,
) -> tuple[list[Expected], Expected]:
    """Outcome of each view alone, and of all views together."""
    kappas = [kappa_at(member, view, max_depth_m) for view in views]
    rates = (prior, alpha_cpa, alpha_cs)
    alone = [expected(member, wanted, kappa, *rates) for kappa in kappas]
    together = np.sum(kappas, axis=0) if kappas else np.zeros(len(member.means), np.float32)
    return alone, expected(member, wanted, together, *rates)
