"""Picture of the map for people: known cells, frontiers, values, the robot and its path."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED
from numpy.typing import NDArray

from helios_map2d.pictures.canvas import (
    BEYOND_RGB,
    FOOT_PX,
    FREE_RGB,
    FRONTIER_RGB,
    HALO_RGB,
    INK_RGB,
    KNOWN_BEFORE_RGB,
    LOW_RGB,
    OBJECT_RGB,
    PATH_RGB,
    ROBOT_RGB,
    TALL_RGB,
    TRAIL_RGB,
    UNKNOWN_RGB,
    Canvas,
    Colour,
    plain,
)
from helios_map2d.pictures.label_placement import Rect, Wanted, lead, placed
from helios_map2d.pictures.legend import draw_foot
from helios_map2d.snapshots.snapshot import MapSnapshot, about

OCCUPANCY = "occupancy"
MIN_PX, MAX_PX = 128, 4096
MOST_VALUES = 2  # values in a frontier's label; the picture of a layer shows that layer's value
PNG_HEAD = 33  # length of the signature and the first chunk, IHDR


@dataclass(frozen=True)
class Marked:
    """Object to draw: a box (world, metres) with a label."""

    label: str
    center_m: tuple[float, float]
    size_m: tuple[float, float]
    score: float = 0.0


@dataclass(frozen=True)
class _Label:
    """Text of a label, and the box of its object in the picture."""

    text: str
    box_px: Rect
    colour: Colour = INK_RGB


def render(
    snapshot: MapSnapshot,
    layer: str = OCCUPANCY,
    size_px: int = 1024,
    path_m: NDArray | None = None,
    objects: Sequence[Marked] = (),
) -> NDArray[np.uint8]:
    """Map as RGB [size_px, size_px, 3]; `layer` is "occupancy" or the name of a value layer.

    `path_m` [n, 2] is the robot's planned path. Raises InvalidInput for an unknown layer, a size
    out of range, or a path that is not finite.
    """
    if layer != OCCUPANCY and layer not in snapshot.values:
        known = ", ".join([OCCUPANCY, *snapshot.values])
        raise InvalidInput(f"the map has no layer {layer[:80]!r}; ask for one of: {known}")
    if not MIN_PX <= size_px <= MAX_PX:
        raise InvalidInput(
            f"a picture of {size_px} px is not drawn; ask for {MIN_PX} to {MAX_PX} px"
        )
    if path_m is not None and not np.isfinite(path_m).all():
        raise InvalidInput("the path to draw holds NaN or infinity: send finite metres")
    sheet = Canvas(snapshot.grid, size_px)
    sheet.paint(cell_colours(snapshot, layer))
    for frontier in snapshot.frontiers:
        _draw_frontier_cells(sheet, snapshot, frontier.cells, frontier.reachable)
    for piece in np.split(snapshot.trajectory_m, snapshot.trajectory_starts):
        sheet.line(piece, TRAIL_RGB, sheet.line_px)
    if path_m is not None:
        sheet.line(path_m, (255, 255, 255), 3 * sheet.line_px)
        sheet.line(path_m, PATH_RGB, 2 * sheet.line_px)
    labels = [*_draw_objects(sheet, objects), *_draw_frontier_centres(sheet, snapshot, layer)]
    robot = [] if snapshot.robot_pose is None else [_draw_robot(sheet, *snapshot.robot_pose)]
    _draw_labels(sheet, labels, robot)
    draw_foot(sheet, layer, None if layer == OCCUPANCY else value_range(snapshot, layer))
    return sheet.pixels


def png_of(pixels: NDArray[np.uint8], snapshot: MapSnapshot) -> bytes:
    """RGB picture of a version as PNG, with `snapshot.about` as its text chunk "helios"."""
    _, encoded = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    data = encoded.tobytes()
    text = b"tEXthelios\0" + json.dumps(about(snapshot)).encode("ascii")
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return data[:PNG_HEAD] + chunk + data[PNG_HEAD:]


def cell_colours(snapshot: MapSnapshot, layer: str) -> NDArray[np.uint8]:
    """Cell colours, RGB [rows, columns, 3]: obstacles darken with height, values as a heat map."""
    out = np.empty((*snapshot.grid.shape, 3), np.float32)
    out[:] = UNKNOWN_RGB
    out[snapshot.known > 0] = KNOWN_BEFORE_RGB
    out[(snapshot.occupancy == FREE) & (snapshot.explored_for_search > 0)] = FREE_RGB
    if layer != OCCUPANCY:
        value, confidence = snapshot.values[layer], snapshot.confidences[layer]
        lo, hi = value_range(snapshot, layer)
        scaled = np.clip((value - lo) / (hi - lo) * 255, 0, 255).astype(np.uint8)
        heat = cv2.applyColorMap(scaled, cv2.COLORMAP_VIRIDIS)[..., ::-1].astype(np.float32)
        alpha = np.where(confidence > 0, 0.35 + 0.6 * np.minimum(confidence, 1), 0)[..., None]
        out = out * (1 - alpha) + heat * alpha
    occupied = snapshot.occupancy == OCCUPIED
    tall = np.clip(snapshot.z_high_m[occupied] / 1.5, 0, 1)[:, None]
    out[occupied] = np.array(LOW_RGB) * (1 - tall) + np.array(TALL_RGB) * tall
    return out.round().astype(np.uint8)


def value_range(snapshot: MapSnapshot, layer: str) -> tuple[float, float]:
    """Lowest and highest value of a layer, at least 0.001 apart."""
    seen = snapshot.values[layer][snapshot.confidences[layer] > 0]
    if not seen.size:
        return 0.0, 1.0
    lo, hi = float(seen.min()), float(seen.max())
    return lo, max(hi, lo + 1e-3)


def _draw_frontier_cells(
    sheet: Canvas, snapshot: MapSnapshot, cells: NDArray[np.int32], reachable: bool
) -> None:
    radius = max(1, round(sheet.scale * 0.8), sheet.line_px)
    colour = FRONTIER_RGB if reachable else BEYOND_RGB
    for x_m, y_m in (cells[:, ::-1] + 0.5) * snapshot.grid.cell_m:
        cv2.circle(sheet.pixels, sheet.at(x_m, y_m), radius, colour, -1, cv2.LINE_AA)


def _draw_frontier_centres(sheet: Canvas, snapshot: MapSnapshot, layer: str) -> list[_Label]:
    """Draw the centres. Returns the labels of reachable frontiers, highest value first."""
    labels = []
    for frontier in sorted(snapshot.frontiers, key=lambda f: -max(f.values.values(), default=0.0)):
        u, v = sheet.at(*frontier.centre_m)
        radius = 4 * sheet.line_px
        colour = FRONTIER_RGB if frontier.reachable else BEYOND_RGB
        cv2.circle(sheet.pixels, (u, v), radius + sheet.line_px, (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(sheet.pixels, (u, v), radius, colour, -1, cv2.LINE_AA)
        shown = frontier.values if layer == OCCUPANCY else {layer: frontier.values.get(layer, 0.0)}
        first = list(shown.items())[:MOST_VALUES]
        label = " ".join(f"{name} {value:.2f}" for name, value in first)
        if label and frontier.reachable:
            labels.append(_Label(label, (u - radius, v - radius, u + radius, v + radius)))
    return labels


def _draw_objects(sheet: Canvas, objects: Sequence[Marked]) -> list[_Label]:
    """Draw the objects. Returns their labels, highest score first."""
    labels = []
    names = sorted({thing.label for thing in objects})
    for thing in sorted(objects, key=lambda thing: thing.score):
        colour = OBJECT_RGB[names.index(thing.label) % len(OBJECT_RGB)]
        (x, y), (width, depth) = thing.center_m, thing.size_m
        if not np.isfinite([x, y, width, depth]).all():
            continue
        u0, v0 = sheet.at(x - width / 2, y + depth / 2)
        u1, v1 = sheet.at(x + width / 2, y - depth / 2)
        half = 3 * sheet.line_px  # least half size, so that small objects stay visible
        u0, u1 = min(u0, (u0 + u1) // 2 - half), max(u1, (u0 + u1) // 2 + half)
        v0, v1 = min(v0, (v0 + v1) // 2 - half), max(v1, (v0 + v1) // 2 + half)
        cv2.rectangle(sheet.pixels, (u0, v0), (u1, v1), (255, 255, 255), sheet.line_px + 2)
        cv2.rectangle(sheet.pixels, (u0, v0), (u1, v1), colour, sheet.line_px)
        labels.append(_Label(f"{thing.label[:40]} {thing.score:.2f}", (u0, v0, u1, v1), colour))
    return labels[::-1]


def _draw_labels(sheet: Canvas, labels: Sequence[_Label], taken: Sequence[Rect]) -> None:
    """Draw the labels beside their objects without overlap; omit labels without room."""
    size = sheet.pixels.shape[0]
    wanted = [
        Wanted(sheet.text_width(plain(label.text)) + 6, sheet.text_height, label.box_px)
        for label in labels
    ]
    places = placed(wanted, (size, size - FOOT_PX), taken)
    for label, place in zip(labels, places, strict=True):
        if place is not None and (line := lead(place, label.box_px)):
            (u0, v0), (u1, v1) = line
            one, other = (round(u0), round(v0)), (round(u1), round(v1))
            cv2.line(sheet.pixels, one, other, HALO_RGB, sheet.line_px + 2, cv2.LINE_AA)
            cv2.line(sheet.pixels, one, other, label.colour, sheet.line_px, cv2.LINE_AA)
    for label, place in zip(labels, places, strict=True):
        if place is not None:
            at = round(place[0]) + 3, round(place[3] - sheet.text_height * 0.3)
            sheet.text(label.text, at, label.colour)


def _draw_robot(sheet: Canvas, x_m: float, y_m: float, yaw_rad: float) -> Rect:
    """Draw the robot. Returns its box in the picture."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = [(0.30, 0.0), (-0.20, 0.19), (-0.11, 0.0), (-0.20, -0.19)]
    points = np.array(
        [sheet.at(x_m + c * f - s * left, y_m + s * f + c * left) for f, left in corners], np.int32
    )
    cv2.fillPoly(sheet.pixels, [points], ROBOT_RGB, cv2.LINE_AA)
    cv2.polylines(sheet.pixels, [points], True, (255, 255, 255), sheet.line_px, cv2.LINE_AA)
    (u0, v0), (u1, v1) = points.min(axis=0), points.max(axis=0)
    return float(u0), float(v0), float(u1), float(v1)
