"""Evidence by viewing sector: repeated views from one sector add little (not in the paper)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.fusion.view_history import VisiblePoints
from helios_objectmap.gaussians import GaussianStore

SECTORS = 12
UNIT = 256  # units of the stored votes per vote
MOST_VOTES = 65535 // UNIT  # per sector, the limit of the stored type
WHOLE_KAPPA = 0.2  # sum over the pixels from which a view is a whole vote

Float32 = NDArray[np.float32]


def sector_of(means: NDArray[np.floating], eye_m: NDArray[np.floating]) -> NDArray[np.intp]:
    """Viewing sector [n] of cameras at eye_m [3] or [n, 3], seen from means [n, 3] or [3]; world,
    z up."""
    x, y = (np.asarray(eye_m[..., k], means.dtype) - means[..., k] for k in (0, 1))
    return np.floor(np.arctan2(y, x) * (SECTORS / math.tau)).astype(np.intp) % SECTORS


def add_votes(
    store: GaussianStore,
    rows: NDArray[np.integer],
    kappa: Float32,
    columns: list[int],
    weights: Float32,
    eye_m: NDArray[np.floating],
    side_views: float,
    alpha_side: float,
) -> NDArray[np.int64]:
    """Add one view to the votes and evidence of its Gaussians. Returns the indices of changed rows.

    Like `accumulate`, by viewing sector. rows: [k], distinct; kappa: [k, 1 + C] summed per label,
    "other" first, then the context's classes; columns: [C] store columns of those classes; weights:
    [k, C] share in [0, 1] that the view gives a Gaussian and class; eye_m: [3] camera position,
    world. Evidence without votes stays, and is added to. The indices returned are into `rows`.
    """
    took = np.empty(len(rows), np.int64)
    may = took[: voters_kernel(kappa, weights, took)]
    n = add_votes_kernel(
        rows, may, kappa, np.array(columns, np.int64), weights,
        sector_of(store.means[rows[may]], eye_m),
        UNIT, MOST_VOTES * UNIT, WHOLE_KAPPA, side_views * UNIT, alpha_side,
        store.votes, store.class_evidence, store.total_evidence, took,
    )  # fmt: skip
    return took[:n]


def add_past_votes(
    store: GaussianStore,
    rows: NDArray[np.integer],
    shown: Sequence[VisiblePoints],
    side_views: float,
    alpha_side: float,
) -> None:
    """Add past views to the votes of Gaussians that they show, one after the other.

    rows: [n]; shown: for each view, which of the rows it shows with which labels. Equals
    `add_votes` for each view, where each Gaussian has kappa 1 for its label. A class that the store
    does not know, or that no longer counts, gets no vote; its pixels are evidence against others.
    """
    if not shown:
        return
    number = {name: i for i, name in enumerate(store.class_names)}
    most = max(len(s.past.names) for s in shown)
    columns = np.full((len(shown), most), -1, np.int64)
    weights = np.zeros((len(shown), most), np.float32)
    for k, s in enumerate(shown):
        columns[k, : len(s.past.names)] = [number.get(name, -1) for name in s.past.names]
        weights[k, : len(s.past.names)] = s.past.weights
    eyes_m = np.array([s.past.view.T_world_cam[:3, 3] for s in shown])
    view = np.repeat(np.arange(len(shown)), [len(s.points) for s in shown])
    voted = rows[np.concatenate([s.points for s in shown])]
    past_votes_kernel(
        voted, view, np.concatenate([s.labels for s in shown]), columns, weights,
        sector_of(store.means[voted], eyes_m[view]), UNIT, MOST_VOTES * UNIT, side_views * UNIT,
        alpha_side, store.votes, store.class_evidence, store.total_evidence,
    )  # fmt: skip


def expected_new_votes(
    votes_so_far: NDArray[np.uint16],
    means: Float32,
    kappas: Sequence[Float32],
    eyes_m: Sequence[NDArray[np.floating]],
    side_views: float,
) -> tuple[list[Float32], Float32]:
    """New evidence of views, in whole sectors: [n] for each view alone, and [n] for all together.

    votes_so_far: [n, SECTORS] all votes, as the store keeps them; means: [n, 3]; kappas: [n] for
    each view; eyes_m: [3] for each view. Where a sector has votes already, a view is expected to
    repeat them, which changes no evidence.
    """
    everyone, full = np.arange(len(votes_so_far)), np.float32(side_views)
    sides = votes_so_far / np.float32(UNIT * side_views)  # 1: the sector counts in full
    before, more = np.minimum(sides, 1), sides.copy()
    alone = []
    for kappa, eye_m in zip(kappas, eyes_m, strict=True):
        at = sector_of(means, eye_m)
        share = np.minimum(kappa / np.float32(WHOLE_KAPPA), 1) / full
        after = np.minimum(sides[everyone, at] + share, 1)
        alone.append(after - before[everyone, at])
        more[everyone, at] += share
    return alone, (np.minimum(more, 1) - before).sum(axis=1)


@njit(cache=True, nogil=True)
def voters_kernel(kappa, weights, may):
    """List in may [k] the indices of the rows that the view shows and gives a weight.

    kappa: [k, 1 + C]; weights: [k, C]. Returns their number.
    """
    n = 0
    for k in range(kappa.shape[0]):
        shown = counts = False
        for c in range(kappa.shape[1]):
            shown |= kappa[k, c] > 0
        for j in range(weights.shape[1]):
            counts |= weights[k, j] > 0
        may[n] = k
        n += shown and counts
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def add_votes_kernel(
    rows,
    may,
    kappa,
    columns,
    weights,
    sectors,
    unit,
    most,
    whole_kappa,
    full,
    alpha_side,
    votes,
    positive,
    total_evidence,
    took,
):
    """Add votes to votes [., columns, sectors, (own, all)], in place of eq. 3.

    may: [m] indices into the rows [k] that may vote, rising; sectors: [m] their viewing sectors;
    unit: stored value of one vote; full: votes with which a sector counts in full; most: limit of a
    sector. Adds the resulting changes to positive and total_evidence [., columns]. Lists in took
    [k] the indices into `rows` that received votes, and returns their number.
    """
    n = 0
    for m in range(may.size):  # `took` may be the memory of `may`: it is written behind m
        k = may[m]
        total = 0.0
        for c in range(kappa.shape[1]):
            total += kappa[k, c]
        row, side, some = rows[k], sectors[m], False
        scale = unit / max(total, whole_kappa)
        for j in range(columns.size):
            more = int(weights[k, j] * total * scale + 0.5)
            if more > 0:
                own_more = min(int(weights[k, j] * kappa[k, 1 + j] * scale + 0.5), more)
                _vote(
                    row, columns[j], side, own_more, more, most, full, alpha_side, votes, positive,
                    total_evidence,
                )  # fmt: skip
                some = True
        took[n] = k
        n += some
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def past_votes_kernel(
    rows, view, labels, columns, weights, sectors, unit, most, full, alpha_side, votes, positive,
    total_evidence,
):  # fmt: skip
    """Add the votes of past views: entry k is row rows[k], seen by view view[k] with labels[k] (0:
    "other", 1 + i: class i) from sector sectors[k].

    columns, weights: [views, classes] store column, -1 for none, and weight. The other parameters
    are those of `add_votes_kernel`.
    """
    for k in range(rows.size):
        v = view[k]
        for i in range(columns.shape[1]):
            more = int(weights[v, i] * 1.0 * unit + 0.5)
            if columns[v, i] >= 0 and more > 0:
                own_more = more if labels[k] == 1 + i else 0
                _vote(
                    rows[k], columns[v, i], sectors[k], own_more, more, most, full, alpha_side,
                    votes, positive, total_evidence,
                )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(
    row, column, side, own_more, more, most, full, alpha_side, votes, positive, total_evidence
):
    """Add `more` units of votes, own_more of them for the class, and the change of the evidence."""
    own, all_votes = int(votes[row, column, side, 0]), int(votes[row, column, side, 1])
    own_before = own / max(all_votes, full)
    total_before = all_votes / max(all_votes, full)
    if all_votes + more > most:
        own, all_votes = own // 2, all_votes // 2
    own += own_more
    all_votes += more
    votes[row, column, side, 0], votes[row, column, side, 1] = own, all_votes
    positive[row, column] += alpha_side * (own / max(all_votes, full) - own_before)
    total_evidence[row, column] += alpha_side * (all_votes / max(all_votes, full) - total_before)
