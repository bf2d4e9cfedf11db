"""Cost of an update while the map grows: the same homes repeatedly, each time elsewhere.

Every lap shows the same images at places that are new to the map. A frame of the last lap thus
differs from that of the first one only in the size of the map.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from numpy.typing import NDArray

from helios_eval.studies.map_growth.simulated_walk import Walk, context_of

SPACING_M = 30.0  # between homes, so that none is in view from another
NO_LIMIT = 100_000_000  # Gaussians


@dataclass(frozen=True)
class Cost:
    """Measurements per frame, as arrays [laps, frames of a lap]."""

    cpu_ms: NDArray[np.float64]  # CPU time of the update, all threads
    in_view: NDArray[np.int64]
    mapped: NDArray[np.int64]

    @property
    def ratio(self) -> float:
        """Median over the frames: cost in the last lap divided by cost in the second.

        The first lap is left out, since the first use of memory costs more.
        """
        return float(np.median(self.cpu_ms[-1] / self.cpu_ms[min(1, len(self.cpu_ms) - 1)]))

    def summary(self) -> dict[str, object]:
        """Values for the report."""
        lap_ms = np.median(self.cpu_ms, axis=1)
        return {
            "frames": self.cpu_ms.size,
            "laps": len(self.cpu_ms),
            "gaussians_first_lap": int(self.mapped[0, -1]),
            "gaussians_last_lap": int(self.mapped[-1, -1]),
            "in_view_median": int(np.median(self.in_view)),
            "lap_cpu_ms": [round(float(ms), 2) for ms in lap_ms],
            "last_by_second_lap": round(self.ratio, 3),
        }


def measure(walks: Sequence[Walk], frames: int, say: Callable[[str], object] = print) -> Cost:
    """Map `frames` frames, rounded up to whole laps through all walks."""
    lap_length = sum(len(walk.observations) for walk in walks)
    laps = -(-frames // lap_length)
    grown = ObjectMap(ObjectMapSettings(stride_px=1, max_gaussians=NO_LIMIT))
    cpu_ms = np.empty((laps, lap_length))
    in_view, mapped = (np.empty((laps, lap_length), np.int64) for _ in range(2))
    for lap in range(laps):
        k = 0
        for number, walk in enumerate(walks):
            context = context_of(f"walk {number}", walk.receptacles, walk.things)
            x_m = (lap * len(walks) + number) * SPACING_M
            for observation in walk.again(x_m, lap * lap_length + k, context.id):
                began = time.process_time()
                report = grown.update(observation, context)
                cpu_ms[lap, k] = (time.process_time() - began) * 1e3
                in_view[lap, k], mapped[lap, k] = report.in_view, report.total
                k += 1
        say(
            f"lap {lap + 1} of {laps}: {len(grown)} Gaussians, an update "
            f"{np.median(cpu_ms[lap]):.1f} ms of CPU, {np.median(in_view[lap]):.0f} in view"
        )
    return Cost(cpu_ms, in_view, mapped)
