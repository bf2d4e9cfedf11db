"""Rooms for the fake Spot."""

from __future__ import annotations

from tests.fake_spot.scene import Box, Cylinder, Shape

WALL, FLOOR = (190, 190, 195), (120, 115, 110)
BLUE, GREEN, RED = (30, 60, 220), (30, 170, 60), (220, 30, 30)


def _walls(x: tuple[float, float], y: tuple[float, float]) -> dict[str, Shape]:
    cx, cy, w, d = (x[0] + x[1]) / 2, (y[0] + y[1]) / 2, x[1] - x[0], y[1] - y[0]
    return {
        "floor": Box((cx, cy, -0.05), (w, d, 0.1), FLOOR),
        "wall east": Box((x[1] + 0.05, cy, 1.25), (0.1, d, 2.5), WALL),
        "wall west": Box((x[0] - 0.05, cy, 1.25), (0.1, d, 2.5), WALL),
        "wall north": Box((cx, y[1] + 0.05, 1.25), (w, 0.1, 2.5), WALL),
        "wall south": Box((cx, y[0] - 0.05, 1.25), (w, 0.1, 2.5), WALL),
    }


def tea_room() -> tuple[dict[str, Shape], dict[str, Cylinder | Box]]:
    """A blue table with a red mug, and a green bench, in a room of 6 m by 5 m."""
    fixed = _walls((-2.0, 4.0), (-2.5, 2.5))
    fixed["table"] = Box((2.4, 0.6, 0.35), (0.8, 1.0, 0.7), BLUE)
    fixed["bench"] = Box((0.6, -1.9, 0.25), (1.2, 0.6, 0.5), GREEN)
    mug = Cylinder((2.16, 0.6, 0.76), 0.045, 0.12, RED)
    return fixed, {"mug": mug}
