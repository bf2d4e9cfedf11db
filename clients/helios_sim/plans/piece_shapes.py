"""Shape of a drawn piece: its own model, else our shape of its class, else a box of its size."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from helios_core.errors import InvalidInput

from helios_sim.home import mesh_primitives
from helios_sim.home.catalog import Catalog
from helios_sim.home.color_palette import Palette
from helios_sim.home.home_types import CollisionPrimitive, Material, Shape, Surface, Vec3
from helios_sim.home.seating_shapes import Maker
from helios_sim.home.shape_builder import ShapeBuilder, lowered
from helios_sim.plans.model_shapes import own_shape
from helios_sim.plans.plan_archive import PlanArchive
from helios_sim.plans.plan_types import Piece

Source = Literal["own model", "our shape", "box"]
_DRAWS = 6  # random shapes of a class, of which the one that needs the least stretching is taken
_PLAIN = Material((0.72, 0.70, 0.66), "", 0.1)
_LEAST_SURFACE_HALF_M = 0.085


@dataclass(eq=False)
class PieceShapes:
    """Makes the shapes of a plan's pieces; equal pieces share one."""

    archive: PlanArchive
    catalog: Catalog
    palette: Palette
    failures: dict[str, str] = field(default_factory=dict)  # piece -> why its model is not used
    _made: dict[tuple[object, ...], tuple[Shape, Source]] = field(default_factory=dict)

    def shape(self, piece: Piece, class_name: str) -> tuple[Shape, Source]:
        """Shape of a piece of that class in the furniture frame, and where it comes from."""
        key = (
            piece.model,
            piece.size_m,
            piece.rotation.tobytes(),
            piece.rgb,
            class_name,
            piece.catalog_id,
        )
        if key not in self._made:
            self._made[key] = self._shape(piece, class_name)
        return self._made[key]

    def _shape(self, piece: Piece, class_name: str) -> tuple[Shape, Source]:
        if piece.model:
            try:
                return own_shape(self.archive, piece, class_name), "own model"
            except InvalidInput as error:
                self.failures[piece.name] = error.message
        make = _makers(self.catalog).get(class_name)
        if make is None:
            return box_shape(piece), "box"
        seed = hashlib.sha256(f"{class_name}{piece.size_m}".encode()).digest()
        rng = np.random.default_rng(list(seed[:8]))
        drawn = [make(rng, self.palette) for _ in range(_DRAWS)]
        best = min(drawn, key=lambda shape: _stretch(shape.size_m, piece.size_m))
        return fitted(best, piece.size_m), "our shape"


def _makers(catalog: Catalog) -> Mapping[str, Maker]:
    return {name: make for name, (_, make) in catalog.receptacles.items()} | dict(catalog.fixtures)


def _stretch(drawn: Vec3, wanted: Vec3) -> float:
    """Ratio of the largest to the smallest scale that brings one size to another."""
    scales = [b / max(a, 1e-6) for a, b in zip(drawn, wanted, strict=True)]
    return max(scales) / min(scales)


def box_shape(piece: Piece) -> Shape:
    """Box of the size of a piece."""
    material = _PLAIN if piece.rgb is None else replace(_PLAIN, rgb=piece.rgb)
    b = ShapeBuilder()
    middle = (0.0, 0.0, piece.size_m[2] / 2)
    b.box(middle, piece.size_m, material, bevel_m=min(0.01, min(piece.size_m) / 4), solid=True)
    return b.finish(piece.size_m, material)


def fitted(shape: Shape, size_m: Vec3) -> Shape:
    """Shape in the furniture frame, stretched along its axes to a size.

    Tilted solids keep their tilt and are stretched along their own axes.
    """
    sx, sy, sz = (b / max(a, 1e-6) for a, b in zip(shape.size_m, size_m, strict=True))
    scale = np.array([sx, sy, sz])
    visuals = tuple(
        replace(v, mesh=mesh_primitives.transformed(v.mesh, np.eye(3), (0, 0, 0), (sx, sy, sz)))
        for v in shape.visuals
    )
    surfaces = tuple(_stretched(surface, sx, sy, sz) for surface in shape.surfaces)
    return replace(
        shape,
        size_m=size_m,
        visuals=visuals,
        collision_primitives=tuple(_scaled(s, scale) for s in shape.collision_primitives),
        surfaces=tuple(s for s in surfaces if min(s.half_extent_xy) >= _LEAST_SURFACE_HALF_M),
    )


def _stretched(surface: Surface, sx: float, sy: float, sz: float) -> Surface:
    cos, sin = abs(math.cos(surface.yaw_rad)), abs(math.sin(surface.yaw_rad))
    hx, hy = surface.half_extent_xy
    return replace(
        surface,
        center_xy=(surface.center_xy[0] * sx, surface.center_xy[1] * sy),
        half_extent_xy=(hx * math.hypot(cos * sx, sin * sy), hy * math.hypot(sin * sx, cos * sy)),
        height_m=surface.height_m * sz,
        clear_m=surface.clear_m if surface.clear_m >= 9 else surface.clear_m * sz,
    )


def _scaled(solid: CollisionPrimitive, scale: np.ndarray) -> CollisionPrimitive:
    w, x, y, z = solid.quat
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    own = np.linalg.norm(scale[:, None] * turn, axis=0)  # stretch along the solid's own axes
    a, b, c = solid.half_extent
    half = (a * own[0], b * own[1], c * own[2])
    if solid.kind == "cylinder":
        half = (a * math.sqrt(own[0] * own[1]), b * own[2], 0.0)
    elif solid.kind == "sphere":
        return replace(
            solid, kind="ellipsoid", half_extent=_vec3(a * own), center=_vec3(scale * solid.center)
        )
    return replace(solid, half_extent=_vec3(half), center=_vec3(scale * np.array(solid.center)))


def raised(shape: Shape, by_m: float) -> Shape:
    """Shape moved up by `by_m`, with its surfaces; its height then counts from the floor."""
    if abs(by_m) < 1e-6:
        return shape
    up = lowered(shape, -by_m)
    width, depth, height = shape.size_m
    surfaces = tuple(replace(s, height_m=s.height_m + by_m) for s in shape.surfaces)
    return replace(up, size_m=(width, depth, height + by_m), surfaces=surfaces)


def _vec3(values: np.ndarray | tuple[float, ...]) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
