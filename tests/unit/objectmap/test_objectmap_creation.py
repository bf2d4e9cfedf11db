"""Creation, free-space carving and re-observation of Gaussians."""

from __future__ import annotations

import numpy as np
from helios_objectmap.camera import View
from helios_objectmap.fusion import geometry
from helios_objectmap.fusion.geometry import compare_with_depth, reobserved
from helios_objectmap.rendering import cpu
from helios_objectmap.rendering.renderer_interface import Projection, Rendering

SHAPE = (24, 32)
VIEW = View(30.0, 30.0, 15.5, 11.5, 32, 24, np.eye(4))
EVERYWHERE = np.ones(SHAPE, bool)


def rendering(depth_m: float, coverage: float = 1.0) -> Rendering:
    return Rendering(
        np.full(SHAPE, depth_m, np.float32),
        np.full(SHAPE, coverage, np.float32),
        np.zeros((0, *SHAPE), np.float32),
    )


def measured(depth_m: float):
    return np.full(SHAPE, depth_m, np.float32)


def test_gaussians_are_created_where_nothing_is_modelled_and_depth_is_valid():
    depth = measured(2.0)
    depth[3, 4] = 0
    mask = geometry.creation_mask(depth, rendering(0.0, coverage=0.0), EVERYWHERE, 0.05)
    assert mask.sum() == mask.size - 1
    assert not mask[3, 4]


def test_depth_noise_on_a_modelled_surface_creates_no_gaussians():
    noisy = measured(2.0) + np.random.default_rng(0).normal(0, 0.013, SHAPE).astype(np.float32)
    assert not geometry.creation_mask(noisy, rendering(2.0), EVERYWHERE, 0.05).any()
    assert geometry.paper_creation_mask(noisy, rendering(2.0), EVERYWHERE).any()


def test_gaussians_are_created_on_a_surface_in_front_of_the_model_and_not_behind():
    assert geometry.creation_mask(measured(1.9), rendering(2.0), EVERYWHERE, 0.05).any()
    assert not geometry.creation_mask(measured(2.1), rendering(2.0), EVERYWHERE, 0.05).any()


def test_the_papers_rule_keeps_errors_over_a_metre_and_eroded_ones_over_a_millimetre():
    depth = measured(2.0)
    depth[5, 5] = 2.01  # a single pixel does not survive the erosion
    depth[10, 10] = 3.5
    depth[15:18, 15:18] = 2.01
    mask = geometry.paper_creation_mask(depth, rendering(2.0), EVERYWHERE)
    assert {tuple(p) for p in np.argwhere(mask)} == {(10, 10), (16, 16)}


def one_gaussian(z: float) -> Projection:
    mean = np.array([[0, 0, z]], np.float32)
    return cpu.project(mean, np.array([0.03], np.float32), np.array([0.99], np.float32), VIEW)


def through(z: float, depth, front_m: float = 0.10) -> list[int]:
    return compare_with_depth(one_gaussian(z), depth, front_m).through.tolist()


def test_a_gaussian_is_seen_through_only_if_depth_is_over_10_cm_behind():
    assert through(1.0, measured(1.2)) == [0]
    assert not through(1.0, measured(1.08))
    assert not through(1.0, measured(0.5))


def test_a_gaussian_is_confirmed_only_by_a_measured_surface_at_its_depth():
    assert compare_with_depth(one_gaussian(1.0), measured(1.05), 0.10).there.tolist() == [0]
    for depth_m in (0.5, 1.2, 0.0):
        assert not len(compare_with_depth(one_gaussian(1.0), measured(depth_m), 0.10).there)


def test_invalid_depth_or_a_depth_edge_does_not_carve_a_gaussian():
    assert not through(1.0, measured(0.0))
    depth = measured(2.0)
    depth[12, 17] = 1.0  # a neighbour still shows the surface
    assert not through(1.0, depth)


def test_depth_noise_far_away_does_not_carve_a_gaussian():
    # At 5 m the noise is 4 cm: 15 cm of difference is no evidence.
    assert not through(5.0, measured(5.15))


def test_pixels_within_half_a_metre_are_reobserved_and_occluded_ones_are_not():
    nothing = np.zeros(SHAPE, bool)
    assert reobserved(measured(2.4), rendering(2.0), nothing, 0.5, 5).all()
    assert not reobserved(measured(1.4), rendering(2.0), nothing, 0.5, 5).any()


def test_reobservation_closes_small_holes_but_never_counts_invalid_depth():
    depth = measured(2.0)
    depth[10, 10] = 3.0  # a hole of one pixel
    depth[5, 5] = 0
    mask = reobserved(depth, rendering(2.0), np.zeros(SHAPE, bool), 0.5, 5)
    assert mask[10, 10]
    assert not mask[5, 5]


def test_pixels_with_new_gaussians_count_as_reobserved():
    created = np.zeros(SHAPE, bool)
    created[3:6, 3:6] = True
    assert np.array_equal(
        reobserved(measured(2.0), rendering(0.0, coverage=0.0), created, 0.5, 1), created
    )
