"""Arrays of the 2D map and of the object map, as ROS viewers show them. No I/O."""

from __future__ import annotations

import json

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, MapView
from numpy.typing import NDArray

LETHAL, INSCRIBED = 100, 99
DECAY_PER_M = 5.0  # of the costs beyond the robot's radius
FAR_M = 1.0  # beyond it a cell costs nothing
LEGEND_PX = 26  # height of the legend below a value map
SCALE = 3  # pixels per cell of a value map
POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4"), ("class", "<u4"), ("object", "<u4")]
)


def costs(view: MapView, radius_m: float) -> NDArray[np.int8]:
    """Costs [rows, columns]: 100 occupied, 99 within the robot's radius of it, then falling to 0.

    -1 is unknown. Row 0 is at the lowest y.
    """
    apart_m = np.full(view.shape, np.inf, np.float32)
    if (view.occupancy == OCCUPIED).any():
        free = (view.occupancy != OCCUPIED).astype(np.uint8)
        apart_m = cv2.distanceTransform(free, cv2.DIST_L2, 5).astype(np.float32) * view.cell_m
    beyond_m = apart_m - radius_m
    falling = (INSCRIBED - 1) * np.exp(-DECAY_PER_M * np.maximum(beyond_m, 0.0))
    out = np.where(beyond_m > FAR_M, 0.0, falling).astype(np.int8)
    out[apart_m <= radius_m] = INSCRIBED
    out[view.occupancy == OCCUPIED] = LETHAL
    out[(view.occupancy == UNKNOWN) & (out < INSCRIBED)] = -1
    return out


def value_cells(value: NDArray[np.float32]) -> NDArray[np.int8]:
    """Values 0 to 1 as percent [rows, columns]; -1 without a value."""
    sound = np.clip(np.nan_to_num(value, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.where(sound > 0, np.rint(100 * sound), -1).astype(np.int8)


def value_picture(view: MapView, value: NDArray[np.float32], name: str) -> NDArray[np.uint8]:
    """RGB [h, w, 3] of a value layer with a colour legend below; y points up, x to the right."""
    sound = np.clip(np.nan_to_num(value, posinf=1.0, neginf=0.0), 0.0, 1.0)
    has = sound > 0
    low, high = (float(sound[has].min()), float(sound[has].max())) if has.any() else (0.0, 1.0)
    share = np.clip((sound - low) / max(high - low, 1e-3), 0.0, 1.0)
    rgb = np.full((*view.shape, 3), 255, np.uint8)
    rgb[view.occupancy == FREE] = 225
    rgb[has] = _viridis(share)[has]
    rgb[view.occupancy == OCCUPIED] = 60
    large = np.repeat(np.repeat(rgb[::-1], SCALE, 0), SCALE, 1)
    return np.concatenate([large, _legend(large.shape[1], low, high, name)])


def _viridis(share: NDArray[np.float32]) -> NDArray[np.uint8]:
    bgr = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return bgr[..., ::-1].astype(np.uint8)


def _legend(width: int, low: float, high: float, name: str) -> NDArray[np.uint8]:
    out = np.full((LEGEND_PX, width, 3), 255, np.uint8)
    ramp = np.linspace(0, 1, width, dtype=np.float32)[None]
    out[:8] = _viridis(np.repeat(ramp, 8, 0))
    plain = name.encode("ascii", "replace").decode()
    font, scale = cv2.FONT_HERSHEY_PLAIN, 0.9
    for words, share in ((f"{low:.2f}", 0.0), (plain, 0.5), (f"{high:.2f}", 1.0)):
        (wide, _), _ = cv2.getTextSize(words, font, scale, 1)
        left = round(share * max(0, width - wide - 4)) + 2
        at = (left, LEGEND_PX - 5)
        cv2.putText(out, words, at, font, scale, (20, 20, 20), 1, cv2.LINE_AA)
    return out


def cloud(reply: pb.GaussiansReply) -> NDArray[np.void]:
    """Points [n] of the object map: x, y, z (m), colour, index of the likeliest class, object id.

    Raises InvalidInput for arrays of a wrong size.
    """
    n, classes = reply.count, len(reply.class_names)
    out = np.zeros(n, POINT)
    means = _array(reply.means_m, "<f4", (n, 3), "means")
    colors = _array(reply.colors, "u1", (n, 3), "colors").astype(np.uint32)
    out["x"], out["y"], out["z"] = means.T
    out["rgb"] = colors[:, 0] << 16 | colors[:, 1] << 8 | colors[:, 2]
    out["object"] = _array(reply.instances, "<u4", (n,), "instances")
    if classes:
        shares = _array(reply.concentration, "<f4", (n, classes), "concentration")
        out["class"] = shares.argmax(1) if n else 0
    return out[np.isfinite(means).all(1)]


def class_table(reply: pb.GaussiansReply) -> str:
    """JSON list of the class names, in the order of the index `class`."""
    return json.dumps(list(reply.class_names))


def _array(data: bytes, kind: str, shape: tuple[int, ...], what: str) -> NDArray:
    wanted = int(np.prod(shape)) * np.dtype(kind).itemsize
    if len(data) != wanted:
        raise InvalidInput(f"{what} of the object map have {len(data)} bytes; wanted {wanted}")
    return np.frombuffer(data, kind).reshape(shape)
