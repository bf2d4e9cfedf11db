"""Snapshots and robot positions as messages; `helios_core.map_snapshot` reads them."""

from __future__ import annotations

import threading

import numpy as np
from helios_core import proto as pb
from helios_core.codec import frame_id_to_proto, transform_from_proto
from helios_core.errors import InvalidInput
from helios_core.geometry import yaw_of
from helios_core.map_snapshot import OCCUPIED

from helios_map2d.snapshots.delta import frontier_messages
from helios_map2d.snapshots.snapshot import MapSnapshot
from helios_map2d.snapshots.tiles import in_mm, packed

Pose = tuple[float, float, float]  # x, y (m), yaw (rad) in the world


def reported_pose(message: pb.RobotState) -> Pose | None:
    """Where a robot says that it is; None while it does not know."""
    try:
        T_world_base = transform_from_proto(message.T_world_base, "T_world_base")
    except InvalidInput:
        return None
    return float(T_world_base[0, 3]), float(T_world_base[1, 3]), yaw_of(T_world_base)


def snapshot_to_proto(snapshot: MapSnapshot, layers: bool) -> pb.MapSnapshot:
    """The message of a version; without arrays, and with a cell size of 0, while nothing is known
    or nobody has said where the robot is.

    `explored` is what was seen since the search began, but `explored_m2` the area of all that is
    known; heights are sent in millimetres.
    """
    out = pb.MapSnapshot(
        version=snapshot.version, context_id=snapshot.context_id, map_id=snapshot.map_id
    )
    if snapshot.empty or snapshot.robot_pose is None:
        return out
    grid = snapshot.grid
    x_m, y_m, yaw_rad = snapshot.robot_pose
    if snapshot.frame_id is not None:
        out.id.CopyFrom(frame_id_to_proto(snapshot.frame_id))
    out.cell_m = grid.cell_m
    out.origin_x_m, out.origin_y_m = grid.origin_m
    out.height, out.width = grid.shape
    out.occupancy = packed(snapshot.occupancy)
    out.explored = packed(snapshot.explored_for_search)
    out.top_mm = packed(in_mm(snapshot.z_high_m))
    out.bottom_mm = packed(in_mm(snapshot.z_low_m))
    if layers:
        for name, value in snapshot.values.items():
            out.values[name] = packed(value.astype("<f2"))
    out.frontiers.extend(frontier_messages(snapshot))
    out.robot.CopyFrom(pb.Pose2(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    out.trajectory_m.extend(snapshot.trajectory_m.ravel().tolist())
    out.trajectory_starts.extend(snapshot.trajectory_starts)
    cell_m2 = grid.cell_m**2
    out.explored_m2 = float(np.count_nonzero(snapshot.known)) * cell_m2
    out.occupied_m2 = float(np.count_nonzero(snapshot.occupancy == OCCUPIED)) * cell_m2
    return out


class CachedEncoding:
    """The newest version's message, encoded once for all who ask; safe from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made: dict[bool, tuple[MapSnapshot, pb.MapSnapshot]] = {}

    def of(self, snapshot: MapSnapshot, layers: bool) -> pb.MapSnapshot:
        """The message of a version, made by whoever asks first."""
        with self._lock:
            made = self._made.get(layers)
            if made is None or made[0] is not snapshot:
                made = (snapshot, snapshot_to_proto(snapshot, layers))
                self._made[layers] = made
            return made[1]
