"""Value layers against VLFM's formula."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_map2d.camera_view import View, view_of
from helios_map2d.grid import GridSpec
from helios_map2d.layers.value_layers import (
    Cone,
    ValueLayers,
    ValueRules,
    bin_directions,
    cone_of,
    values_near,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from map2d_scene import CAMERA, Walk, camera_pose, cast, room
from numpy.typing import NDArray

GRID = GridSpec.centred_on(2.0, 1.5, 0.05, 200)
ANGLES = st.floats(-math.pi, math.pi)


def seen_from(x: float, y: float, yaw: float, pitch_down: float = 0.0) -> View:
    pose = camera_pose(x, y, yaw, pitch_down)
    return view_of(cast(room(), pose), CAMERA, pose, GRID, 0.1, 5.0)


def vlfm_cone(view: View, x: float, y: float, yaw: float) -> NDArray[np.float64]:
    """VLFM's confidence, cell by cell, for a level camera: 0 outside the measured cone."""
    reach = np.minimum(view.depth_m.max(axis=0), view.max_depth_m)  # per image column
    half_fov = view.half_fov_rad
    r, c = np.indices(GRID.shape)
    px = GRID.origin_m[0] + (c + 0.5) * GRID.cell_m - x
    py = GRID.origin_m[1] + (r + 0.5) * GRID.cell_m - y
    forward = math.cos(yaw) * px + math.sin(yaw) * py
    left = -math.sin(yaw) * px + math.cos(yaw) * py
    u = CAMERA.cx - CAMERA.fx * left / np.where(forward > 0, forward, 1)
    inside = (forward > 0) & (u > -0.5) & (u < CAMERA.width - 0.5)
    limit = reach[np.where(inside, np.rint(u), 0).astype(int)]
    theta = np.arctan2(left, forward)
    cone = 0.25 + 0.75 * np.cos(theta / half_fov * math.pi / 2) ** 2
    cone[~inside | (forward > limit)] = 0
    return cone


