"""Compilation of all kernels before the first frame: seconds, or milliseconds from the cache."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helios_core.geometry import Pinhole, camera_on_base
from helios_core.types import Frame, FrameId, Observation, SearchContext

from helios_map2d.epoch_map import EpochMap
from helios_map2d.kernels.value_fusion import fuse_maximum
from helios_map2d.layers.frontiers import FrontierRules
from helios_map2d.layers.parameters import MapRules


def warm_up() -> None:
    """Run a small map through every kernel once."""
    camera = Pinhole(32.0, 32.0, 31.5, 23.5, 64, 48)
    rules = MapRules(size_cells=256, frontiers=FrontierRules(min_size_m=0.0))
    state = EpochMap(rules, (0.0, 0.0), 0.2)
    state.reset_search(SearchContext("warm-up", (), {"pick": ""}))
    for seq in (1, 2):
        frame = Frame(
            FrameId("warm-up", 0, seq),
            seq,
            True,
            np.zeros((48, 64, 3), np.uint8),
            np.full((48, 64), 1.0, np.float32),
            camera,
            camera_on_base(np.eye(4), 1.0, 0.6),
            np.eye(4),
        )
        state.integrate_frame(frame)
        state.integrate_values(Observation(frame, "warm-up", (), {"pick": 0.5}, "warm-up"))
    state.stack.frontiers.remember(
        tuple(replace(f, cells=f.cells[:-1]) for f in state.published.frontiers if len(f.cells) > 1)
    )
    state.publish_above(0)
    layer, spread = state.stack.values.layers["pick"], np.zeros((2, 2), np.float32)
    fuse_maximum(
        layer.value, layer.confidence, (0, 0), spread, (0, 0, 0, 0), np.float32(0), np.float32(0)
    )
    state.published.line_of_sight((0.0, 0.0, 1.0), (1.0, 0.5, 0.5))
    kept = state.published
    EpochMap(rules, (0.0, 0.0), 0.2).restore(kept.ground, kept.layers)  # as after a restart
