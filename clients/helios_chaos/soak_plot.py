"""Plot of a soak: memory, handles, threads and latency of each service, and the state folder."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path

from helios_core.atomic_file import write_file
from matplotlib.figure import Figure

from helios_chaos.resources import Sample

Value = Callable[[Sample], float | None]
PANELS: tuple[tuple[str, Value], ...] = (
    ("memory (MB)", lambda s: s.rss_mb),
    ("open handles", lambda s: s.handles),
    ("threads", lambda s: s.threads),
    ("latency of a read (ms)", lambda s: s.latency_ms),
)


def plot(samples: Sequence[Sample], path: Path) -> None:
    """Write the plot as a PNG."""
    figure = Figure(figsize=(11, 13), layout="constrained")
    axes = figure.subplots(len(PANELS) + 1, 1, sharex=True)
    services = list(dict.fromkeys(s.service for s in samples))
    for panel, (title, value) in zip(axes, PANELS, strict=False):
        for n, service in enumerate(services):
            pairs = [(s.at_s / 60, value(s)) for s in samples if s.service == service]
            points = [(at, y) for at, y in pairs if y is not None]
            if points:
                panel.plot(*zip(*points, strict=True), label=service, color=f"C{n}", linewidth=1.2)
        panel.set_ylabel(title)
        panel.set_ylim(bottom=0)
        panel.grid(alpha=0.3)
    axes[0].legend(ncols=4, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.3))
    axes[-1].plot([s.at_s / 60 for s in samples], [s.state_mb for s in samples], color="black")
    axes[-1].set_ylabel("state folder (MB)")
    axes[-1].set_ylim(bottom=0)
    axes[-1].set_xlabel("minutes")
    axes[-1].grid(alpha=0.3)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    write_file(path, picture.getvalue())
