"""Requests of the newest 2D map by those who hold a copy, and what a display shows once it is gone.
No I/O.

Versions begin anew when map2d restarts without a state folder. So a map is the one held only if
its id is the same, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from helios_core import proto as pb
from helios_core.map_snapshot import UNKNOWN, MapView

Answer = TypeVar("Answer", pb.MapSnapshot, pb.MapSnapshot | None)  # None: no answer came


def newest_snapshot(
    ask: Callable[[pb.SnapshotRequest], Answer],
    version: int,
    map_id: str,
    ground_only: bool = False,
) -> Answer:
    """Newest map; `unchanged`, without arrays, if it is the one held.

    ask: calls map2d. version, map_id: of the map held; 0 and "" without one. ground_only: without
    layers, and fast, for a planner. An unchanged reply without an id, which an earlier map2d
    sends, counts as the map held.
    """
    request = pb.SnapshotRequest(layers=not ground_only, if_newer=version, ground_only=ground_only)
    reply = ask(request)
    if reply is not None and reply.unchanged and reply.map_id not in ("", map_id):
        request.if_newer = 0
        return ask(request)
    return reply


def is_empty(snapshot: pb.MapSnapshot) -> bool:
    """True if a reply has no cells, as after a reset. An unchanged reply has none either."""
    return not snapshot.width * snapshot.height


def blank_map(view: MapView) -> MapView:
    """Map of one unknown cell, at the corner of `view`, which takes its place in a display."""
    return replace(
        view, version=0, map_id="", context_id="", occupancy=np.full((1, 1), UNKNOWN, np.int8),
        explored=np.zeros((1, 1), np.bool_), top_m=np.zeros((1, 1), np.float32),
        values=MappingProxyType({}), frontiers=(), trajectory_m=np.zeros((0, 2), np.float32),
        trajectory_starts=(), explored_m2=0.0, occupied_m2=0.0,
    )  # fmt: skip