def fused(
    value: NDArray[np.float64], old: NDArray[np.float64], new: NDArray[np.float64], score: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """VLFM's weighted average."""
    new = np.where((new < 0.35) & (new < old - 1e-6), 0, new)
    total = old + new
    with np.errstate(invalid="ignore"):
        averaged = np.where(new > 0, (old * value + new * score) / total, value)
        confidence = np.where(new > 0, (old**2 + new**2) / total, old)
    return averaged, confidence


@settings(max_examples=6, deadline=None)
@example([(0.90625, 0.0), (0.0, 0.0), (0.1953125, 1.0)])  # one rim crosses the others' cones
@example([(0.0, 0.0), (1e-05, 0.0), (0.0, 1.0)])  # confidences that differ by rounding alone
@given(st.lists(st.tuples(ANGLES, st.floats(-1, 1)), min_size=1, max_size=3))
def test_fusion_equals_vlfms_formula_for_a_level_camera(looks: list[tuple[float, float]]) -> None:
    layers = ValueLayers(GRID, ValueRules())
    layers.reset(("pick",))
    value, confidence = np.zeros(GRID.shape), np.zeros(GRID.shape)
    # Both may differ on the rim of each cone, where a cell's centre falls beside the last pixel.
    rim = np.zeros(GRID.shape, bool)
    # A low confidence that equals the old one to rounding may count in one and not in the other.
    undecided = np.zeros(GRID.shape, bool)
    for yaw, score in looks:
        view, alone = seen_from(2.0, 1.5, yaw), ValueLayers(GRID, ValueRules())
        cone = vlfm_cone(view, 2.0, 1.5, yaw)
        alone.reset(("pick",))
        alone.integrate(cone_of(view), {"pick": score})
        rim |= (alone.layers["pick"].confidence > 0) != (cone > 0)
        undecided |= (cone < 0.35 + 1e-5) & (abs(cone - confidence) < 1e-5)
        layers.integrate(cone_of(view), {"pick": score})
        value, confidence = fused(value, confidence, cone, score)
    got = layers.layers["pick"]
    both = (got.confidence > 0) & (confidence > 0) & ~rim & ~undecided
    assert rim.sum() <= 0.06 * both.sum() * len(looks)
    off = abs(got.confidence - confidence)[both] > 1e-4
    assert off.mean() <= 0.05
    np.testing.assert_allclose(got.value[both][~off], value[both][~off], atol=1e-4)


@pytest.mark.parametrize("pitch_deg", [0, 30, 60])
def test_values_stop_at_the_walls_at_any_camera_pitch(pitch_deg: int) -> None:
    layers = ValueLayers(GRID, ValueRules())
    for k in range(12):
        layers.integrate(
            cone_of(seen_from(2.0, 1.5, k * math.pi / 6, math.radians(pitch_deg))), {"a": 0.5}
        )
    rows, columns = np.nonzero(layers.layers["a"].confidence)
    x = GRID.origin_m[0] + (columns + 0.5) * GRID.cell_m
    y = GRID.origin_m[1] + (rows + 0.5) * GRID.cell_m
    assert len(x) > 300
    assert x.min() > -0.05
    assert x.max() < 4.05
    assert y.min() > -0.05
    assert y.max() < 3.05


def test_value_layers_are_independent_of_each_other() -> None:
    layers = ValueLayers(GRID, ValueRules())
    layers.integrate(cone_of(seen_from(2.0, 1.5, 0.0)), {"pick": 0.3, "place": 0.1, "a third": 0.9})
    row, column = GRID.cell_of(3.0, 1.5)
    got = {name: round(float(layer.value[row, column]), 3) for name, layer in layers.layers.items()}
    assert got == {"pick": 0.3, "place": 0.1, "a third": 0.9}
    layers.reset(("pick",))
    assert list(layers.layers) == ["pick"]
    assert not layers.layers["pick"].value.any()


@given(st.floats(-1, 1), st.integers(1, 6))
def test_a_repeated_score_does_not_change_the_value(score: float, times: int) -> None:
    layers = ValueLayers(GRID, ValueRules())
    view = SAME_VIEW
    for _ in range(times):
        layers.integrate(cone_of(view), {"pick": score})
    layer = layers.layers["pick"]
    assert layer.value[layer.confidence > 0] == pytest.approx(score, abs=1e-5)


@given(st.lists(st.tuples(ANGLES, st.floats(-1, 1)), min_size=1, max_size=4))
@example([(0.0, 0.0), (1.2e-07, 1.0)])
@settings(max_examples=10, deadline=None)
def test_maximum_fusion_keeps_the_score_of_the_most_confident_view(
    looks: list[tuple[float, float]],
) -> None:
    layers = ValueLayers(GRID, ValueRules(fusion="maximum"))
    alone = []
    for yaw, score in looks:
        cone = cone_of(seen_from(2.0, 1.5, yaw))
        layers.integrate(cone, {"pick": score})
        single = ValueLayers(GRID, ValueRules())
        single.integrate(cone, {"pick": score})
        alone.append(single.layers["pick"].confidence)
    got, stack = layers.layers["pick"], np.stack(alone)
    np.testing.assert_allclose(got.confidence, stack.max(axis=0), atol=1e-6)
    most = stack >= stack.max(axis=0) - 1e-5  # two views may be equally confident
    scores = np.array([score for _, score in looks])[:, None, None]
    decided = (most & (abs(scores - got.value) <= 1e-6)).any(axis=0)
    assert decided[got.confidence > 0].all()


def test_an_unknown_fusion_is_refused() -> None:
    with pytest.raises(InvalidInput, match="no value fusion is called 'mean'"):
        ValueRules(fusion="mean")


def test_a_score_that_is_not_finite_is_refused_and_changes_nothing() -> None:
    layers = ValueLayers(GRID, ValueRules())
    with pytest.raises(InvalidInput, match="score of layer 'place' is nan"):
        layers.integrate(cone_of(SAME_VIEW), {"pick": 0.5, "place": math.nan})
    assert not layers.layers


def test_a_view_without_depth_changes_nothing() -> None:
    frame = Walk(room()).frame(2.0, 1.5, 0.0)
    depth = np.full_like(frame.depth_m, np.nan)
    layers = ValueLayers(GRID, ValueRules())
    layers.integrate(
        cone_of(view_of(depth, CAMERA, frame.T_world_cam, GRID, 0.1, 5.0)), {"pick": 0.5}
    )
    assert not layers.layers["pick"].confidence.any()


def test_depth_beyond_the_maximum_counts_as_the_maximum() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 7.0, np.float32)
    cone = cone_of(view_of(depth, CAMERA, camera_pose(2.0, 1.5, 0.0, 0.0), GRID, 0.1, 5.0))
    assert cone.reach_m[len(cone.reach_m) // 2] == pytest.approx(5.0, abs=0.01)


def test_a_direction_between_two_pixels_reaches_as_far_as_the_nearer_one() -> None:
    reach = np.zeros(40, np.float32)
    reach[[18, 20]] = 3.0, 1.5
    layers = ValueLayers(GRID, ValueRules())
    layers.integrate(Cone(0.0, 0.0, (1.0, 0.0), 1.0, reach), {"pick": 0.5})
    ahead, left = bin_directions(40)[:, 19]
    seen = [
        bool(layers.layers["pick"].confidence[GRID.cell_of(r * ahead, r * left)])
        for r in (1.2, 2.2)
    ]
    assert seen == [True, False]


def test_the_value_near_a_place_without_values_is_zero() -> None:
    nothing = np.zeros((20, 20), np.float32)
    assert values_near(nothing, np.array([[3, 3], [19, 0]], np.int32), 5.0).tolist() == [0.0, 0.0]


SAME_VIEW = seen_from(2.0, 1.5, 0.3, 0.4)
