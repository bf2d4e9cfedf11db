"""Builder of a `Shape` from parts: drawn meshes, collision primitives, support surfaces."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.home_types import (
    CollisionPrimitive,
    Material,
    Mesh,
    Quat,
    Shape,
    SolidKind,
    Surface,
    Vec3,
    Visual,
)


class ShapeBuilder:
    """Collects the parts of a shape in the body's frame; sizes are full sizes in metres."""

    def __init__(self) -> None:
        self._meshes: dict[Material, list[Mesh]] = {}
        self._solids: list[CollisionPrimitive] = []
        self._surfaces: list[Surface] = []

    def box(
        self,
        center: Vec3,
        size: Vec3,
        material: Material,
        *,
        bevel_m: float = 0.0,
        segments: int = 1,
        tilt_rad: Vec3 = (0.0, 0.0, 0.0),
        solid: bool = False,
    ) -> None:
        """Add a box with rounded edges, rotated by (roll, pitch, yaw) about its centre."""
        mesh = mesh_primitives.box(size, bevel_m, segments)
        self.mesh(
            mesh_primitives.transformed(mesh, mesh_primitives.rotation_xyz(*tilt_rad), center),
            material,
        )
        if solid:
            self.solid("box", center, size, tilt_rad)

    def cylinder(
        self,
        center: Vec3,
        radius_m: float,
        height_m: float,
        material: Material,
        *,
        top_radius_m: float | None = None,
        bevel_m: float = 0.0,
        sides: int = 16,
        tilt_rad: Vec3 = (0.0, 0.0, 0.0),
        solid: bool = False,
    ) -> None:
        """Add a cylinder or a truncated cone along z, centred at `center`."""
        top = radius_m if top_radius_m is None else top_radius_m
        low, high, b = -height_m / 2, height_m / 2, bevel_m
        profile = [(0, low), (radius_m - b, low), (radius_m, low + b)]
        profile += [(top, high - b), (top - b, high), (0, high)]
        self.lathe(profile, center, material, sides=sides, tilt_rad=tilt_rad)
        if solid:
            width = 2 * max(radius_m, top)
            self.solid("cylinder", center, (width, width, height_m), tilt_rad)

    def lathe(
        self,
        profile: Sequence[tuple[float, float]],
        center: Vec3,
        material: Material,
        *,
        sides: int = 18,
        tilt_rad: Vec3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Add a lathed profile of (radius, height above `center`), outside from the bottom up."""
        self.mesh(
            mesh_primitives.transformed(
                mesh_primitives.lathe(profile, sides),
                mesh_primitives.rotation_xyz(*tilt_rad),
                center,
            ),
            material,
        )

    def ellipsoid(
        self,
        center: Vec3,
        half: Vec3,
        material: Material,
        *,
        sides: int = 14,
        rings: int = 8,
        tilt_rad: Vec3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Add an ellipsoid with these half axes."""
        mesh = mesh_primitives.ellipsoid(half, sides, rings)
        self.mesh(
            mesh_primitives.transformed(mesh, mesh_primitives.rotation_xyz(*tilt_rad), center),
            material,
        )

    def tube(
        self, path: Sequence[Vec3], radius_m: float, material: Material, *, sides: int = 8
    ) -> None:
        """Add a round tube along a path."""
        self.mesh(mesh_primitives.tube(path, radius_m, sides), material)

    def mesh(self, mesh: Mesh, material: Material) -> None:
        """Add a mesh in the body's frame."""
        self._meshes.setdefault(material, []).append(mesh)

    def solid(
        self, kind: SolidKind, center: Vec3, size: Vec3, tilt_rad: Vec3 = (0.0, 0.0, 0.0)
    ) -> None:
        """Add a collision primitive that fills a box of that size."""
        half = (size[0] / 2, size[1] / 2, size[2] / 2)
        if kind == "cylinder":
            half = (half[0], half[2], 0.0)
        self._solids.append(CollisionPrimitive(kind, half, center, _quat(tilt_rad)))

    def surface(
        self,
        center_xy: tuple[float, float],
        size_xy: tuple[float, float],
        height_m: float,
        clear_m: float = 10.0,
    ) -> None:
        """Add a flat rectangle on which objects up to `clear_m` high can stand."""
        half = (size_xy[0] / 2, size_xy[1] / 2)
        self._surfaces.append(Surface(center_xy, half, 0.0, height_m, clear_m))

    def finish(
        self, size_m: Vec3, main: Material, *, mass_kg: float = 0.0, rolls: bool = False
    ) -> Shape:
        """Shape of all parts, with the colour of its main material."""
        visuals = tuple(
            Visual(mesh_primitives.merge(parts), material)
            for material, parts in self._meshes.items()
        )
        return Shape(
            size_m,
            visuals,
            tuple(self._solids),
            main.rgb,
            tuple(self._surfaces),
            mass_kg,
            rolls,
        )


def lowered(shape: Shape, by_m: float) -> Shape:
    """Shape moved down by `by_m` relative to its origin."""
    visuals = tuple(
        replace(v, mesh=mesh_primitives.transformed(v.mesh, np.eye(3), (0, 0, -by_m)))
        for v in shape.visuals
    )
    solids = tuple(
        replace(s, center=(s.center[0], s.center[1], s.center[2] - by_m))
        for s in shape.collision_primitives
    )
    return replace(shape, visuals=visuals, collision_primitives=solids)


def _quat(tilt_rad: Vec3) -> Quat:
    cr, sr = math.cos(tilt_rad[0] / 2), math.sin(tilt_rad[0] / 2)
    cp, sp = math.cos(tilt_rad[1] / 2), math.sin(tilt_rad[1] / 2)
    cy, sy = math.cos(tilt_rad[2] / 2), math.sin(tilt_rad[2] / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
