"""Small map of one episode, as PNG."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from helios_eval.episodes.failure_snapshot import FailureSnapshot, MarkedObject
from helios_eval.palette import BLUE, GREEN, VERMILION

SIZE_IN, DPI = 4.0, 110
COLOURS = 64  # size of the PNG's palette
MARGIN_M = 0.6
EDGE_PX = 3  # between labels and the picture's edge
UNKNOWN, FREE, OCCUPIED = (0.80, 0.82, 0.85), (1.0, 1.0, 1.0), (0.30, 0.34, 0.40)
PATH, TRUTH, BELIEF = BLUE, GREEN, VERMILION
MOST_BELIEFS = 8


def draw(kept: FailureSnapshot) -> bytes:
    """PNG of the robot's map with its path, the true targets and the beliefs about objects."""
    with mpl.rc_context({"text.parse_math": False, "font.family": "sans-serif", "font.size": 9.5}):
        figure = Figure(figsize=(SIZE_IN, SIZE_IN), dpi=DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _occupancy(axes, kept)
        _trajectory(axes, kept)
        for thing in kept.goals:
            _box(axes, thing, TRUTH, "-", f"goal: {thing.label}", above=True)
        for thing in kept.candidates:
            _star(axes, thing)
        believed = sorted(kept.beliefs, key=lambda b: -b.score)[:MOST_BELIEFS]
        for thing in believed:
            _box(axes, thing, BELIEF, "--", f"{thing.label} Ψ {thing.score:.2f}", above=False)
        _frame(axes, kept, believed)
        _settle_labels(figure, axes)
        out = io.BytesIO()
        figure.savefig(out, format="png", facecolor=UNKNOWN)
    return _smaller(out.getvalue())


def _occupancy(axes: Axes, kept: FailureSnapshot) -> None:
    grid = kept.occupancy
    image = np.empty((*grid.shape, 3))
    image[:] = UNKNOWN
    image[grid == 0] = FREE
    image[grid > 0] = OCCUPIED
    x0, y0 = kept.origin_m
    extent = (x0, x0 + grid.shape[1] * kept.cell_m, y0, y0 + grid.shape[0] * kept.cell_m)
    axes.imshow(image, origin="lower", extent=extent, interpolation="nearest")


def _trajectory(axes: Axes, kept: FailureSnapshot) -> None:
    """Draw the path, lighter at its beginning; a ring at the start pose, a dot at the end."""
    path = kept.trajectory_m
    if len(path) > 1:
        ends = np.stack([path[:-1], path[1:]], axis=1)
        lines = LineCollection(list(ends), linewidths=1.8, capstyle="round")
        blend = np.linspace(0.35, 1.0, len(ends))[:, None]
        blue = np.array(to_rgb(PATH))
        lines.set_color(list(map(tuple, 1 - blend * (1 - blue))))
        axes.add_collection(lines)
    x, y, yaw = kept.start_pose
    axes.plot(x, y, "o", mfc="white", mec=PATH, ms=6, mew=1.6)
    axes.plot([x, x + 0.35 * math.cos(yaw)], [y, y + 0.35 * math.sin(yaw)], color=PATH, lw=1.4)
    if len(path):
        axes.plot(*path[-1], "o", mfc=PATH, mec="white", ms=6.5, mew=1.2)


def _box(axes: Axes, thing: MarkedObject, colour: str, line: str, label: str, above: bool) -> None:
    """Draw the footprint around its centre, axis-aligned whatever the yaw."""
    (x, y, _), (w, d, _) = thing.center_m, thing.size_m
    w, d = max(w, 0.12), max(d, 0.12)
    axes.add_patch(Rectangle((x - w / 2, y - d / 2), w, d, fill=False, ec=colour, lw=1.7, ls=line))
    _write(axes, x, y + d / 2 if above else y - d / 2, label, colour, above)


def _star(axes: Axes, thing: MarkedObject) -> None:
    x, y, _ = thing.center_m
    axes.plot(x, y, "*", mfc=TRUTH, mec="white", ms=12, mew=0.9, zorder=5)
    _write(axes, x, y + 0.08, thing.label, TRUTH, above=True)


def _write(axes: Axes, x: float, y: float, words: str, colour: str, above: bool) -> None:
    axes.annotate(
        words[:40], (x, y), xytext=(0, 2 if above else -2), textcoords="offset points",
        ha="center", va="bottom" if above else "top", color=colour, fontweight="bold", zorder=6,
        annotation_clip=True, path_effects=[withStroke(linewidth=2.2, foreground="white")],
    )  # fmt: skip


def _settle_labels(figure: Figure, axes: Axes) -> None:
    """Move each label into the picture, and off the labels before it."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    px_per_pt, side_px = DPI / 72, SIZE_IN * DPI
    taken: list[Bbox] = []
    for label in axes.texts:
        if not isinstance(label, Annotation):
            continue
        box = label.get_window_extent(renderer)
        right_px = max(0.0, EDGE_PX - box.x0) - max(0.0, box.x1 - side_px + EDGE_PX)
        up_px = max(0.0, EDGE_PX - box.y0) - max(0.0, box.y1 - side_px + EDGE_PX)
        for step in (0, 1, -1, 2, -2, 3, -3):
            moved = box.translated(right_px, up_px + step * box.height)
            if not any(moved.overlaps(other) for other in taken):
                break
        else:
            moved = box.translated(right_px, up_px)
        taken.append(moved)
        x_pt, y_pt = label.xyann
        label.xyann = (
            x_pt + (moved.x0 - box.x0) / px_per_pt,
            y_pt + (moved.y0 - box.y0) / px_per_pt,
        )


def _frame(axes: Axes, kept: FailureSnapshot, believed: Sequence[MarkedObject]) -> None:
    """Set the view to a square around all that is known or marked; draw a bar of one metre."""
    rows, columns = np.nonzero(kept.occupancy >= 0)
    points = [kept.trajectory_m, np.array([kept.start_pose[:2]])]
    marks = [m.center_m[:2] for m in (*kept.candidates, *kept.goals, *believed)]
    if marks:
        points.append(np.array(marks))
    if len(rows):
        corners = np.array(
            [[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]], dtype=np.float64
        )
        points.append(corners * kept.cell_m + np.array(kept.origin_m))
    low, high = _bounds(np.concatenate(points))
    half = float((high - low).max()) / 2 + MARGIN_M
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.axis("off")
    x, y = middle[0] - half * 0.94, middle[1] - half * 0.94
    axes.plot([x, x + 1], [y, y], color="black", lw=2.5, solid_capstyle="butt")
    axes.text(x + 0.5, y + half * 0.02, "1 m", ha="center", va="bottom", fontsize=9)


def _bounds(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    finite = points[np.isfinite(points).all(axis=1)]
    return finite.min(axis=0), finite.max(axis=0)


def _smaller(png: bytes) -> bytes:
    """PNG with a colour palette: a third of the bytes."""
    from PIL import Image

    out = io.BytesIO()
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(out, format="png", optimize=True)
    return out.getvalue()
