"""Picture of the object map, for `make demo`."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import object_from_proto
from helios_core.topics import GAUSSIANS, OBJECTS
from helios_core.types import ObjectInstance
from helios_map2d.pictures.label_placement import Wanted, lead, placed
from numpy.typing import NDArray

from helios_eval.palette import GREEN, INK, MUTED, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

mpl.use("Agg")

CALL_S = 20.0
MOST_POINTS = 60_000
SURE, UNSURE = GREEN, VERMILION
UNKNOWN_RGB, FREE_RGB, OCCUPIED_RGB = (222, 226, 233), (255, 255, 255), (150, 158, 172)
LEAST_CLASS_SCORE, SURE_SCORE = 0.3, 0.5


def object_picture(bus: Bus, occupancy: Mapping[str, NDArray]) -> bytes:
    """PNG of the object map from above: Gaussians in their colours, instances with their Ψ.

    At most `MOST_POINTS` Gaussians are drawn. `occupancy`: the arrays of `/v1/map/occupancy.npz`.
    """
    from matplotlib import pyplot as plt

    reply = bus.call(GAUSSIANS, pb.GaussiansRequest(), CALL_S)
    listed = bus.call(OBJECTS, pb.ObjectsRequest(), CALL_S)
    objects = sorted(map(object_from_proto, listed.objects), key=lambda o: -o.score)
    means = np.frombuffer(reply.means_m, "<f4").reshape(-1, 3)
    colors = np.frombuffer(reply.colors, np.uint8).reshape(-1, 3) / 255.0
    figure, axes = plt.subplots(figsize=(10, 8.6), dpi=120)
    _draw_ground(axes, occupancy)
    if len(means):
        shown = np.random.default_rng(0).permutation(len(means))[:MOST_POINTS]
        shown = shown[np.argsort(means[shown, 2])]  # draw higher points last
        axes.scatter(means[shown, 0], means[shown, 1], s=1.5, c=colors[shown], linewidths=0)
    figure.text(0.5, 0.955, "Object map", ha="center", color=INK, fontsize=15, weight="bold")
    figure.text(
        0.5,
        0.93,
        f"{len(means):,} Gaussians, {len(objects)} instances; Ψ from {SURE_SCORE:g} on in green",
        ha="center",
        color=MUTED,
        fontsize=10,
    )
    figure.subplots_adjust(left=0.06, right=0.98, bottom=0.06, top=0.91)
    _draw_instances(axes, [o for o in objects if o.class_score >= LEAST_CLASS_SCORE])
    out = io.BytesIO()
    figure.savefig(out, format="png")
    plt.close(figure)
    return out.getvalue()


def _draw_ground(axes: Axes, occupancy: Mapping[str, NDArray]) -> None:
    grid, cell_m = occupancy["occupancy"], float(occupancy["cell_m"])
    x0, y0 = (float(v) for v in occupancy["origin_m"])
    picture = np.full((*grid.shape, 3), UNKNOWN_RGB, np.uint8)
    picture[grid == 0], picture[grid == 100] = FREE_RGB, OCCUPIED_RGB
    extent = (x0, x0 + grid.shape[1] * cell_m, y0, y0 + grid.shape[0] * cell_m)
    axes.imshow(picture, origin="lower", extent=extent, interpolation="nearest")
    axes.set_xlabel("x (m)", color=MUTED)
    axes.set_ylabel("y (m)", color=MUTED)
    axes.tick_params(colors=MUTED, length=0)
    axes.spines[:].set_visible(False)


def _draw_instances(axes: Axes, objects: Sequence[ObjectInstance]) -> None:
    """Draw the outline of each object, and a label that overlaps no other; earlier objects
    first."""
    from matplotlib.patches import Polygon

    figure = axes.figure
    figure.canvas.draw()  # fixes the transform from data to pixels
    to_px, to_data = axes.transData.transform, axes.transData.inverted().transform
    width_px, height_px = (round(v) for v in figure.bbox.size)
    texts, wanted = [], []
    for o in objects:
        (x, y), (w, d) = o.center_m[:2], o.size_m[:2]
        color = SURE if o.score >= SURE_SCORE else UNSURE
        around = np.array(
            [
                (x - w / 2, y - d / 2),
                (x + w / 2, y - d / 2),
                (x + w / 2, y + d / 2),
                (x - w / 2, y + d / 2),
            ]
        )
        outline = o.outline_m if len(o.outline_m) > 2 else around
        axes.add_patch(Polygon(outline, closed=True, fill=False, ec=color, lw=1.4))
        text = axes.text(
            x,
            y,
            f"{o.class_name}  Ψ {o.score:.2f}",
            fontsize=9,
            color="white",
            ha="left",
            va="bottom",
            bbox={"boxstyle": "round,pad=0.3", "lw": 0, "fc": color, "alpha": 0.92},
        )
        size = text.get_window_extent()
        (u0, v0), (u1, v1) = to_px([(x - w / 2, y - d / 2), (x + w / 2, y + d / 2)])
        texts.append((text, color))
        wanted.append(
            Wanted(size.width + 12, size.height + 10, (u0, height_px - v1, u1, height_px - v0))
        )
    places = placed(wanted, (width_px, height_px), [(0, 0, width_px, 0.09 * height_px)])
    for (text, color), want, place in zip(texts, wanted, places, strict=True):
        if place is None:
            text.remove()
            continue
        text.set_position(to_data((place[0] + 6, height_px - place[3] + 5)))
        if (line := lead(place, want.box_px)) is not None:
            ends = to_data([(u, height_px - v) for u, v in line])
            axes.plot(ends[:, 0], ends[:, 1], color=color, lw=1.0)
