"""Tests furniture, objects and meshes."""

import itertools

import mujoco
import numpy as np
import pytest
from helios_sim.home import mesh_primitives, other_furniture_shapes, textures
from helios_sim.home.catalog import FIXTURES, OBJECTS, RECEPTACLES
from helios_sim.home.catalog_ovmm import OVMM
from helios_sim.home.color_palette import draw_palette
from helios_sim.home.home_types import Mesh, Shape
from helios_sim.home.mujoco_model import ModelBuilder
from hypothesis import given, settings
from hypothesis import strategies as st

MAKERS = {
    **{name: make for name, (_, make) in RECEPTACLES.items()},
    **FIXTURES,
    **{name: make for name, (make, _) in OBJECTS.items()},
}
# The benchmark's makers, under their own names.
OVMM_THINGS = {f"ovmm {name}": make for name, (make, _) in OVMM.objects.items()}
OVMM_FURNITURE = {f"ovmm {name}": make for name, (_, make) in OVMM.receptacles.items()}
MAKERS |= OVMM_THINGS | OVMM_FURNITURE
MAKERS |= {f"ovmm {name}": make for name, make in OVMM.fixtures.items()}
SIZES = st.floats(0.02, 2.0)


def make_shape(name: str, seed: int) -> Shape:
    rng = np.random.default_rng(seed)
    return MAKERS[name](rng, draw_palette(rng))


def faces_point_outwards(mesh: Mesh) -> bool:
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    face = np.cross(b - a, c - a)
    mean = mesh.normals[mesh.faces].astype(np.float64).mean(axis=1)
    return bool(((face * mean).sum(axis=1) > 0).mean() > 0.99)


def volume(mesh: Mesh) -> float:
    """Volume of a closed mesh by the divergence theorem."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


@given(SIZES, SIZES, SIZES, st.floats(0, 0.2), st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_a_rounded_box_fills_its_size(
    x: float, y: float, z: float, bevel: float, segments: int
) -> None:
    mesh = mesh_primitives.box((x, y, z), bevel, segments)
    extent = mesh.vertices.max(0) - mesh.vertices.min(0)
    np.testing.assert_allclose(extent, [x, y, z], rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert 0 < volume(mesh) <= x * y * z * 1.0001
    assert faces_point_outwards(mesh)


def test_a_lathed_rectangle_is_a_cylinder() -> None:
    mesh = mesh_primitives.lathe([(0, 0), (0.5, 0), (0.5, 2), (0, 2)], sides=128)
    # A prism of 128 sides lacks 0.04 % of the cylinder.
    assert volume(mesh) == pytest.approx(np.pi * 0.25 * 2, rel=1e-3)
    assert faces_point_outwards(mesh)


def test_an_ellipsoid_has_the_exact_volume() -> None:
    mesh = mesh_primitives.ellipsoid((0.3, 0.2, 0.1), sides=64, rings=32)
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.006, rel=1e-2)


def test_the_faces_of_a_tube_point_outwards() -> None:
    assert faces_point_outwards(
        mesh_primitives.tube(mesh_primitives.arc((0, 0, 0), 0.1, 0, np.pi), 0.01)
    )


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_a_shape_fits_its_size_and_its_faces_point_outwards(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        points = np.concatenate([visual.mesh.vertices for visual in shape.visuals])
        half = np.array([shape.size_m[0] / 2, shape.size_m[1] / 2])
        # Handles, feet and rug borders may protrude by a few centimetres.
        plain = name.removeprefix("ovmm ")
        hangs = plain in ("rug", "window", "picture", "plant", "door", "towel rail", "coat rack")
        wide = 0.09 if hangs else 0.04
        assert (np.abs(points[:, :2]).max(0) <= half + wide).all() or plain == "window"
        triangles = sum(len(visual.mesh.faces) for visual in shape.visuals)
        assert triangles < 7000
        for visual in shape.visuals:
            assert np.isfinite(visual.mesh.vertices).all()
            assert faces_point_outwards(visual.mesh)


@pytest.mark.parametrize("name", [*sorted(OBJECTS), *sorted(OVMM_THINGS)])
def test_an_object_is_graspable_and_its_origin_is_its_middle(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        assert 0.04 <= max(shape.size_m) <= (0.32 if name in OVMM_THINGS else 0.25)
        assert 0.02 < shape.mass_kg < 2.0
        points = np.concatenate([visual.mesh.vertices for visual in shape.visuals])
        np.testing.assert_allclose(points[:, 2].min(), -shape.size_m[2] / 2, atol=0.006)
        np.testing.assert_allclose(points[:, 2].max(), shape.size_m[2] / 2, atol=0.01)


@pytest.mark.parametrize("name", [*sorted(RECEPTACLES), *sorted(OVMM_FURNITURE)])
def test_a_surface_is_the_top_of_a_collision_primitive(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        assert shape.surfaces
        for surface in shape.surfaces:
            assert (0.07 if name in OVMM_FURNITURE else 0.3) <= surface.height_m <= 1.25
            tops = [
                s.center[2] + s.half_extent[1 if s.kind == "cylinder" else 2]
                for s in shape.collision_primitives
            ]
            assert min(abs(top - surface.height_m) for top in tops) < 1e-6


@pytest.mark.parametrize("name", sorted(OVMM_FURNITURE))
def test_the_space_above_a_surface_is_clear_as_specified(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        builder = ModelBuilder(visuals=False)
        body = builder.body("furniture")
        for solid in shape.collision_primitives:
            builder.solid(body, solid, "")
        model = builder.finish((-1, -1, 1, 1)).compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for surface in shape.surfaces:
            start = np.array([*surface.center_xy, surface.height_m + 0.002])
            up_m = ray(model, data, start, (0, 0, 1))
            assert up_m < 0 or up_m >= min(surface.clear_m, 0.5) - 0.01


def test_the_legs_of_chairs_and_stools_collide_and_the_space_between_is_empty() -> None:
    for make in (other_furniture_shapes.chair, other_furniture_shapes.stool):
        rng = np.random.default_rng(1)
        shape = make(rng, draw_palette(rng))
        builder = ModelBuilder(visuals=False)
        body = builder.body("seat")
        for solid in shape.collision_primitives:
            builder.solid(body, solid, "")
        model = builder.finish((-1, -1, 1, 1)).compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        hits = [
            ray(model, data, np.array([x, -1.0, 0.06]), (0, 1, 0)) >= 0
            for x in np.arange(-0.4, 0.4, 0.005)
        ]
        edges = sum(a != b for a, b in itertools.pairwise(hits))
        assert edges == 4, "two legs, one behind the other, with nothing between"
        assert 4 <= sum(hits) <= 24


def ray(model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray, to: tuple) -> float:
    """Distance to the first solid; negative if there is none."""
    geom = np.array([-1], dtype=np.int32)
    return float(mujoco.mj_ray(model, data, start, np.array(to, float), None, 1, -1, geom))


def test_every_texture_of_a_material_is_a_known_image() -> None:
    for name in textures.PATTERNS:
        image = textures.pattern(name)
        assert image.dtype == np.uint8
        assert image.shape[2] == 3
    used = {
        visual.material.texture
        for name in MAKERS
        for seed in range(2)
        for visual in make_shape(name, seed).visuals
    }
    assert used <= {"", *textures.PATTERNS}
