"""Map arrays for programs: NPZ archives, and a PNG of one pixel per cell for the dashboard."""

from __future__ import annotations

import io

import cv2
import numpy as np
from helios_core.map_snapshot import FREE, OCCUPIED, MapView
from numpy.typing import NDArray


def cells_png(view: MapView, layer: str | None) -> bytes:
    """PNG with one pixel per cell, first row the largest y (north up).

    Red: 0 unknown, 128 free, 255 occupied. Green: 255 where seen since the search began. Blue:
    the layer's value, 255 at its maximum (`layer_maximum`); 0 without a layer.
    """
    rows, columns = view.shape
    bgr = np.zeros((max(rows, 1), max(columns, 1), 3), np.uint8)
    if rows and columns:
        bgr[..., 2] = np.select([view.occupancy == OCCUPIED, view.occupancy == FREE], [255, 128], 0)
        bgr[..., 1] = np.where(view.explored, 255, 0)
        if layer is not None:
            values = np.nan_to_num(view.values[layer], nan=0.0, posinf=0.0, neginf=0.0)
            bgr[..., 0] = np.rint(np.clip(values / layer_maximum(view, layer), 0, 1) * 255)
    _, data = cv2.imencode(".png", bgr[::-1], [cv2.IMWRITE_PNG_COMPRESSION, 3])
    return data.tobytes()


def layer_maximum(view: MapView, layer: str) -> float:
    """Largest value of a layer; 1 if no value is above 0."""
    values = view.values[layer]
    finite = values[np.isfinite(values)]
    largest = float(finite.max()) if finite.size else 0.0
    return largest if largest > 0 else 1.0


def occupancy_npz(view: MapView) -> bytes:
    """NPZ of the occupancy grid.

    `occupancy` int8 (-1 unknown, 0 free, 100 occupied), `explored` uint8, `top_m` float32, the
    trajectory, and the id, centre, length and reachability of each frontier.
    """
    frontiers = view.frontiers
    return _npz(
        view,
        occupancy=view.occupancy,
        explored=view.explored.astype(np.uint8),
        top_m=view.top_m,
        trajectory_m=view.trajectory_m,
        frontier_id=np.array([f.id for f in frontiers], np.uint64),
        frontier_center_m=np.array([(f.x_m, f.y_m) for f in frontiers], np.float64).reshape(-1, 2),
        frontier_size_m=np.array([f.size_m for f in frontiers], np.float64),
        frontier_reachable=np.array([f.reachable for f in frontiers], np.bool_),
    )


def value_npz(view: MapView, layer: str) -> bytes:
    """NPZ with `value` float32 and `explored` uint8."""
    return _npz(view, value=view.values[layer], explored=view.explored.astype(np.uint8))


def _npz(view: MapView, **arrays: NDArray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(
        stream,
        allow_pickle=False,
        **arrays,
        origin_m=np.array(view.origin_m),
        cell_m=np.array(view.cell_m),
        robot_pose=np.array(view.robot_pose),  # x (m), y (m), yaw (rad)
        version=np.array(view.version),
    )
    return stream.getvalue()
