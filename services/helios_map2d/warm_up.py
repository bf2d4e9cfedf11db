"""Compile every kernel before the first frame: seconds when cold, milliseconds when cached."""

from __future__ import annotations

import numpy as np
from helios_core.geometry import Pinhole, camera_on_base
from helios_core.types import Frame, FrameId, Observation, SearchContext

from helios_map2d.state import MapRules, MapState


def warm_up() -> None:
    """Run a small map through everything once."""
    camera = Pinhole(32.0, 32.0, 31.5, 23.5, 64, 48)
    state = MapState(MapRules(size_cells=256), (0.0, 0.0), 0.2)
    state.reset_search(SearchContext("warm-up", (), {"pick": ""}))
    for seq in (1, 2):
        frame = Frame(
            FrameId("warm-up", 0, seq), seq, True, np.zeros((48, 64, 3), np.uint8),
            np.full((48, 64), 1.0, np.float32), camera,
            camera_on_base(np.eye(4), 1.0, 0.6), np.eye(4),
        )  # fmt: skip
        state.integrate_frame(frame)
        state.integrate_values(Observation(frame, "warm-up", (), {"pick": 0.5}, "warm-up"))
    state.snapshot().line_of_sight((0.0, 0.0, 1.0), (1.0, 0.5, 0.5))
