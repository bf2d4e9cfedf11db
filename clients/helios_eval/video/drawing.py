"""Text and shapes on an image. Text never exceeds its given width."""

from __future__ import annotations

import unicodedata
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Rgb = tuple[int, int, int]
Picture = NDArray[np.uint8]  # [h, w, 3] RGB

INK: Rgb = (34, 38, 46)
MUTED: Rgb = (107, 116, 130)
LINE: Rgb = (221, 225, 232)
PAPER: Rgb = (244, 245, 248)
WHITE: Rgb = (255, 255, 255)
# Palette of Okabe and Ito, safe for colour-blind viewers.
BLUE: Rgb = (0, 114, 178)
ORANGE: Rgb = (213, 94, 0)
GREEN: Rgb = (0, 140, 103)
AMBER: Rgb = (230, 159, 0)
PURPLE: Rgb = (150, 82, 140)
RED: Rgb = (190, 40, 40)

MOST_LETTERS = 600  # limit for any text; more is never visible
ELLIPSIS = "…"


@cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans from matplotlib: the same picture on every machine."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)


def clean(text: str) -> str:
    """One line of limited length, without control, direction and private characters."""
    kept = (
        " " if unicodedata.category(c)[0] in "ZC" else c
        for c in text[: 4 * MOST_LETTERS]
        if unicodedata.category(c) != "Mn"  # combining marks, which can pile up on one letter
    )
    return " ".join("".join(kept).split())[:MOST_LETTERS]


def width_of(text: str, size: int, bold: bool = False) -> float:
    """Width (pixels) of a cleaned text."""
    return font(size, bold).getlength(text)


def cut(text: str, most_px: float, size: int, bold: bool = False) -> str:
    """The text, or its longest beginning that fits with an ellipsis; may be empty."""
    text = clean(text)
    if width_of(text, size, bold) <= most_px:
        return text
    low, high = 0, len(text)
    while low < high:  # the longest beginning that fits
        middle = (low + high + 1) // 2
        if width_of(text[:middle].rstrip() + ELLIPSIS, size, bold) <= most_px:
            low = middle
        else:
            high = middle - 1
    return text[:low].rstrip() + ELLIPSIS if low else ""


def wrapped(text: str, most_px: float, size: int, lines: int) -> list[str]:
    """At most `lines` lines; the last is cut if the text is longer."""
    words = clean(text).split(" ")
    out: list[str] = []
    while words and len(out) < lines - 1:
        count = 1
        while count < len(words) and width_of(" ".join(words[: count + 1]), size) <= most_px:
            count += 1
        out.append(cut(" ".join(words[:count]), most_px, size))
        words = words[count:]
    if words:
        out.append(cut(" ".join(words), most_px, size))
    return [line for line in out if line]


class Sheet:
    """Picture to draw on. Positions are pixels from the upper left corner."""

    def __init__(self, pixels: Picture) -> None:
        self.image = Image.fromarray(np.ascontiguousarray(pixels))
        self._draw = ImageDraw.Draw(self.image)

    @classmethod
    def blank(cls, width: int, height: int, color: Rgb = PAPER) -> Sheet:
        return cls(np.full((height, width, 3), color, np.uint8))

    @property
    def pixels(self) -> Picture:
        return np.array(self.image)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        most_px: float,
        size: int = 14,
        color: Rgb = INK,
        bold: bool = False,
        align: str = "l",
    ) -> float:
        """Draw a line centred at height y, aligned l, m or r of x; return its width."""
        shown = cut(text, most_px, size, bold)
        self._draw.text((x, y), shown, fill=color, font=font(size, bold), anchor=align + "m")
        return width_of(shown, size, bold)

    def paragraph(
        self,
        x: float,
        y: float,
        text: str,
        most_px: float,
        lines: int,
        size: int = 13,
        color: Rgb = INK,
    ) -> float:
        """Draw lines from y downwards; return their total height."""
        shown = wrapped(text, most_px, size, lines)
        step = size * 1.4
        for k, line in enumerate(shown):
            self._draw.text(
                (x, y + (k + 0.5) * step), line, fill=color, font=font(size), anchor="lm"
            )
        return len(shown) * step

    def box(
        self,
        x0: float,
        y0: float,
        x1: float,
        y1: float,
        fill: Rgb | None = WHITE,
        line: Rgb | None = None,
        radius: int = 8,
        width: int = 1,
    ) -> None:
        self._draw.rounded_rectangle((x0, y0, x1, y1), radius, fill, line, width)

    def rule(self, x0: float, y: float, x1: float, color: Rgb = LINE) -> None:
        self._draw.line((x0, y, x1, y), color, 1)

    def paste(self, pixels: Picture, x: int, y: int) -> None:
        self.image.paste(Image.fromarray(pixels), (x, y))

    def pill(
        self, x: float, y: float, text: str, most_px: float, size: int = 12, fill: Rgb = INK,
        color: Rgb = WHITE, line: Rgb | None = None, bold: bool = False,
    ) -> float:  # fmt: skip
        """Draw text in a rounded box whose left middle is (x, y); return its width."""
        shown = cut(text, most_px - 2 * PILL_PAD, size, bold)
        width, half = pill_size(shown, size, bold)[0], pill_size(shown, size, bold)[1] / 2
        self.box(x, y - half, x + width, y + half, fill, line, radius=int(half))
        self._draw.text((x + PILL_PAD, y), shown, fill=color, font=font(size, bold), anchor="lm")
        return width


PILL_PAD = 7


def pill_size(text: str, size: int, bold: bool = False) -> tuple[float, float]:
    """Width and height of a pill around a cleaned text."""
    return width_of(text, size, bold) + 2 * PILL_PAD, size * 1.6


def tinted(color: Rgb, share: float) -> Rgb:
    """Colour mixed into white with this share."""
    r, g, b = (round(255 + (c - 255) * share) for c in color)
    return r, g, b
