"""Snapshots as they travel; `helios_core.grids` reads them."""

from __future__ import annotations

import zlib

import numpy as np
from helios_core import proto as pb
from helios_core.codec import frame_id_to_proto
from numpy.typing import NDArray

from helios_map2d.occupancy import OCCUPIED
from helios_map2d.snapshot import MapSnapshot


def snapshot_to_proto(snapshot: MapSnapshot, layers: bool) -> pb.MapSnapshot:
    """The message of a version; without arrays, and with a cell size of 0, while nothing is known.

    `explored` is what was seen since the search began; tops are sent in millimetres.
    """
    out = pb.MapSnapshot(version=snapshot.version, context_id=snapshot.context_id)
    if snapshot.frame_id is None or snapshot.robot_pose is None:
        return out
    grid = snapshot.grid
    x_m, y_m, yaw_rad = snapshot.robot_pose
    out.id.CopyFrom(frame_id_to_proto(snapshot.frame_id))
    out.cell_m = grid.cell_m
    out.origin_x_m, out.origin_y_m = grid.origin_m
    out.height, out.width = grid.shape
    out.occupancy = _packed(snapshot.occupancy)
    out.explored = _packed(snapshot.explored_for_search)
    out.top_mm = _packed(np.rint(np.clip(snapshot.z_high_m, 0, 65) * 1000).astype("<u2"))
    if layers:
        for name, value in snapshot.values.items():
            out.values[name] = _packed(value.astype("<f2"))
    for frontier in snapshot.frontiers:
        out.frontiers.append(
            pb.Frontier(
                id=frontier.id,
                x_m=frontier.centre_m[0],
                y_m=frontier.centre_m[1],
                size_m=frontier.size_m,
                values=dict(frontier.values),
                reachable=frontier.reachable,
            )
        )
    out.robot.CopyFrom(pb.Pose2(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    out.trajectory_m.extend(snapshot.trajectory_m.ravel().tolist())
    cell_m2 = grid.cell_m**2
    out.explored_m2 = float(np.count_nonzero(snapshot.explored)) * cell_m2
    out.occupied_m2 = float(np.count_nonzero(snapshot.occupancy == OCCUPIED)) * cell_m2
    return out


def _packed(array: NDArray) -> bytes:
    return zlib.compress(np.ascontiguousarray(array).tobytes(), 1)
