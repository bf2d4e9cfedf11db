"""Conversion of snapshots and robot poses to and from protobuf messages.

`helios_core.map_snapshot` decodes the snapshots.
"""

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
from helios_map2d.snapshots.tiles import in_mm, packed, stored

Pose = tuple[float, float, float]  # x, y (m), yaw (rad) in the world


def reported_pose(message: pb.RobotState) -> Pose | None:
    """Pose in a robot's state; None if the pose is not valid."""
    try:
        T_world_base = transform_from_proto(message.T_world_base, "T_world_base")
    except InvalidInput:
        return None
    return float(T_world_base[0, 3]), float(T_world_base[1, 3]), yaw_of(T_world_base)


def snapshot_to_proto(
    snapshot: MapSnapshot, layers: bool, ground_only: bool = False
) -> pb.MapSnapshot:
    """Message of a version; without arrays and with cell size 0 if the map is empty or the robot's
    pose is not known.

    ground_only: the part for a planner, see `SnapshotRequest`. `explored` is the area seen since
    the search began, but `explored_m2` is the area of all known cells; heights are in millimetres.
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
    if ground_only:
        out.occupancy = stored(snapshot.occupancy)
        out.top_mm = stored(snapshot.top_mm)
    else:
        _add_arrays(out, snapshot)
    if layers:
        for name, value in snapshot.values.items():
            out.values[name] = packed(value.astype("<f2"))
    out.frontiers.extend(frontier_messages(snapshot))
    out.robot.CopyFrom(pb.Pose2(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    out.trajectory_m.extend(snapshot.trajectory_m.ravel().tolist())
    out.trajectory_starts.extend(snapshot.trajectory_starts)
    return out


def _add_arrays(out: pb.MapSnapshot, snapshot: MapSnapshot) -> None:
    """Add the arrays of the ground, and the areas, to the message of a version."""
    out.occupancy = packed(snapshot.occupancy)
    out.explored = packed(snapshot.explored_for_search)
    out.top_mm = packed(snapshot.top_mm)
    out.bottom_mm = packed(in_mm(snapshot.z_low_m))
    cell_m2 = snapshot.grid.cell_m**2
    out.explored_m2 = float(np.count_nonzero(snapshot.known)) * cell_m2
    out.occupied_m2 = float(np.count_nonzero(snapshot.occupancy == OCCUPIED)) * cell_m2


class CachedEncoding:
    """Cache of the newest version's message, encoded once for all clients; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made: dict[tuple[bool, bool], tuple[MapSnapshot, pb.MapSnapshot]] = {}

    def of(self, snapshot: MapSnapshot, layers: bool, ground_only: bool = False) -> pb.MapSnapshot:
        """Message of a version, encoded at the first request."""
        with self._lock:
            made = self._made.get((layers, ground_only))
            if made is None or made[0] is not snapshot:
                made = (snapshot, snapshot_to_proto(snapshot, layers, ground_only))
                self._made[layers, ground_only] = made
            return made[1]
