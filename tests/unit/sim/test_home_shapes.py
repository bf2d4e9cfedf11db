"""Claims about furniture, things and meshes."""

import numpy as np
import pytest
from helios_sim.home import meshes, textures
from helios_sim.home.catalog import FIXTURES, OBJECTS, RECEPTACLES
from helios_sim.home.palette import draw_palette
from helios_sim.home.types import Mesh, Shape
from hypothesis import given, settings
from hypothesis import strategies as st

MAKERS = {
    **{name: make for name, (_, make) in RECEPTACLES.items()},
    **FIXTURES,
    **{name: make for name, (make, _) in OBJECTS.items()},
}
SIZES = st.floats(0.02, 2.0)


def make_shape(name: str, seed: int) -> Shape:
    rng = np.random.default_rng(seed)
    return MAKERS[name](rng, draw_palette(rng))


def faces_look_outwards(mesh: Mesh) -> bool:
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    face = np.cross(b - a, c - a)
    mean = mesh.normals[mesh.faces].astype(np.float64).mean(axis=1)
    return bool(((face * mean).sum(axis=1) > 0).mean() > 0.99)


def volume(mesh: Mesh) -> float:
    """By the divergence theorem; that of a closed surface."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


@given(SIZES, SIZES, SIZES, st.floats(0, 0.2), st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_a_rounded_box_fills_its_size(
    x: float, y: float, z: float, bevel: float, segments: int
) -> None:
    mesh = meshes.box((x, y, z), bevel, segments)
    extent = mesh.vertices.max(0) - mesh.vertices.min(0)
    np.testing.assert_allclose(extent, [x, y, z], rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert 0 < volume(mesh) <= x * y * z * 1.0001
    assert faces_look_outwards(mesh)


def test_a_lathed_rectangle_is_a_cylinder() -> None:
    mesh = meshes.lathe([(0, 0), (0.5, 0), (0.5, 2), (0, 2)], sides=128)
    # A prism of 128 sides lacks 0.04 % of the cylinder.
    assert volume(mesh) == pytest.approx(np.pi * 0.25 * 2, rel=1e-3)
    assert faces_look_outwards(mesh)


def test_an_ellipsoid_has_its_volume() -> None:
    mesh = meshes.ellipsoid((0.3, 0.2, 0.1), sides=64, rings=32)
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.006, rel=1e-2)


def test_a_tube_looks_outwards() -> None:
    assert faces_look_outwards(meshes.tube(meshes.arc((0, 0, 0), 0.1, 0, np.pi), 0.01))


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_a_shape_fits_its_size_and_is_drawn_from_outside(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        points = np.concatenate([visual.mesh.vertices for visual in shape.visuals])
        half = np.array([shape.size_m[0] / 2, shape.size_m[1] / 2])
        # Handles, feet and rug borders may stand out by a few centimetres.
        wide = np.array([0.09, 0.09]) if name in ("rug", "window", "picture", "plant") else 0.04
        assert (np.abs(points[:, :2]).max(0) <= half + wide).all() or name == "window"
        triangles = sum(len(visual.mesh.faces) for visual in shape.visuals)
        assert triangles < 7000
        for visual in shape.visuals:
            assert np.isfinite(visual.mesh.vertices).all()
            assert faces_look_outwards(visual.mesh)


@pytest.mark.parametrize("name", sorted(OBJECTS))
def test_a_thing_can_be_grasped_and_its_origin_is_its_middle(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        assert 0.04 <= max(shape.size_m) <= 0.25
        assert shape.mass_kg > 0
        points = np.concatenate([visual.mesh.vertices for visual in shape.visuals])
        np.testing.assert_allclose(points[:, 2].min(), -shape.size_m[2] / 2, atol=0.004)
        np.testing.assert_allclose(points[:, 2].max(), shape.size_m[2] / 2, atol=0.008)


@pytest.mark.parametrize("name", sorted(RECEPTACLES))
def test_a_surface_is_the_top_of_a_solid(name: str) -> None:
    for seed in range(4):
        shape = make_shape(name, seed)
        assert shape.surfaces
        for surface in shape.surfaces:
            assert 0.3 <= surface.height_m <= 1.2
            tops = [
                s.center[2] + s.half_extent[1 if s.kind == "cylinder" else 2] for s in shape.solids
            ]
            assert min(abs(top - surface.height_m) for top in tops) < 1e-6


def test_every_pattern_is_a_picture_that_a_material_may_name() -> None:
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
