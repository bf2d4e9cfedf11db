"""Every back end of the renderer against a float64 reference from the paper (eq. 1)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from helios_core.errors import Unavailable
from helios_objectmap.camera import View
from helios_objectmap.rendering import cpu, cuda
from helios_objectmap.rendering.back_ends import back_end
from helios_objectmap.rendering.kernels import QUADRATIC_UU, QUADRATIC_UV, QUADRATIC_VV
from helios_objectmap.rendering.renderer_interface import LOW_PASS_PX2, NEAR_M, Project
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

VIEW = View(60.0, 60.0, 23.5, 17.5, 48, 36, np.eye(4))
# An alpha near 1/255 may be dropped on one side and kept on the other: three such per pixel.
KAPPA_TOLERANCE = 3 / 255
DEPTH_TOLERANCE_M = KAPPA_TOLERANCE * 3.5 / 0.5  # depths 0.5 to 4 m, coverage over a half


@pytest.fixture(scope="module", params=["cpu", "cuda", "cuda without gsplat"])
def project(request) -> Iterator[Project]:
    """Each back end. The last is the CUDA back end on the CPU, with a stand-in for gsplat."""
    if request.param == "cuda without gsplat":
        pytest.importorskip("torch", reason="the back end for CUDA is written in torch")
        import gsplat_in_torch

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cuda, "DEVICE", "cpu")
            patch.setattr(cuda, "_gsplat", lambda: gsplat_in_torch)
            yield cuda.project
        return
    try:
        chosen = back_end(request.param)
    except Unavailable as reason:
        pytest.skip(str(reason))
    yield chosen


def reference_kappa(
    means: NDArray[np.float32],
    radius: NDArray[np.float32],
    opacity: NDArray[np.float32],
    view: View,
) -> NDArray[np.float64]:
    """kappa [h, w, n] in float64, pixel by pixel in closed form: eq. 1 with nothing left out."""
    n = len(means)
    p = means.astype(np.float64) @ view.T_cam_world[:3, :3].T + view.T_cam_world[:3, 3]
    v, u = np.mgrid[: view.height, : view.width].astype(np.float64)
    kappa = np.zeros((view.height, view.width, n))
    light = np.ones((view.height, view.width))
    for g in np.argsort(p[:, 2], kind="stable"):
        x, y, z = p[g]
        if z <= NEAR_M:
            continue
        J = np.array([[view.fx / z, 0, -view.fx * x / z**2], [0, view.fy / z, -view.fy * y / z**2]])
        cov = J @ (radius[g].astype(np.float64) ** 2 * np.eye(3)) @ J.T
        inverse = np.linalg.inv(cov + LOW_PASS_PX2 * np.eye(2))
        d = np.stack([u - (view.fx * x / z + view.cx), v - (view.fy * y / z + view.cy)], axis=-1)
        alpha = float(opacity[g]) * np.exp(-0.5 * np.einsum("hwi,ij,hwj->hw", d, inverse, d))
        alpha = np.where(alpha < 1 / 255, 0, np.minimum(alpha, 0.999))
        kappa[..., g] = alpha * light
        light *= 1 - alpha
    return kappa


@st.composite
def scenes(draw: st.DrawFn, most: int = 60):
    n = draw(st.integers(1, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    z = rng.uniform(0.5, 4.0, n)
    means = np.stack([rng.uniform(-0.5, 0.5, n) * z, rng.uniform(-0.4, 0.4, n) * z, z], axis=1)
    radius = rng.uniform(0.3, 3.0, n) * z / VIEW.fx
    opacity = rng.uniform(0.1, 0.999, n)
    return tuple(np.ascontiguousarray(a, np.float32) for a in (means, radius, opacity))


@settings(max_examples=15, deadline=None)
@given(scene=scenes())
def test_rendered_depth_coverage_and_features_match_the_reference(project, scene):
    means, radius, opacity = scene
    features = np.random.default_rng(0).uniform(0, 1, (len(means), 3)).astype(np.float32)
    projection = project(means, radius, opacity, VIEW)
    rendering = projection.render(features[projection.rows])
    kappa = reference_kappa(means, radius, opacity, VIEW)
    assert np.abs(rendering.coverage - kappa.sum(-1)).max() < KAPPA_TOLERANCE
    expected = np.einsum("hwn,nc->chw", kappa, features)
    assert np.abs(rendering.features - expected).max() < KAPPA_TOLERANCE
    solid = kappa.sum(-1) > 0.5
    depth = (kappa @ means[:, 2].astype(np.float64))[solid] / kappa.sum(-1)[solid]
    assert np.abs(rendering.depth_m[solid] - depth).max(initial=0) < DEPTH_TOLERANCE_M


@settings(max_examples=15, deadline=None)
@given(scene=scenes(), seed=st.integers(0, 2**32 - 1))
def test_kappa_sums_match_the_reference(project, scene, seed):
    means, radius, opacity = scene
    labels = np.random.default_rng(seed).integers(-1, 3, (VIEW.height, VIEW.width)).astype(np.int32)
    projection = project(means, radius, opacity, VIEW)
    sums = np.zeros((len(means), 3), np.float32)
    sums[projection.rows] = projection.kappa_sums(labels, 3)
    kappa = reference_kappa(means, radius, opacity, VIEW)
    expected = np.stack([kappa[labels == c].sum(axis=0) for c in range(3)], axis=1)
    # The sums cover up to hundreds of pixels, so the tolerance is relative.
    assert np.allclose(sums, expected, rtol=5e-3, atol=0.05)


@settings(max_examples=15, deadline=None)
@given(scene=scenes())
def test_kappa_of_a_pixel_sums_to_at_most_one(project, scene):
    means, radius, opacity = scene
    rendering = project(means, radius, opacity, VIEW).render()
    assert rendering.coverage.min() >= 0
    assert rendering.coverage.max() <= 1 + 1e-6


@settings(max_examples=15, deadline=None)
@given(scene=scenes(), seed=st.integers(0, 2**32 - 1))
def test_order_of_gaussians_and_equal_depths_do_not_change_a_pixel(project, scene, seed):
    means, radius, opacity = scene
    means[:, 2] = np.round(means[:, 2], 1)  # many equal depths
    features = np.random.default_rng(1).uniform(0, 1, (len(means), 2)).astype(np.float32)
    shuffled = np.random.default_rng(seed).permutation(len(means))
    one = project(means, radius, opacity, VIEW)
    a = one.render(features[one.rows])
    other = project(means[shuffled], radius[shuffled], opacity[shuffled], VIEW)
    b = other.render(features[shuffled][other.rows])
    assert np.array_equal(a.features, b.features)
    assert np.array_equal(a.depth_m, b.depth_m)


@settings(max_examples=8, deadline=None)
@given(scene=scenes(25), seed=st.integers(0, 2**32 - 1))
def test_an_updated_projection_equals_a_new_one_of_the_remaining_and_added_gaussians(
    project, scene, seed
):
    means, radius, opacity = scene
    means[:, 2] = np.round(means[:, 2], 1)  # many equal depths
    rng = np.random.default_rng(seed)
    n = len(means)
    at_first, later, gone = rng.random(n) < 0.6, rng.random(n) < 0.6, rng.random(n) < 0.3
    later &= ~at_first | gone  # some are removed and added again

    def of(chosen):
        rows = np.flatnonzero(chosen).astype(np.int32)
        return project(means, radius, opacity, VIEW, rows)

    before = of(at_first)
    renewed = before.renewed(np.flatnonzero(gone[before.rows]), of(later))
    afresh = of(at_first & ~gone | later)
    assert set(renewed.rows.tolist()) == set(afresh.rows.tolist())
    features = rng.uniform(0, 1, (n, 2)).astype(np.float32)
    a, b = renewed.render(features[renewed.rows]), afresh.render(features[afresh.rows])
    assert np.array_equal(a.features, b.features)
    assert np.array_equal(a.depth_m, b.depth_m)
    labels = rng.integers(-1, 3, (VIEW.height, VIEW.width)).astype(np.int32)
    sums = np.zeros((2, n, 3), np.float32)
    for out, projection in zip(sums, (renewed, afresh), strict=True):
        out[projection.rows] = projection.kappa_sums(labels, 3)
    # Both add the same numbers in the order of the tiles.
    assert np.allclose(sums[0], sums[1], rtol=1e-6, atol=1e-6)


def test_gaussian_behind_the_camera_or_outside_the_image_is_not_visible(project):
    means = np.array([[0, 0, -1], [50, 0, 1], [0, 0, 1]], np.float32)
    radius, opacity = np.full(3, 0.02, np.float32), np.full(3, 0.9, np.float32)
    assert project(means, radius, opacity, VIEW).rows.tolist() == [2]


def test_an_empty_map_renders_as_nothing(project):
    empty = np.empty(0, np.float32)
    rendering = project(np.empty((0, 3), np.float32), empty, empty, VIEW).render()
    assert not rendering.coverage.any()
    assert not rendering.depth_m.any()


def test_neither_chunk_borders_nor_finished_rows_change_the_rendering(project):
    """Hundreds of layers cover the same pixels, more than are blended at a time."""
    rng = np.random.default_rng(3)
    n = 700
    z = rng.uniform(1.0, 4.0, n)
    means = np.stack([rng.uniform(-0.4, 0.4, n) * z, rng.uniform(-0.3, 0.3, n) * z, z], axis=1)
    radius = (rng.uniform(1.0, 4.0, n) * z / VIEW.fx).astype(np.float32)
    opacity = rng.uniform(0.02, 0.5, n).astype(np.float32)
    features = rng.uniform(0, 1, (n, 18)).astype(np.float32)
    projection = project(means.astype(np.float32), radius, opacity, VIEW)
    rendering = projection.render(features[projection.rows])
    kappa = reference_kappa(means.astype(np.float32), radius, opacity, VIEW)
    # The weakest of 700 end at 1/255 in thousands of pixels: some fall on the other side.
    assert np.abs(rendering.coverage - kappa.sum(-1)).max() < KAPPA_TOLERANCE
    expected = np.einsum("hwn,nc->chw", kappa, features)
    assert np.abs(rendering.features - expected).max() < KAPPA_TOLERANCE
    labels = np.zeros((VIEW.height, VIEW.width), np.int32)
    sums = np.zeros((n, 1), np.float32)
    sums[projection.rows] = projection.kappa_sums(labels, 1)
    assert np.allclose(sums[:, 0], kappa.sum(axis=(0, 1)), rtol=5e-3, atol=0.05)


def test_the_cuda_projection_equals_the_cpu_projection():
    """The plain torch part of the CUDA back end runs on any device."""
    pytest.importorskip("torch", reason="the projection for CUDA is written in torch")

    rng = np.random.default_rng(5)
    n = 400
    z = rng.uniform(-1.0, 6.0, n)
    means = np.stack([rng.uniform(-1, 1, n) * z, rng.uniform(-1, 1, n) * z, z], axis=1)
    means = means.astype(np.float32)
    radius = rng.uniform(0.002, 0.1, n).astype(np.float32)
    opacity = rng.uniform(0.001, 0.9999, n).astype(np.float32)
    rows = rng.permutation(n)[: n // 2].astype(np.int32)
    ours = cpu.project(means, radius, opacity, VIEW, rows, far_m=5.0)
    theirs = cuda.splats_of(means, radius, opacity, VIEW, rows, 5.0, "cpu")
    assert 20 < len(ours.rows) < len(rows)
    assert theirs.rows.tolist() == ours.rows.tolist()
    assert np.allclose(theirs.uv.numpy(), ours.uv, atol=1e-3)
    assert np.allclose(theirs.depth_m.numpy(), ours.depth_m, atol=1e-5)
    # Conics in gsplat's form: alpha = opacity * exp(-(a du^2 + c dv^2) / 2 - b du dv).
    columns = ours.splats[:, [QUADRATIC_UU, QUADRATIC_UV, QUADRATIC_VV]]
    natural = columns * np.log(2) * np.array([-2, -1, -2], np.float32)
    assert np.allclose(theirs.conics.numpy(), natural, rtol=1e-4, atol=1e-5)


def test_the_cuda_setting_without_gsplat_says_what_to_install(monkeypatch):
    def missing():
        raise ImportError("No module named 'gsplat'")

    monkeypatch.setattr(cuda, "_gsplat", missing)
    with pytest.raises(Unavailable, match=r"pip install 'helios-ovmm\[cuda\]'"):
        back_end("cuda")


def test_a_strided_view_samples_the_same_rays():
    view = View(525.0, 525.0, 320.0, 240.0, 640, 480, np.eye(4))
    half = view.strided(2)
    depth = np.full((240, 320), 2.0, np.float32)
    mask = np.zeros((240, 320), bool)
    mask[10, 20] = True
    full_mask = np.zeros((480, 640), bool)
    full_mask[21, 41] = True
    full = view.lift(np.full((480, 640), 2.0, np.float32), full_mask)
    assert np.allclose(half.lift(depth, mask), full)
