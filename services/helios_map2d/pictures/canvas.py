"""Canvas of a picture of the map: pixels, projection of world points, lines and text.

World x points right and y up. Enlarged cells stay sharp. Everything drawn over them is sized in
picture pixels, so that lines and labels stay readable at any scale.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_map2d.grid import Box, GridSpec

MARGIN_M = 0.4
FOOT_PX = 40

Colour = tuple[int, int, int]  # RGB

UNKNOWN_RGB: Colour = (222, 226, 233)
KNOWN_BEFORE_RGB: Colour = (240, 243, 247)
FREE_RGB: Colour = (255, 255, 255)
LOW_RGB: Colour = (150, 160, 176)
TALL_RGB: Colour = (38, 44, 58)
FRONTIER_RGB: Colour = (240, 126, 24)
BEYOND_RGB: Colour = (190, 150, 120)
TRAIL_RGB: Colour = (72, 122, 214)
PATH_RGB: Colour = (18, 158, 106)
ROBOT_RGB: Colour = (28, 84, 196)
INK_RGB: Colour = (44, 50, 62)
HALO_RGB: Colour = (255, 255, 255)
OBJECT_RGB: tuple[Colour, ...] = (
    (196, 44, 92),
    (128, 62, 190),
    (0, 128, 150),
    (168, 110, 0),
    (70, 120, 30),
    (200, 70, 40),
)
FONT = cv2.FONT_HERSHEY_SIMPLEX


class Canvas:
    """RGB pixels of a picture, and the projection of world points onto them."""

    def __init__(self, grid: GridSpec, size_px: int) -> None:
        self._grid = grid
        self.cell_m = grid.cell_m
        margin = int(MARGIN_M / grid.cell_m)
        self._box = Box(-margin, grid.rows + margin, -margin, grid.columns + margin)
        room_px = size_px - FOOT_PX
        self.scale = min(size_px / self._box.columns, room_px / self._box.rows)
        self.width = max(1, round(self._box.columns * self.scale))
        self.height = max(1, round(self._box.rows * self.scale))
        self.offset_px = (size_px - self.width) // 2, (room_px - self.height) // 2
        self.pixels = np.full((size_px, size_px, 3), UNKNOWN_RGB, np.uint8)
        self.line_px = max(1, round(size_px / 400))
        self.font = max(0.35, size_px / 2000)

    def at(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Pixel (column, row) of a world point; distant points are clipped for OpenCV."""
        grid = self._grid
        column = (x_m - grid.origin_m[0]) / grid.cell_m - self._box.column_lo
        row = self._box.row_hi - (y_m - grid.origin_m[1]) / grid.cell_m
        u = np.clip(column * self.scale + self.offset_px[0], -20000, 20000)
        v = np.clip(row * self.scale + self.offset_px[1], -20000, 20000)
        return round(float(u)), round(float(v))

    def paint(self, cells: NDArray[np.uint8]) -> None:
        """Fill the canvas with an RGB picture of the grid's cells."""
        box = self._box
        whole = np.full((box.rows, box.columns, 3), UNKNOWN_RGB, np.uint8)
        whole[
            -box.row_lo : -box.row_lo + cells.shape[0],
            -box.column_lo : -box.column_lo + cells.shape[1],
        ] = cells
        flat = np.ascontiguousarray(whole[::-1])
        # INTER_AREA averages the cells of one pixel; INTER_NEAREST keeps enlarged cells square.
        how = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_NEAREST
        u, v = self.offset_px
        self.pixels[v : v + self.height, u : u + self.width] = cv2.resize(
            flat, (self.width, self.height), interpolation=how
        )

    def line(self, points_m: NDArray, colour: Colour, width: int) -> None:
        if len(points_m) > 1:
            points = np.array([self.at(x, y) for x, y in points_m], np.int32)
            cv2.polylines(self.pixels, [points], False, colour, width, cv2.LINE_AA)

    def text(self, text: str, at_px: tuple[int, int], colour: Colour = INK_RGB) -> None:
        """Draw text with a white halo. Its left end and base line are at a pixel, or farther left
        if it would leave the picture."""
        width = max(1, round(self.font * 2))
        shown = plain(text)
        room_px = self.pixels.shape[1] - self.text_width(shown) - 4
        u, v = max(0, min(at_px[0], room_px)), at_px[1]
        # Thicker text would be wider, so the halo consists of shifted copies of the text.
        for du, dv in ((-2, 0), (2, 0), (0, -2), (0, 2), (-1, -1), (1, -1), (-1, 1), (1, 1)):
            place = (u + du, v + dv)
            cv2.putText(self.pixels, shown, place, FONT, self.font, HALO_RGB, width, cv2.LINE_AA)
        cv2.putText(self.pixels, shown, (u, v), FONT, self.font, colour, width, cv2.LINE_AA)

    def text_width(self, text: str) -> int:
        (width, _), _ = cv2.getTextSize(text, FONT, self.font, max(1, round(self.font * 2)))
        return width

    @property
    def text_height(self) -> int:
        """Height of a line of text, with descenders."""
        (_, height), below = cv2.getTextSize("Ag", FONT, self.font, max(1, round(self.font * 2)))
        return height + below + 2


def plain(text: str) -> str:
    """Text with "?" in place of non-ASCII characters, which OpenCV's font lacks."""
    return text.encode("ascii", "replace").decode()
