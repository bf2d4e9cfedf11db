"""Gaussians of another map whose place in this frame is known."""

from __future__ import annotations

import math

import numpy as np
from helios_core.geometry import Matrix, yaw_of
from numpy.typing import NDArray

from helios_objectmap.fusion import viewing_sectors
from helios_objectmap.gaussians import OTHER, GaussianStore


def append_stored(
    store: GaussianStore, there: GaussianStore, T_here_there: Matrix, update: int, sectors: int
) -> NDArray[np.intp]:
    """Append all Gaussians of `there` with their evidence; they belong to no instance yet.

    T_here_there: turn about the vertical axis, and shift. update: number of the update that counts
    as their creation. sectors: number of viewing sectors that `store` keeps. Returns their rows.
    """
    means = there.means.astype(np.float64) @ T_here_there[:3, :3].T + T_here_there[:3, 3]
    columns = [store.column(name) for name in there.class_names]
    at = store.append(means.astype(np.float32), there.radius_m, 1.0, there.color, update)
    rows = np.arange(at.start, at.stop)
    store.opacity[at] = there.opacity
    store.class_evidence[np.ix_(rows, columns)] = there.class_evidence
    store.total_evidence[np.ix_(rows, columns)] = there.total_evidence
    if sectors and there.votes.shape[2] == sectors:
        turned = round(yaw_of(T_here_there) * viewing_sectors.SECTORS / math.tau)
        store.votes[np.ix_(rows, columns)] = np.roll(there.votes, turned, axis=2)
    named = np.array([*columns, OTHER], np.int16)  # index -1 is OTHER
    store.class_column[at] = named[there.class_column]
    store.in_core[at] = there.in_core
    store.seen_through_views[at] = there.seen_through_views
    return rows
