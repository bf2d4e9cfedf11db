"""Legend strip below a picture of the map: meaning of the colours, and a scale bar."""

from __future__ import annotations

import cv2
import numpy as np

from helios_map2d.pictures.canvas import (
    BEYOND_RGB,
    FOOT_PX,
    FREE_RGB,
    FRONTIER_RGB,
    INK_RGB,
    KNOWN_BEFORE_RGB,
    LOW_RGB,
    PATH_RGB,
    TALL_RGB,
    TRAIL_RGB,
    UNKNOWN_RGB,
    Canvas,
)


def draw_foot(sheet: Canvas, layer: str, values: tuple[float, float] | None) -> None:
    """Draw the legend strip. values: range of the values of a value layer."""
    size = sheet.pixels.shape[0]
    top = size - FOOT_PX
    sheet.pixels[top:] = (250, 251, 253)
    cv2.line(sheet.pixels, (0, top), (size, top), (200, 206, 216), 1)
    base = top + FOOT_PX // 2 + 5
    metre_px = round(sheet.scale / sheet.cell_m)
    bar = size - metre_px - 14
    if metre_px < size // 3:
        cv2.line(sheet.pixels, (bar, base - 5), (bar + metre_px, base - 5), INK_RGB, 2)
        for u in (bar, bar + metre_px):
            cv2.line(sheet.pixels, (u, base - 9), (u, base - 1), INK_RGB, 2)
        bar -= sheet.text_width("1 m") + 8
        sheet.text("1 m", (bar, base))
    entries = [
        ("free", FREE_RGB),
        ("known before", KNOWN_BEFORE_RGB),
        ("obstacle", TALL_RGB),
        ("low obstacle", LOW_RGB),
        ("unknown", UNKNOWN_RGB),
        ("frontier", FRONTIER_RGB),
        ("out of reach", BEYOND_RGB),
        ("path driven", TRAIL_RGB),
        ("plan", PATH_RGB),
    ]
    u = 12
    if values is not None:
        lo, hi = values
        sheet.text(f"{layer[:24]}  {lo:.2f}", (u, base))
        u += sheet.text_width(f"{layer[:24]}  {lo:.2f}") + 8
        ramp = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[None], cv2.COLORMAP_VIRIDIS)
        wide = max(20, size // 8)
        shown = cv2.resize(ramp[..., ::-1], (wide, 12), interpolation=cv2.INTER_LINEAR)
        if u + wide < size:
            sheet.pixels[base - 11 : base + 1, u : u + wide] = shown
        u += wide + 8
        sheet.text(f"{hi:.2f}", (u, base))
        u += sheet.text_width(f"{hi:.2f}") + 18
        entries = entries[5:]  # the values cover the ground colours
    for name, colour in entries:
        end = u + 18 + sheet.text_width(name)
        if end > bar - 8:
            break
        cv2.rectangle(sheet.pixels, (u, base - 11), (u + 12, base + 1), colour, -1)
        cv2.rectangle(sheet.pixels, (u, base - 11), (u + 12, base + 1), (150, 156, 168), 1)
        sheet.text(name, (u + 18, base))
        u = end + 16
