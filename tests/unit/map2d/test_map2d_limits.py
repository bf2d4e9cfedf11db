"""Maps contain no NaN for any robot size, any cell size and frames from any pose."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.types import Frame, FrameId, Observation, SearchContext
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.frontiers import FrontierRules
from helios_map2d.layers.parameters import MapRules
from helios_map2d.snapshots.path_cost import cost_along
from hypothesis import given, settings
from hypothesis import strategies as st

CAMERA = Pinhole(fx=20.0, fy=20.0, cx=15.5, cy=11.5, width=32, height=24)
poses = st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-math.pi, math.pi))


@st.composite
def depths_m(draw: st.DrawFn) -> np.ndarray:
    """No depth, a wall at the lens, a distant wall or random depth, with holes of invalid depth."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    near, far = draw(st.sampled_from([(0.0, 0.0), (0.05, 0.05), (0.3, 6.0), (1.0, 1.0), (9, 9)]))
    out = rng.uniform(near, far, (CAMERA.height, CAMERA.width))
    holes = rng.random(out.shape) < draw(st.sampled_from([0.0, 0.3, 1.0]))
    return np.where(holes, draw(st.sampled_from([0.0, math.nan, math.inf])), out).astype(np.float32)


@settings(max_examples=120, deadline=None)
@given(st.data())
def test_maps_of_random_frames_contain_no_nan(data: st.DataObject) -> None:
    cell_m, footprint_m = data.draw(st.floats(0.02, 0.1)), data.draw(st.floats(0.1, 0.6))
    rules = MapRules(
        cell_m=cell_m,
        size_cells=64,
        frontiers=replace(FrontierRules(), robot_radius_m=footprint_m, min_size_m=0.0),
        explored_by_cone=data.draw(st.booleans()),
    )
    state = EpochMap(rules, data.draw(poses)[:2], data.draw(st.sampled_from([0.0, footprint_m])))
    state.reset_search(SearchContext("search", (), {"pick": "a mug"}))
    for seq in range(1, data.draw(st.integers(1, 4)) + 1):
        base = se2_to_se3(*data.draw(poses))
        tilt_rad = data.draw(st.floats(-1.5, 1.5))
        frame = Frame(
            FrameId("boot", 0, seq),
            seq,
            True,
            np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8),
            data.draw(depths_m()),
            CAMERA,
            camera_on_base(base, data.draw(st.floats(0.1, 2.0)), tilt_rad, 0.1),
            base,
        )
        state.integrate_frame(frame)
        score = data.draw(st.floats(0, 1))
        state.integrate_values(Observation(frame, "search", (), {"pick": score}, "test"))
        reported = state.published
        shape = reported.occupancy.shape
        assert min(shape) >= 1
        assert set(np.unique(reported.occupancy)) <= {-1, 0, 100}
        for layer in (reported.z_low_m, reported.z_high_m, reported.values["pick"]):
            assert layer.shape == shape
            assert np.isfinite(layer).all()
        for frontier in reported.frontiers:
            assert np.isfinite([*frontier.centre_m, frontier.size_m]).all()
            assert np.isfinite(list(frontier.values.values())).all()
        ends = np.array([data.draw(poses)[:2], data.draw(poses)[:2]])
        cost = cost_along(reported, ends, footprint_m, 0.5)
        assert np.isfinite([cost.length_m, cost.least_clearance_m, cost.unknown_m]).all()
        assert not math.isnan(cost.cost_m)
        eye, target = ((*xy, data.draw(st.floats(0, 2))) for xy in ends.tolist())
        assert reported.line_of_sight(eye, target) in (True, False)
