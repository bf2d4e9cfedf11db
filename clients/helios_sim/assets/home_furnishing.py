"""Replacement of the parametric furniture and objects of a home by baked models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from helios_sim.assets import asset_pack as packs
from helios_sim.assets.asset_pack import Model, ModelVisual, Pack
from helios_sim.home.catalog import Catalog
from helios_sim.home.color_palette import Palette
from helios_sim.home.home_types import (
    CollisionPrimitive,
    Material,
    Mesh,
    Picture,
    Shape,
    Surface,
    Vec3,
    Visual,
)
from helios_sim.home.seating_shapes import Maker

# Limits for scaling a model to the size of the drawn shape: furniture per axis, objects uniformly.
# Furniture exceeds the drawn size by a factor of at most MOST_LARGER on each side; of objects the
# longest side does.
FURNITURE_SCALE = (0.7, 1.4)
THING_SCALE = (0.3, 1.6)
MOST_LARGER = 1.12
# A model can replace a receptacle only if it has a surface at a reachable height.
SURFACE_HEIGHT_M = (0.3, 1.2)
_MIN_SURFACE_HALF_M = 0.085
_MOST_STRETCH = 1.5  # limit of the ratio of the largest to the smallest scale of a model


@dataclass(frozen=True, eq=False)
class FurnitureReplacement:
    """Wraps the makers of a catalog: a baked model that fits replaces each parametric shape.

    The home's random generator selects the model, so a home depends on seed, preset and pack.
    A shape without a fitting model is kept.
    """

    pack: Pack
    name: str = packs.NAME
    _pictures: dict[str, Picture] = field(default_factory=dict, repr=False)

    def applied_to(self, catalog: Catalog) -> Catalog:
        """Copy of the catalog with wrapped makers."""
        return replace(
            catalog,
            receptacles={
                name: (stem, self._furniture(name, make))
                for name, (stem, make) in catalog.receptacles.items()
            },
            fixtures={name: self._furniture(name, make) for name, make in catalog.fixtures.items()},
            objects={
                name: (self._thing(name, make), likely)
                for name, (make, likely) in catalog.objects.items()
            },
        )

    def _furniture(self, class_name: str, make: Maker) -> Maker:
        models = self._of_class.get(class_name, ())

        def made(rng: np.random.Generator, palette: Palette) -> Shape:
            drawn = make(rng, palette)
            fitting = [
                (model, scale)
                for model in models
                if (scale := furniture_scale(model, drawn)) is not None
            ]
            if not fitting:
                return drawn
            model, scale = fitting[int(rng.integers(len(fitting)))]
            return self._shape(model, scale, drawn, origin_z=0.0)

        return made

    def _thing(self, class_name: str, make: Maker) -> Maker:
        models = self._of_class.get(class_name, ())

        def made(rng: np.random.Generator, palette: Palette) -> Shape:
            drawn = make(rng, palette)
            if drawn.rolls and not _is_ball(drawn):
                return drawn  # a round object on its side
            fitting = [(m, s) for m in models if (s := thing_scale(m, drawn)) is not None]
            if not fitting:
                return drawn
            model, scale = fitting[int(rng.integers(len(fitting)))]
            shape = self._shape(model, scale, drawn, origin_z=0.5)
            # A ball keeps its sphere as the collision shape.
            return (
                replace(shape, collision_primitives=drawn.collision_primitives)
                if _is_ball(drawn)
                else shape
            )

        return made

    @cached_property
    def _of_class(self) -> Mapping[str, tuple[Model, ...]]:
        names = {name for model in self.pack.models for name in model.classes}
        return {name: self.pack.of_class(name) for name in names}

    def _shape(
        self, model: Model, scale: NDArray[np.float64], drawn: Shape, *, origin_z: float
    ) -> Shape:
        """Shape of a model at a scale [3]; `origin_z`: height of its origin / model height."""
        size = _vec3(np.array(model.size_m) * scale)
        move = np.array([0.0, 0.0, -origin_z * size[2]])
        return Shape(
            size_m=size,
            visuals=tuple(self._visual(look, scale, move) for look in model.looks),
            collision_primitives=tuple(
                CollisionPrimitive(
                    "box",
                    _vec3(np.array(box[3:]) * scale),
                    _vec3(np.array(box[:3]) * scale + move),
                )
                for box in model.boxes
            ),
            color=model.rgb,
            surfaces=_surfaces(model, scale) if drawn.surfaces else (),
            mass_kg=drawn.mass_kg,
            rolls=drawn.rolls,
        )

    def _visual(
        self, look: ModelVisual, scale: NDArray[np.float64], move: NDArray[np.float64]
    ) -> Visual:
        normals = look.normals / scale
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        mesh = Mesh(
            (look.vertices * scale + move).astype(np.float32),
            normals.astype(np.float32),
            look.uv,
            look.faces,
        )
        return Visual(mesh, Material(look.rgb, specular=0.1, picture=self._picture(look.picture)))

    def _picture(self, key: str) -> Picture | None:
        if not key:
            return None
        if key not in self._pictures:
            self._pictures[key] = Picture(key, self.pack.pictures[key])
        return self._pictures[key]


def realistic(cache: Path | None = None) -> FurnitureReplacement:
    """Furniture models of the pack in the user's cache. Raises as `asset_pack.read` does."""
    return FurnitureReplacement(packs.read(cache))


def furniture_scale(model: Model, drawn: Shape) -> NDArray[np.float64] | None:
    """Scale [3] that brings a model as close to the drawn size as the limits allow.

    If both have surfaces, the height of the main surface sets the vertical scale. None if the
    result is too large or too stretched, or has no surface although the drawn shape has one.
    """
    wanted = np.array(drawn.size_m) / np.array(model.size_m)
    if drawn.surfaces and model.surfaces:
        main = max(drawn.surfaces, key=lambda s: s.half_extent_xy[0] * s.half_extent_xy[1])
        wanted[2] = main.height_m / model.surfaces[0][4]
    scale = np.clip(wanted, *FURNITURE_SCALE)
    if (scale > MOST_LARGER * wanted).any() or scale.max() > _MOST_STRETCH * scale.min():
        return None
    if drawn.surfaces and not _surfaces(model, scale):
        return None
    return scale


def thing_scale(model: Model, drawn: Shape) -> NDArray[np.float64] | None:
    """Uniform scale [3] by the longest side, None if too large; a ball gets the drawn size."""
    wanted = np.array(drawn.size_m) / np.array(model.size_m)
    if _is_ball(drawn):
        return wanted
    longest = max(drawn.size_m) / max(model.size_m)
    scale = float(np.clip(longest, *THING_SCALE))
    return None if scale > MOST_LARGER * longest else np.full(3, scale)


def _surfaces(model: Model, scale: NDArray[np.float64]) -> tuple[Surface, ...]:
    """Scaled surfaces of a model that are within reach and not too narrow."""
    found = []
    for x, y, half_x, half_y, height in model.surfaces:
        surface = Surface(
            (float(x * scale[0]), float(y * scale[1])),
            (float(half_x * scale[0]), float(half_y * scale[1])),
            0.0,
            float(height * scale[2]),
        )
        in_reach = SURFACE_HEIGHT_M[0] <= surface.height_m <= SURFACE_HEIGHT_M[1]
        if in_reach and min(surface.half_extent_xy) >= _MIN_SURFACE_HALF_M:
            found.append(surface)
    return tuple(found)


def _is_ball(shape: Shape) -> bool:
    return len(shape.collision_primitives) == 1 and shape.collision_primitives[0].kind == "sphere"


def _vec3(values: NDArray[np.float64]) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
