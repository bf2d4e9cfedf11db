"""A world that measures its own run time."""

from __future__ import annotations

import time
from typing import Any

from helios_core.health import Health
from helios_core.robot import Action, ActionResult, Capture
from helios_sim.ground_truth import Segmentation
from helios_sim.world import World


class TimedWorld(World):
    """World with time measurements and no other change.

    `health` has `world_act_ms`, `world_capture_ms` and `world_segmentation_ms`; `step_ms` holds the
    wall time from each action to the next.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.health = Health()
        self.step_ms: list[float] = []
        self._last_s: float | None = None

    def act(self, action: Action, action_id: str) -> ActionResult:
        began = time.perf_counter()
        if self._last_s is not None:
            self.step_ms.append((began - self._last_s) * 1e3)
        self._last_s = began
        result = super().act(action, action_id)
        self.health.sample("world_act_ms", (time.perf_counter() - began) * 1e3)
        return result

    def capture(self) -> Capture:
        began = time.perf_counter()
        capture = super().capture()
        self.health.sample("world_capture_ms", (time.perf_counter() - began) * 1e3)
        return capture

    def segmentation(self, stamp_ns: int) -> Segmentation:
        began = time.perf_counter()
        out = super().segmentation(stamp_ns)
        self.health.sample("world_segmentation_ms", (time.perf_counter() - began) * 1e3)
        return out
