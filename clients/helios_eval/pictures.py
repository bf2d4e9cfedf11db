"""Pictures of a run for people."""

from __future__ import annotations

import io
from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import object_from_proto
from helios_core.topics import GAUSSIANS, OBJECTS
from numpy.typing import NDArray

mpl.use("Agg")

CALL_S = 20.0
MOST_POINTS = 60_000


def object_picture(bus: Bus, occupancy: Mapping[str, NDArray]) -> bytes:
    """PNG of the object map from above: every Gaussian in its colour, instances with their Ψ.

    `occupancy` holds the arrays of `/v1/map/occupancy.npz`.
    """
    from matplotlib import pyplot as plt

    reply = bus.call(GAUSSIANS, pb.GaussiansRequest(), CALL_S)
    listed = bus.call(OBJECTS, pb.ObjectsRequest(), CALL_S)
    objects = sorted(map(object_from_proto, listed.objects), key=lambda o: -o.score)
    means = np.frombuffer(reply.means_m, "<f4").reshape(-1, 3)
    colors = np.frombuffer(reply.colors, np.uint8).reshape(-1, 3) / 255.0
    figure, axes = plt.subplots(figsize=(10, 8), dpi=110)
    grid = occupancy["occupancy"]
    x0, y0 = (float(v) for v in occupancy["origin_m"])
    cell_m = float(occupancy["cell_m"])
    shade = np.select([grid == 100, grid == 0], [0.45, 0.97], 0.85)
    extent = (x0, x0 + grid.shape[1] * cell_m, y0, y0 + grid.shape[0] * cell_m)
    axes.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent)
    if len(means):
        shown = np.random.default_rng(0).permutation(len(means))[:MOST_POINTS]
        shown = shown[np.argsort(means[shown, 2])]  # higher ones on top
        axes.scatter(means[shown, 0], means[shown, 1], s=1.5, c=colors[shown], linewidths=0)
    for o in (o for o in objects if o.class_score >= 0.3):
        believed = o.score >= 0.5
        axes.annotate(
            f"{o.class_name}  Ψ {o.score:.2f}", xy=(o.center_m[0], o.center_m[1]), fontsize=8,
            ha="center", color="white",
            bbox={"boxstyle": "round,pad=0.25", "lw": 0,
                  "fc": "#1b6e3c" if believed else "#8a5a00", "alpha": 0.85},
        )  # fmt: skip
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(f"Object map: {len(means)} Gaussians, {len(objects)} instances (Ψ ≥ 0.5 green)")
    out = io.BytesIO()
    figure.savefig(out, format="png", bbox_inches="tight")
    plt.close(figure)
    return out.getvalue()
