"""Panel of the 2D map: occupancy, values, frontiers, path, objects with their Ψ, the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, MapView
from helios_core.types import ObjectInstance
from numpy.typing import NDArray

from helios_eval.video.drawing import (
    AMBER,
    BLUE,
    INK,
    MUTED,
    PURPLE,
    WHITE,
    Picture,
    Rgb,
    Sheet,
    cut,
    pill_size,
    tinted,
)
from helios_eval.video.frame_content import Scene

UNKNOWN_RGB: Rgb = (226, 230, 236)
BEFORE_RGB: Rgb = (240, 242, 246)  # free, but not seen since this search began
LOW_RGB: Rgb = (156, 166, 181)
TALL_RGB: Rgb = (52, 59, 74)
TRAIL_RGB: Rgb = (134, 178, 224)
PATH_RGB = PURPLE
FRONTIER_RGB = AMBER
ROBOT_RGB = BLUE

MARGIN_M = 0.4
STEP_M = 1.0  # edges move by whole metres, so that the view does not drift
SHOWN_CLASS_SCORE = 0.3
MOST_OBJECTS = 14
SURE = 0.5  # Ψ from which an object's label is filled
LABEL_PX = 11
SUBPIXEL = 3  # bits

Points = NDArray[np.floating]


@dataclass(frozen=True)
class Window:
    """Part of the world in a picture: pixel = scale * (x - left, top - y)."""

    left_m: float
    top_m: float
    px_per_m: float
    width: int
    height: int

    def at(self, points_m: Points) -> NDArray[np.float64]:
        """Pixels [n, 2] of world points [n, 2], clipped to a range that can be drawn."""
        points = np.asarray(points_m, np.float64).reshape(-1, 2)
        uv = (points - (self.left_m, self.top_m)) * (self.px_per_m, -self.px_per_m)
        return np.clip(np.nan_to_num(uv, nan=-9e3, posinf=9e3, neginf=-9e3), -9e3, 9e3)


def window_of(view: MapView, width: int, height: int) -> Window:
    """Window around the known part of the map, in whole metres, centred and as large as fits."""
    known = (view.occupancy != UNKNOWN) | view.explored
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        rows, columns = np.array([0, view.shape[0]]), np.array([0, view.shape[1]])
    x0, y0 = view.origin_m
    left = _down(x0 + columns[0] * view.cell_m - MARGIN_M)
    right = -_down(-(x0 + (columns[-1] + 1) * view.cell_m + MARGIN_M))
    bottom = _down(y0 + rows[0] * view.cell_m - MARGIN_M)
    top = -_down(-(y0 + (rows[-1] + 1) * view.cell_m + MARGIN_M))
    scale = min(width / (right - left), height / (top - bottom))
    spare_x = width / scale - (right - left)
    spare_y = height / scale - (top - bottom)
    return Window(left - spare_x / 2, top + spare_y / 2, scale, width, height)


def map_picture(scene: Scene, width: int, height: int, layer: str = "") -> Picture:
    """RGB [height, width, 3] of the occupancy, or of a value layer with small marks, no objects."""
    if scene.map is None or not scene.map.occupancy.size:
        sheet = Sheet.blank(width, height, UNKNOWN_RGB)
        sheet.text(width / 2, height / 2, "no map yet", width - 20, 13, MUTED, align="m")
        return sheet.pixels
    view = scene.map
    window = window_of(view, width, height)
    out = _ground(view, window, layer)
    _line(out, window.at(view.trajectory_m), TRAIL_RGB, 2)
    path = window.at(scene.path_m)
    _line(out, path, WHITE, 5)
    _line(out, path, PATH_RGB, 3)
    size = 1.0 if not layer else 0.65  # scale of the marks
    chosen = _chosen_m(scene)
    for frontier in view.frontiers:
        (spot,) = window.at(np.array([[frontier.x_m, frontier.y_m]]))
        color = FRONTIER_RGB if frontier.reachable else tinted(FRONTIER_RGB, 0.45)
        _disc(out, spot, 5.5 * size, WHITE)
        _disc(out, spot, 4.0 * size, color)
    shown = _shown(scene.objects) if not layer else []
    for thing in shown:
        _outline(out, window, thing, scene.color_of(thing.class_name))
    if scene.robot is not None:
        _robot(out, window, scene.robot)
    if chosen is not None:
        (spot,) = window.at(chosen[None])
        _ring(out, spot, 10 * size, WHITE, 4)
        _ring(out, spot, 10 * size, INK, 2)
    sheet = Sheet(out)
    _labels(sheet, window, shown, scene)
    if not layer:
        _scale_bar(sheet, window)
    return sheet.pixels


def value_range(view: MapView, layer: str) -> tuple[float, float]:
    """Lowest and highest value in the seen cells of a layer; (0, 0) if there are none."""
    seen = view.values[layer][view.values[layer] > 0]
    return (float(seen.min()), float(seen.max())) if seen.size else (0.0, 0.0)


def _ground(view: MapView, window: Window, layer: str) -> Picture:
    cells = np.empty((*view.shape, 3), np.float32)
    cells[:] = UNKNOWN_RGB
    cells[view.occupancy == FREE] = BEFORE_RGB
    cells[(view.occupancy == FREE) & view.explored] = WHITE
    if layer in view.values:
        value = view.values[layer]
        low, high = value_range(view, layer)
        level = np.clip((value - low) / max(high - low, 1e-6) * 255, 0, 255).astype(np.uint8)
        heat = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)[..., ::-1]
        cells[value > 0] = heat[value > 0]
    occupied = view.occupancy == OCCUPIED
    tall = np.clip(view.top_m[occupied] / 1.5, 0, 1)[:, None]
    cells[occupied] = np.array(LOW_RGB) * (1 - tall) + np.array(TALL_RGB) * tall
    # Pixel (u, v) shows the cell at its world point; downscaling averages a 2 x 2 raster.
    fine = 2
    u = (np.arange(window.width * fine) + 0.5) / fine / window.px_per_m + window.left_m
    v = window.top_m - (np.arange(window.height * fine) + 0.5) / fine / window.px_per_m
    column = np.floor((u - view.origin_m[0]) / view.cell_m).astype(int)
    row = np.floor((v - view.origin_m[1]) / view.cell_m).astype(int)
    inside = ((row >= 0) & (row < view.shape[0]))[:, None] & (
        (column >= 0) & (column < view.shape[1])
    )
    whole = cells[
        np.clip(row, 0, view.shape[0] - 1)[:, None], np.clip(column, 0, view.shape[1] - 1)
    ]
    whole[~inside] = UNKNOWN_RGB
    small = cv2.resize(whole, (window.width, window.height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.round().astype(np.uint8))


def _shown(objects: tuple[ObjectInstance, ...]) -> list[ObjectInstance]:
    """Objects to label, in order of falling Ψ."""
    worth = [
        o for o in objects if o.class_score >= SHOWN_CLASS_SCORE and np.isfinite(o.center_m).all()
    ]
    return sorted(worth, key=lambda o: -o.score)[:MOST_OBJECTS]


def _outline(out: Picture, window: Window, thing: ObjectInstance, color: Rgb) -> None:
    points = window.at(thing.outline_m)
    if len(points) >= 3:
        corners = _fixed(points)
        under = out.copy()
        cv2.fillPoly(under, [corners], color, cv2.LINE_AA, SUBPIXEL)
        cv2.addWeighted(under, 0.35, out, 0.65, 0, out)
        cv2.polylines(out, [corners], True, color, 2, cv2.LINE_AA, SUBPIXEL)
    (spot,) = window.at(thing.center_m[None, :2])
    _disc(out, spot, 4.5, WHITE)
    _disc(out, spot, 3.2, color)


def _labels(sheet: Sheet, window: Window, shown: list[ObjectInstance], scene: Scene) -> None:
    """Draw the name and Ψ of each object where there is room; highest Ψ first."""
    taken: list[tuple[float, float, float, float]] = []
    for thing in shown:
        name = cut(thing.class_name, 110, LABEL_PX, bold=True)
        text = f"{name} {thing.score:.2f}"
        wide, high = pill_size(text, LABEL_PX, bold=True)
        (u, v), *_ = window.at(thing.center_m[None, :2])
        for x, y in (
            (u - wide / 2, v - high),
            (u - wide / 2, v + high),
            (u + 9, v),
            (u - wide - 9, v),
            (u - wide / 2, v - 2.1 * high),
            (u - wide / 2, v + 2.1 * high),
        ):
            x = min(max(x, 3.0), window.width - wide - 3)
            y = min(max(y, high / 2 + 3), window.height - high / 2 - 3)
            box = (x - 2, y - high / 2 - 1, x + wide + 2, y + high / 2 + 1)
            if not any(_overlap(box, other) for other in taken):
                taken.append(box)
                color = scene.color_of(thing.class_name)
                sure = thing.score >= SURE
                sheet.pill(x, y, text, wide + 1, LABEL_PX, color if sure else WHITE,
                           WHITE if sure else color, color, bold=True)  # fmt: skip
                break


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _scale_bar(sheet: Sheet, window: Window) -> None:
    length = window.px_per_m
    if length > window.width / 3:
        return
    right, base = window.width - 10, window.height - 10
    sheet.box(right - length, base - 1, right, base + 1, INK, radius=0)
    sheet.text(right - length - 5, base, "1 m", 40, 10, INK, align="r")


def _robot(out: Picture, window: Window, robot: tuple[float, float, float]) -> None:
    x, y, yaw = robot
    if not all(map(math.isfinite, robot)):
        return
    c, s = math.cos(yaw), math.sin(yaw)
    long = max(0.30, 8 / window.px_per_m)  # metres, but at least 8 pixels
    shape = np.array([(1.0, 0.0), (-0.7, 0.62), (-0.4, 0.0), (-0.7, -0.62)]) * long
    corners = _fixed(window.at(shape @ np.array([[c, s], [-s, c]]) + (x, y)))
    cv2.polylines(out, [corners], True, WHITE, 4, cv2.LINE_AA, SUBPIXEL)
    cv2.fillPoly(out, [corners], ROBOT_RGB, cv2.LINE_AA, SUBPIXEL)


def _chosen_m(scene: Scene) -> NDArray[np.float64] | None:
    """World position [2] of the last decision's chosen candidate, or None."""
    for c in scene.decisions[-1].candidates if scene.decisions else ():
        if c.chosen:
            return np.array([c.position_m.x, c.position_m.y])
    return None


def _line(out: Picture, points: Points, color: Rgb, width: int) -> None:
    if len(points) > 1:
        cv2.polylines(out, [_fixed(points)], False, color, width, cv2.LINE_AA, SUBPIXEL)


def _disc(out: Picture, spot: Points, radius: float, color: Rgb) -> None:
    u, v = _fixed(spot[None])[0]
    cv2.circle(out, (int(u), int(v)), round(radius * 2**SUBPIXEL), color, -1, cv2.LINE_AA, SUBPIXEL)


def _ring(out: Picture, spot: Points, radius: float, color: Rgb, width: int) -> None:
    u, v = _fixed(spot[None])[0]
    at = (int(u), int(v))
    cv2.circle(out, at, round(radius * 2**SUBPIXEL), color, width, cv2.LINE_AA, SUBPIXEL)


def _fixed(points: Points) -> NDArray[np.int32]:
    return np.round(points * 2**SUBPIXEL).astype(np.int32)


def _down(metres: float) -> float:
    return math.floor(metres / STEP_M) * STEP_M
