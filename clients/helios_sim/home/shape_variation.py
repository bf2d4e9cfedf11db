"""Operations on whole shapes: join, scale, lay on the side, recolour."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from helios_sim.home import mesh_primitives
from helios_sim.home.color_palette import Palette, tinted
from helios_sim.home.home_types import CollisionPrimitive, Material, Quat, Shape, Vec3

Maker = Callable[[np.random.Generator, Palette], Shape]

_SQRT_HALF = 0.7071067811865476


def joined(shape: Shape, more: Shape) -> Shape:
    """Union of two shapes in the same frame, with the size and colour of the first."""
    return replace(
        shape,
        visuals=(*shape.visuals, *more.visuals),
        collision_primitives=(*shape.collision_primitives, *more.collision_primitives),
        surfaces=(*shape.surfaces, *more.surfaces),
    )


def scaled(shape: Shape, factor: float) -> Shape:
    """Object scaled about its origin; its mass scales with the volume."""
    return replace(
        shape,
        size_m=_times(shape.size_m, factor),
        visuals=tuple(
            replace(
                v,
                mesh=mesh_primitives.transformed(
                    v.mesh, np.eye(3), (0, 0, 0), (factor, factor, factor)
                ),
            )
            for v in shape.visuals
        ),
        collision_primitives=tuple(
            replace(s, half_extent=_times(s.half_extent, factor), center=_times(s.center, factor))
            for s in shape.collision_primitives
        ),
        mass_kg=shape.mass_kg * factor**3,
    )


def laid_down(shape: Shape) -> Shape:
    """Object lying on its side, its z axis along -y. It may roll."""
    turn = mesh_primitives.rotation_xyz(np.pi / 2, 0, 0)
    x, y, z = shape.size_m
    return replace(
        shape,
        size_m=(x, z, y),
        visuals=tuple(
            replace(v, mesh=mesh_primitives.transformed(v.mesh, turn, (0, 0, 0)))
            for v in shape.visuals
        ),
        collision_primitives=tuple(_turned(s) for s in shape.collision_primitives),
        rolls=True,
    )


def recolored(shape: Shape, rng: np.random.Generator, spread: float, texture: str) -> Shape:
    """Shape with a random tint per material, and a pattern on its main material."""
    changed: dict[Material, Material] = {}
    for visual in shape.visuals:
        old = visual.material
        pattern = texture if texture and old.rgb == shape.color else old.texture
        changed[old] = replace(old, rgb=tinted(old.rgb, rng, spread), texture=pattern)
    main = next((m for m in changed if m.rgb == shape.color), None)
    return replace(
        shape,
        visuals=tuple(replace(v, material=changed[v.material]) for v in shape.visuals),
        color=changed[main].rgb if main else shape.color,
    )


def varied(
    make: Maker,
    size: tuple[float, float] = (0.85, 1.2),
    textures: tuple[str, ...] = (),
    lies: float = 0.0,
) -> Maker:
    """Maker that varies the size, tints and pattern of its objects; some lie on their side.

    size: range of the scale; textures: patterns to draw from, besides none; lies: share on the
    side.
    """

    def made(rng: np.random.Generator, palette: Palette) -> Shape:
        shape = scaled(make(rng, palette), float(rng.uniform(*size)))
        choices = ("", *textures)
        texture = choices[int(rng.integers(len(choices)))]
        shape = recolored(shape, rng, 0.05, texture)
        return laid_down(shape) if rng.random() < lies else shape

    return made


def _times(values: Vec3, factor: float) -> Vec3:
    return values[0] * factor, values[1] * factor, values[2] * factor


def _turned(solid: CollisionPrimitive) -> CollisionPrimitive:
    """Solid rotated by 90 degrees about x."""
    x, y, z = solid.center
    w, i, j, k = solid.quat
    s = _SQRT_HALF
    quat: Quat = (s * (w - i), s * (i + w), s * (j - k), s * (k + j))
    return replace(solid, center=(x, -z, y), quat=quat)
