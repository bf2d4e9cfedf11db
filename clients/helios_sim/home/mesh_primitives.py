"""Mesh primitives: boxes with rounded edges, lathed profiles, tubes, ellipsoids, flat grids.

Triangles are counter-clockwise seen from outside, with unit normals and texture coordinates in
metres along the surface.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from helios_sim.home.home_types import Mesh, Vec3

_SMOOTH_BELOW_COS = math.cos(math.radians(40))


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh with the triangles of all meshes."""
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate(
            [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]
        ).astype(np.int32),
    )


def transformed(
    mesh: Mesh, rotation: NDArray[np.float64], translation: Sequence[float], scale: Vec3 = (1, 1, 1)
) -> Mesh:
    """Mesh scaled along its axes, then rotated [3, 3], then translated."""
    normals = mesh.normals / np.asarray(scale)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(
        ((mesh.vertices * np.asarray(scale)) @ rotation.T + np.asarray(translation)).astype(
            np.float32
        ),
        (normals @ rotation.T).astype(np.float32),
        mesh.uv,
        mesh.faces,
    )


def rotation_xyz(roll_rad: float, pitch_rad: float, yaw_rad: float) -> NDArray[np.float64]:
    """Rotation matrix [3, 3] about x, then y, then z of the fixed frame."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


# Faces of a box: outward axis, its sign, and the two axes (u, v) with u x v = outward.
_BOX_FACES = (
    (0, 1, 1, 2),
    (0, -1, 2, 1),
    (1, 1, 2, 0),
    (1, -1, 0, 2),
    (2, 1, 0, 1),
    (2, -1, 1, 0),
)


def box(size: Vec3, bevel_m: float = 0.0, segments: int = 1) -> Mesh:
    """Box of that size about the origin; `bevel_m` rounds its edges in `segments` steps."""
    half = np.asarray(size, dtype=np.float64) / 2
    # A bevel below 0.1 mm is invisible, and its normals are unreliable.
    radius = min(bevel_m, float(half.min()) * 0.98) if bevel_m > 1e-4 else 0.0
    parts = []
    for axis, sign, u_axis, v_axis in _BOX_FACES:
        u = _grid_line(half[u_axis], radius, segments)
        v = _grid_line(half[v_axis], radius, segments)
        points = np.zeros((len(v), len(u), 3))
        points[..., u_axis] = u[None, :]
        points[..., v_axis] = v[:, None]
        points[..., axis] = sign * half[axis]
        points = points.reshape(-1, 3)
        if radius > 0:
            inner = np.clip(points, -(half - radius), half - radius)
            normals = points - inner
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            vertices = inner + radius * normals
        else:
            normals = np.zeros_like(points)
            normals[:, axis] = sign
            vertices = points
        # Patterns run along u, so u is the longer side of the face.
        long_axis, short_axis = (
            (u_axis, v_axis) if half[u_axis] >= half[v_axis] else (v_axis, u_axis)
        )
        uv = points[:, [long_axis, short_axis]] + half[[long_axis, short_axis]]
        parts.append(_mesh(vertices, normals, uv, _grid_faces(len(v), len(u))))
    return merge(parts)


def _grid_line(half: float, radius: float, segments: int) -> NDArray[np.float64]:
    if radius <= 0:
        return np.array([-half, half])
    steps = half - radius + radius * np.arange(segments + 1) / segments
    return np.concatenate([-steps[::-1], steps])


@lru_cache(maxsize=512)
def _grid_faces(rows: int, columns: int, wrap: bool = False) -> NDArray[np.int32]:
    """Faces [m, 3] of a grid of vertices; with `wrap` the last column is joined to the first.

    Shared between meshes and therefore read-only.
    """
    row, column = np.mgrid[0 : rows - 1, 0 : columns if wrap else columns - 1]
    following = (column + 1) % columns
    a, b = row * columns + column, row * columns + following
    c, d = b + columns, a + columns
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], -2).reshape(-1, 3)
    faces = faces.astype(np.int32)
    faces.flags.writeable = False
    return faces


def _mesh(
    vertices: NDArray[np.float64],
    normals: NDArray[np.float64],
    uv: NDArray[np.float64],
    faces: NDArray[np.int32],
) -> Mesh:
    return Mesh(
        vertices.astype(np.float32), normals.astype(np.float32), uv.astype(np.float32), faces
    )


def lathe(profile: Sequence[tuple[float, float]], sides: int = 20) -> Mesh:
    """Surface of revolution about z of a profile (radius, height), outside from the bottom up.

    Corners sharper than 40 degrees stay sharp. A profile that returns downwards on the inside
    makes a vessel.
    """
    points = np.asarray(profile, dtype=np.float64)
    steps = np.diff(points, axis=0)
    keep = np.linalg.norm(steps, axis=1) > 1e-6
    points = np.concatenate([points[:1], points[1:][keep]])
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    outward = np.stack([steps[:, 1], -steps[:, 0]], axis=1) / lengths[:, None]
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    cos, sin = np.cos(angle), np.sin(angle)
    parts = []
    for i in range(len(steps)):
        ends = []
        for j, neighbour in ((i, i - 1), (i + 1, i + 1)):
            normal = outward[i]
            inside = 0 <= neighbour < len(steps)
            if inside and float(outward[neighbour] @ outward[i]) > _SMOOTH_BELOW_COS:
                normal = outward[i] + outward[neighbour]
                normal = normal / np.linalg.norm(normal)
            ends.append((points[j], normal, along[j]))
        vertices = np.concatenate(
            [np.stack([r * cos, r * sin, np.full_like(cos, z)], 1) for (r, z), _, _ in ends]
        )
        normals = np.concatenate(
            [np.stack([n[0] * cos, n[0] * sin, np.full_like(cos, n[1])], 1) for _, n, _ in ends]
        )
        around = angle * max(float(points[:, 0].max()), 1e-3)
        uv = np.concatenate([np.stack([around, np.full_like(cos, s)], 1) for _, _, s in ends])
        parts.append(_mesh(vertices, normals, uv, _grid_faces(2, sides + 1)))
    return _without_slivers(merge(parts))


def tube(path: Sequence[Vec3], radius_m: float, sides: int = 8) -> Mesh:
    """Round tube along a path, open at both ends."""
    points = np.asarray(path, dtype=np.float64)
    tangents = np.gradient(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    # A fixed normal of the path's plane keeps the cross-sections from twisting.
    spread = np.linalg.svd(points - points.mean(0))[2][2]
    side = np.cross(tangents, spread)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangents, side)
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    normals = (
        np.cos(angle)[None, :, None] * side[:, None, :]
        + np.sin(angle)[None, :, None] * other[:, None, :]
    )
    vertices = points[:, None, :] + radius_m * normals
    uv = np.zeros((len(points), sides + 1, 2))
    uv[..., 0] = (angle * radius_m)[None, :]
    return _mesh(
        vertices.reshape(-1, 3),
        normals.reshape(-1, 3),
        uv.reshape(-1, 2),
        _grid_faces(len(points), sides + 1),
    )


def arc(
    center: Vec3, radius_m: float, start_rad: float, end_rad: float, points: int = 9
) -> list[Vec3]:
    """Points of an arc in the x-z plane through `center`."""
    return [
        (center[0] + radius_m * math.cos(a), center[1], center[2] + radius_m * math.sin(a))
        for a in np.linspace(start_rad, end_rad, points)
    ]


@lru_cache(maxsize=8)
def _unit_sphere(sides: int, rings: int) -> Mesh:
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    return lathe(
        [(max(float(np.cos(a)), 0.0), float(np.sin(a))) for a in angle],
        sides,
    )


def ellipsoid(half: Vec3, sides: int = 14, rings: int = 8) -> Mesh:
    """Ellipsoid about the origin with these half axes."""
    return transformed(_unit_sphere(sides, rings), np.eye(3), (0, 0, 0), half)


def quad(corner: Vec3, edge_u: Vec3, edge_v: Vec3, cells_u: int = 1, cells_v: int = 1) -> Mesh:
    """Flat grid with the normal edge_u x edge_v; uv in metres from the corner."""
    u, v = np.asarray(edge_u, dtype=np.float64), np.asarray(edge_v, dtype=np.float64)
    s, t = np.meshgrid(np.linspace(0, 1, cells_u + 1), np.linspace(0, 1, cells_v + 1))
    vertices = np.asarray(corner) + s.reshape(-1, 1) * u + t.reshape(-1, 1) * v
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal)
    uv = np.stack([s.ravel() * np.linalg.norm(u), t.ravel() * np.linalg.norm(v)], 1)
    return _mesh(
        vertices, np.tile(normal, (len(vertices), 1)), uv, _grid_faces(cells_v + 1, cells_u + 1)
    )


def covered_once(mesh: Mesh, size_m: tuple[float, float]) -> Mesh:
    """Flat mesh of that size whose texture covers it exactly once."""
    uv = (mesh.uv / np.asarray(size_m)).astype(np.float32)
    return Mesh(mesh.vertices, mesh.normals, uv, mesh.faces)


def _without_slivers(mesh: Mesh) -> Mesh:
    """Mesh without triangles of zero area, which occur at the poles of a lathed profile."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return Mesh(mesh.vertices, mesh.normals, mesh.uv, mesh.faces[area > 1e-12])
