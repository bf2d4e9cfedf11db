"""Conversion of the maps to Foxglove grids and scenes. No I/O.

Row 0 of a grid is at its lowest y and column 0 at its lowest x, in the map as in foxglove.Grid.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping

import cv2
import numpy as np
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, MapView
from helios_core.object_boxes import LEAST_BOX_M, upright_box
from helios_core.recording_format import (
    FRONTIERS,
    OBJECTS,
    OBSTACLES,
    OCCUPANCY,
    TRAJECTORY,
    VALUES,
)
from helios_core.viewing.entry import Entry
from helios_core.viewing.foxglove_scene import (
    WORLD,
    Rgb,
    add_ball,
    add_box,
    add_line,
    add_words,
    entity,
    pose,
    scene,
    stamp,
)

KNOWN_BEFORE_RGB: Rgb = (205, 211, 220)  # free, not explored in this search
FREE_RGB: Rgb = (245, 247, 250)
LOW_RGB: Rgb = (150, 160, 176)
TALL_RGB: Rgb = (38, 44, 58)
TALL_M = 1.5
FRONTIER_RGB: Rgb = (240, 126, 24)
BEYOND_RGB: Rgb = (190, 150, 120)  # frontiers that the robot cannot reach
TRAIL_RGB: Rgb = (72, 122, 214)
OBJECT_RGB: tuple[Rgb, ...] = (
    (196, 44, 92),
    (128, 62, 190),
    (0, 128, 150),
    (168, 110, 0),
    (70, 120, 30),
    (200, 70, 40),
)
VALUE_ALPHA = 180
VALUE_STEPS = 250.0  # values are rounded to 1 / 250, for compression

RGBA = (("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1"))
OCCUPANCY_CELL = np.dtype([*RGBA, ("occupancy", "i1")])
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), *RGBA])
VALUE_CELL = np.dtype([*RGBA, ("value", "<f4")])
NUMERIC = {
    "|u1": PackedElementField.UINT8,
    "|i1": PackedElementField.INT8,
    "<f4": PackedElementField.FLOAT32,
    "<u4": PackedElementField.UINT32,
}


def map_entries(view: MapView, gone: frozenset[str], stamp_ns: int) -> Iterator[Entry]:
    """Entries of one version of the 2D map. gone: layers to clear, because it has them no more."""
    yield Entry(OCCUPANCY, occupancy_grid(view, stamp_ns))
    yield Entry(OBSTACLES, obstacle_cloud(view, stamp_ns))
    for layer, (name, value) in enumerate(sorted(view.values.items())):
        yield Entry(VALUES + name, value_grid(view, value, 0.01 * (layer + 1), stamp_ns))
    for name in sorted(gone):
        yield Entry(VALUES + name, empty_grid(view, stamp_ns))
    yield Entry(FRONTIERS, frontier_scene(view, stamp_ns))
    yield Entry(TRAJECTORY, trajectory_scene(view, stamp_ns))


def occupancy_grid(view: MapView, stamp_ns: int) -> Grid:
    """Occupancy as a coloured grid: darker obstacles are higher, explored free floor is brighter.

    Unknown cells are transparent. The field `occupancy` is -1 unknown, 0 free, 100 occupied.
    """
    cells = np.zeros(view.shape, OCCUPANCY_CELL)
    cells["occupancy"] = view.occupancy
    rgb = np.zeros((*view.shape, 3), np.float32)
    rgb[view.occupancy == FREE] = KNOWN_BEFORE_RGB
    rgb[(view.occupancy == FREE) & view.explored] = FREE_RGB
    occupied = view.occupancy == OCCUPIED
    rgb[occupied] = _by_height(view.top_m[occupied])
    _paint(cells, rgb.round().astype(np.uint8), np.where(view.occupancy == UNKNOWN, 0, 255))
    return _grid(view, cells, 0.0, stamp_ns)


def obstacle_cloud(view: MapView, stamp_ns: int) -> PointCloud:
    """One point at the top of each occupied cell, for viewers without grids."""
    occupied = view.occupancy == OCCUPIED
    rows, columns = np.nonzero(occupied)
    points = np.zeros(len(rows), POINT)
    points["x"] = view.origin_m[0] + (columns + 0.5) * view.cell_m
    points["y"] = view.origin_m[1] + (rows + 0.5) * view.cell_m
    points["z"] = view.top_m[occupied]
    _paint(points, _by_height(view.top_m[occupied]).round().astype(np.uint8), np.uint8(255))
    out = PointCloud(
        timestamp=stamp(stamp_ns),
        frame_id=WORLD,
        pose=pose((0.0, 0.0, 0.0)),
        point_stride=POINT.itemsize,
        data=points.tobytes(),
    )
    name_fields(out, POINT)
    return out


def value_grid(view: MapView, value: NDArray[np.float32], z_m: float, stamp_ns: int) -> Grid:
    """Heat map from the lowest to the highest value of a layer, transparent without a value.

    The field `value` has the values themselves, 0 to 1, rounded to 0.004.
    """
    cells = np.zeros(view.shape, VALUE_CELL)
    sound = np.clip(np.nan_to_num(value, posinf=1.0, neginf=0.0), 0, 1)
    rounded = np.round(sound * VALUE_STEPS) / np.float32(VALUE_STEPS)
    has = sound > 0
    cells["value"] = rounded
    if has.any():
        low, high = float(rounded[has].min()), float(rounded[has].max())
        share = np.clip((rounded - low) / max(high - low, 1e-3), 0, 1)
        heat = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
        rgb = np.where(has[..., None], heat[..., ::-1], 0).astype(np.uint8)
        _paint(cells, rgb, np.where(has, VALUE_ALPHA, 0))
    return _grid(view, cells, z_m, stamp_ns)


def empty_grid(view: MapView, stamp_ns: int) -> Grid:
    """Grid of one transparent cell, which clears the displayed one."""
    return _grid(view, np.zeros((1, 1), VALUE_CELL), 0.0, stamp_ns)


def frontier_scene(view: MapView, stamp_ns: int) -> SceneUpdate:
    """Ball at the middle of each frontier, with its values."""
    out = []
    for f in view.frontiers:
        if not (math.isfinite(f.x_m) and math.isfinite(f.y_m)):
            continue
        about = {
            "frontier": f.id,
            "size_m": f.size_m,
            "reachable": f.reachable,
            "map": view.version,
            **dict(f.values),
        }
        shown = entity(f"frontier {f.id}", stamp_ns, about)
        rgb = FRONTIER_RGB if f.reachable else BEYOND_RGB
        add_ball(shown, (f.x_m, f.y_m, 0.1), 0.15, rgb)
        if f.reachable and f.values:
            words = " ".join(f"{name} {value:.2f}" for name, value in sorted(f.values.items()))
            add_words(shown, (f.x_m, f.y_m, 0.3), words, rgb)
        out.append(shown)
    return scene(out, stamp_ns)


def trajectory_scene(view: MapView, stamp_ns: int) -> SceneUpdate:
    """Path that the robot has driven, one line for each connected piece."""
    shown = entity("trajectory", stamp_ns, {"points": len(view.trajectory_m), "map": view.version})
    for piece in np.split(view.trajectory_m, view.trajectory_starts):
        points = [(float(x), float(y), 0.03) for x, y in piece if np.isfinite((x, y)).all()]
        if len(points) > 1:
            add_line(shown, points, 0.03, TRAIL_RGB)
    return scene([shown], stamp_ns)


def object_entry(reply: pb.ObjectsReply, stamp_ns: int) -> Entry:
    """Box for each object, with its class and its score Ψ."""
    out = []
    for o in reply.objects:
        box = upright_box(o, LEAST_BOX_M)
        if box is None:
            continue
        about: Mapping[str, object] = {
            "object": o.id,
            "class": o.class_name,
            "score": o.score,
            "class_score": o.class_score,
            "uncertainty": o.uncertainty,
            "views": o.views,
            "gaussians": o.gaussians,
            "map": reply.version,
        }
        shown = entity(f"object {o.id}", stamp_ns, about)
        rgb = OBJECT_RGB[zlib.crc32(o.class_name.encode()) % len(OBJECT_RGB)]
        add_box(shown, box, rgb, 0.4)
        x, y, z = box.center_m
        top_m = z + box.size_m[2] / 2
        words = f"{o.class_name} {o.score:.2f}"
        add_words(shown, (x, y, top_m + 0.12), words, rgb)
        out.append(shown)
    return Entry(OBJECTS, scene(out, stamp_ns))


def _by_height(top_m: NDArray[np.float32]) -> NDArray[np.float64]:
    """RGB [n, 3] of obstacles, darker with their height [n]."""
    tall = np.clip(top_m / TALL_M, 0, 1)[:, None]
    return np.array(LOW_RGB) * (1 - tall) + np.array(TALL_RGB) * tall


def _paint(
    cells: NDArray[np.void], rgb: NDArray[np.uint8], alpha: NDArray[np.integer] | np.uint8
) -> None:
    cells["red"], cells["green"], cells["blue"] = np.moveaxis(rgb, -1, 0)
    cells["alpha"] = alpha


def _grid(view: MapView, cells: NDArray[np.void], z_m: float, stamp_ns: int) -> Grid:
    """Grid of cells [rows, columns] at their place on the floor; z_m is the height of the layer."""
    stride = cells.dtype.itemsize
    out = Grid(
        timestamp=stamp(stamp_ns),
        frame_id=WORLD,
        pose=pose((*view.origin_m, z_m)),
        column_count=cells.shape[1],
        cell_stride=stride,
        row_stride=cells.shape[1] * stride,
        data=cells.tobytes(),
    )
    out.cell_size.x = out.cell_size.y = view.cell_m
    name_fields(out, cells.dtype)
    return out


def name_fields(out: Grid | PointCloud, kind: np.dtype) -> None:
    """Declare the fields of a structured type in a grid or a point cloud."""
    for name, (field, offset, *_) in (kind.fields or {}).items():
        out.fields.add(name=name, offset=offset, type=NUMERIC[field.str])
