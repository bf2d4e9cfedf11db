"""Mesh simplification: fewer triangles and parts; vertex normals with sharp creases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from helios_sim.assets.obj_reader import Part
from helios_sim.assets.surface_sampling import face_normals, sample

_SAME_RGB = 0.05
_CREASE_COS = 0.72  # 44°
_NUDGE = 0.12
_FEWEST = 24


def refined(parts: list[Part], at_most: int) -> list[Part]:
    """Model with about `at_most` triangles, in which parts of similar colour are merged."""
    parts = _joined(parts)
    areas = np.array([face_normals(p.vertices, p.faces)[1].sum() for p in parts])
    counts = np.array([len(p.faces) for p in parts], float)
    share = (areas / max(areas.sum(), 1e-12) + counts / counts.sum()) / 2
    out = []
    for part, target in zip(parts, np.maximum(share * at_most, _FEWEST), strict=True):
        fewer = _decimated(part, int(target)) if len(part.faces) > 1.1 * target else part
        fewer = _without_slivers(fewer)
        if len(fewer.faces):
            out.append(fewer)
    return out


def _joined(parts: list[Part]) -> list[Part]:
    """Parts, after merging those of nearly the same colour or with the same texture."""
    groups: list[list[Part]] = []
    for part in sorted(parts, key=lambda p: -len(p.faces)):
        for group in groups:
            if _alike(group[0], part):
                group.append(part)
                break
        else:
            groups.append([part])
    return [_concatenated(group) for group in groups]


def _alike(a: Part, b: Part) -> bool:
    if a.picture is None or b.picture is None:
        same = a.picture is b.picture
        return same and max(abs(x - y) for x, y in zip(a.rgb, b.rgb, strict=True)) < _SAME_RGB
    return np.array_equal(a.picture, b.picture)


def _concatenated(group: list[Part]) -> Part:
    starts = np.cumsum([0, *(len(p.vertices) for p in group)])
    return replace(
        group[0],
        vertices=np.concatenate([p.vertices for p in group]),
        faces=np.concatenate([p.faces + s for p, s in zip(group, starts, strict=False)]),
        uv=None
        if group[0].uv is None
        else np.concatenate([p.uv for p in group if p.uv is not None]),
    )


def _decimated(part: Part, target: int) -> Part:
    """Part with about `target` triangles, by quadric error metrics on the seamless surface."""
    import fast_simplification

    _, first, inverse = np.unique(
        np.round(part.vertices, 5), axis=0, return_index=True, return_inverse=True
    )
    welded = inverse.ravel()[part.faces]
    whole = (welded[:, 0] != welded[:, 1]) & (welded[:, 1] != welded[:, 2])
    whole &= welded[:, 0] != welded[:, 2]
    fewer = fast_simplification.simplify(
        part.vertices[first], welded[whole].astype(np.int32), target_count=target, agg=4
    )
    points, faces = np.asarray(fewer[0], float), np.asarray(fewer[1], np.int64)
    if part.uv is None:
        return replace(part, vertices=points, faces=faces)
    corners = points[faces]  # [m, 3, 3]; triangles share no vertices from here on
    return replace(
        part,
        vertices=corners.reshape(-1, 3),
        faces=np.arange(3 * len(faces)).reshape(-1, 3),
        uv=_texture_at(part, corners).reshape(-1, 2),
    )


def _texture_at(part: Part, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Texture coordinates [m, 3, 2] for the corners of new triangles on an old surface.

    Each corner uses the old triangle nearest to a point slightly inside the new triangle, so that
    it stays on its side of a seam. The coordinates are those of that old triangle at the corner.
    """
    assert part.uv is not None
    extent = float(np.ptp(part.vertices, axis=0).max())
    found = sample(part.vertices, part.faces, max(extent / 150, 0.002))
    inner = corners + _NUDGE * (corners.mean(axis=1, keepdims=True) - corners)
    _, nearest = KDTree(found.points).query(inner.reshape(-1, 3))
    old = part.faces[found.face[nearest]]  # [3m, 3]
    a, b, c = (part.vertices[old[:, k]] for k in range(3))
    weights = _barycentric(a, b, c, corners.reshape(-1, 3))
    return np.einsum("kc,kcx->kx", weights, part.uv[old]).reshape(*corners.shape[:2], 2)


def _barycentric(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], p: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Barycentric weights [k, 3] of p projected on triangles, clipped to -0.5 to 1.5."""
    u, v, w = b - a, c - a, p - a
    uu, uv, vv = (np.einsum("kx,kx->k", *pair) for pair in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("kx,kx->k", w, u), np.einsum("kx,kx->k", w, v)
    det = np.maximum(uu * vv - uv * uv, 1e-18)
    s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
    weights = np.clip(np.stack([1 - s - t, s, t], axis=1), -0.5, 1.5)
    return weights / weights.sum(axis=1, keepdims=True)


def _without_slivers(part: Part) -> Part:
    _, areas = face_normals(part.vertices, part.faces)
    faces = part.faces[areas > 1e-9]
    used, inverse = np.unique(faces, return_inverse=True)
    return replace(
        part,
        vertices=part.vertices[used],
        faces=inverse.reshape(-1, 3),
        uv=None if part.uv is None else part.uv[used],
    )


def with_normals(part: Part) -> tuple[Part, NDArray[np.float64]]:
    """Part with vertices split at edges sharper than 44°, and unit normals [n, 3]."""
    normals, areas = face_normals(part.vertices, part.faces)
    _, position = np.unique(np.round(part.vertices, 5), axis=0, return_inverse=True)
    at = position.ravel()[part.faces].ravel()  # position index of each of the 3m corners
    order = np.argsort(at, kind="stable")
    counts = np.bincount(at)
    starts = np.cumsum(counts) - counts
    # All pairs of corners at the same position.
    many = counts[at[order]]
    left = np.repeat(order, many)
    offset = np.arange(len(left)) - np.repeat(np.cumsum(many) - many, many)
    right = order[np.repeat(starts[at[order]], many) + offset]
    smooth = np.einsum("kx,kx->k", normals[left // 3], normals[right // 3]) > _CREASE_COS
    total = np.zeros((len(at), 3))
    weighted = normals * areas[:, None]
    np.add.at(total, left[smooth], weighted[right[smooth] // 3])
    total /= np.maximum(np.linalg.norm(total, axis=1), 1e-15)[:, None]
    corner = part.faces.ravel()
    columns = [part.vertices[corner], total]
    if part.uv is not None:
        columns.append(part.uv[corner])
    rounded = np.asarray(np.round(np.concatenate(columns, axis=1), 5), np.float64)
    rows, inverse = np.unique(rounded, axis=0, return_inverse=True)
    split = replace(
        part,
        vertices=rows[:, :3],
        faces=inverse.reshape(-1, 3),
        uv=None if part.uv is None else rows[:, 6:8],
    )
    return split, rows[:, 3:6]
