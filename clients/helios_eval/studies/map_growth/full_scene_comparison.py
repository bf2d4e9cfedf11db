"""Objects only against the full scene, over one episode (Figure 4 of the paper).

The agent plays the episode with the map of objects. Its observations then go into two maps, frame
by frame: one models the detections of the task's classes, the other every pixel.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from numpy.typing import NDArray

from helios_eval.studies.map_growth.observation_log import Seen
from helios_eval.studies.map_growth.update_cost import NO_LIMIT

MAPS = {"objects only": False, "full scene": True}  # name -> setting full_scene


@dataclass(frozen=True)
class Growth:
    """Growth of one map over an episode; arrays have one entry per frame."""

    gaussians: NDArray[np.int64]
    mb: NDArray[np.float64]  # size of the arrays of all Gaussians
    cpu_ms: NDArray[np.float64]  # CPU time of the update, all threads

    def summary(self) -> dict[str, object]:
        """Values at the end; the time is the median over the frames."""
        return {
            "gaussians": int(self.gaussians[-1]),
            "mb": round(float(self.mb[-1]), 2),
            "cpu_ms_per_frame": round(float(np.median(self.cpu_ms)), 2),
        }


def measure(tape: Sequence[Seen]) -> dict[str, Growth]:
    """Growth of both maps over the frames of an episode."""
    return {name: _map(tape, full) for name, full in MAPS.items()}


def _map(tape: Sequence[Seen], full_scene: bool) -> Growth:
    grown = ObjectMap(ObjectMapSettings(stride_px=1, full_scene=full_scene, max_gaussians=NO_LIMIT))
    gaussians, mb, cpu_ms = [], [], []
    for seen in tape:
        began = time.process_time()
        grown.update(seen.observation, seen.context, seen.held)
        cpu_ms.append((time.process_time() - began) * 1e3)
        gaussians.append(len(grown))
        mb.append(sum(a.nbytes for a in grown.content().store.arrays().values()) / 1e6)
    return Growth(np.array(gaussians), np.array(mb), np.array(cpu_ms))
