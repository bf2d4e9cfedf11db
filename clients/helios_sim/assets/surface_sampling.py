"""Deterministic, even sampling of points on triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MOST_PER_EDGE = 400


@dataclass(frozen=True)
class Samples:
    """Points on a surface, with the triangle and the barycentric weights of each."""

    points: NDArray[np.float64]  # [k, 3] m
    face: NDArray[np.int64]  # [k]
    weights: NDArray[np.float64]  # [k, 3] for the triangle's corners, sum 1


def sample(vertices: NDArray[np.float64], faces: NDArray[np.int64], spacing_m: float) -> Samples:
    """Lattice of points, at most `spacing_m` apart, on every triangle with its corners and edges.

    Spacing grows on edges longer than 400 spacings.
    """
    corners = vertices[faces]  # [m, 3, 3]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(edges / spacing_m), 1, _MOST_PER_EDGE).astype(np.int64)
    of_face, of_weights = [], []
    for n in np.unique(steps):
        members = np.nonzero(steps == n)[0]
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        inside = i + j <= n
        lattice = np.stack([i[inside], j[inside], n - i[inside] - j[inside]], axis=1) / n
        of_face.append(np.repeat(members, len(lattice)))
        of_weights.append(np.tile(lattice, (len(members), 1)))
    face, weights = np.concatenate(of_face), np.concatenate(of_weights)
    points = np.einsum("kc,kcx->kx", weights, corners[face])
    return Samples(points, face, weights)


def face_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit normals [m, 3] (0 for degenerate triangles) and areas [m]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    twice = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(twice, 1e-15)[:, None], twice / 2
