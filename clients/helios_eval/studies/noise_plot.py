"""Plot of a noise table: the simulated detector's errors on each class.

    python -m helios_eval.studies.noise_plot ovmm-v1 --out noise.png

Left: miss rate of each class at four sizes, and its confusion rate. Middle: which class is reported
as which. Right: sampled scores of true, confused and false detections, with the paper's thresholds;
miss rate by visible pixels; correlation of the draws of two views, by their angle.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from helios_core.atomic_file import replacing
from helios_core.errors import HeliosError, InvalidInput
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.view_noise import SECTORS, key_of, keys_of, normal_draws
from helios_detector.simulation.view_noise_table import Kind, ViewNoiseTable

from helios_eval.palette import GREEN, GREY, VERMILION

mpl.use("Agg")

THRESHOLDS = {"object": 0.25, "start": 0.35, "goal": 0.45}  # Table 3 of the paper
SIZES_PX = (100, 350, 1400, 10000)
COLORS: dict[Kind, str] = {"true": GREEN, "confused": VERMILION, "false": GREY}
DISTANCE_M = 2.5
SAMPLES = 4000


def view_table(name_or_path: str) -> ViewNoiseTable:
    """Noise table of the format "views". Raises InvalidInput for another format."""
    table = load_noise(name_or_path)
    if not isinstance(table, ViewNoiseTable):
        raise InvalidInput(f'{name_or_path!r} has no format = "views"; name a table like ovmm-v1')
    return table


def alike(table: ViewNoiseTable) -> np.ndarray:
    """Mean correlation [12] of draws for one object in two frames, by sectors between the views."""
    keys = np.array([key_of(str(n)) for n in range(SAMPLES)], np.uint64)
    purpose = keys_of(("miss",))

    def draws(sector: int, stamp_ns: int) -> np.ndarray:
        angle_rad = (sector + 0.5) * math.tau / SECTORS
        eye_m = DISTANCE_M * np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])
        views, _ = table.views(keys, eye_m, np.zeros((SAMPLES, 3)), None)
        return normal_draws(views, purpose, table.shares, stamp_ns)[:, 0]

    first = [draws(sector, 1) for sector in range(SECTORS)]
    later = [draws(sector, 2) for sector in range(SECTORS)]
    return np.array(
        [
            np.mean([np.corrcoef(first[s], later[(s + k) % SECTORS])[0, 1] for s in range(SECTORS)])
            for k in range(SECTORS)
        ]
    )


def draw(table: ViewNoiseTable, path: Path) -> None:
    """Write the plot."""
    from matplotlib import pyplot as plt

    names = list(table.rows)  # similar classes are adjacent in the file
    figure = plt.figure(figsize=(25, 18), dpi=90, layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=(6, 12, 6))
    left, middle, right = (figure.add_subfigure(grid[0, k]) for k in range(3))
    _rates(table, names, left.subplots(1, 2, sharey=True))
    _matrix(table, names, middle.subplots())
    scores, pixels, views = right.subplots(3, 1)
    _scores(table, scores)
    _by_pixels(table, pixels)
    _by_angle(table, views)
    figure.suptitle(
        f"{table.name} @ {table.digest}, level {table.level:g}: scale confuse "
        f"{table.file.scale.confuse:g}, second {table.file.scale.second:g}, "
        f"miss {table.file.scale.miss:g}, false {table.file.scale.false:g}",
        fontsize=18,
    )
    with replacing(path) as temporary:
        figure.savefig(temporary)
    plt.close(figure)


def _rates(table: ViewNoiseTable, names: list[str], axes) -> None:
    rows = np.arange(len(names))
    for size, shade in zip(SIZES_PX, ("#08306b", "#2171b5", "#6baed6", "#c6dbef"), strict=True):
        n = len(names)
        rate = table.miss(names, np.full(n, size), np.full(n, DISTANCE_M))
        axes[0].barh(rows, rate, 0.8, color=shade, label=f"{size} px")
    axes[0].set(title=f"missed at {DISTANCE_M:g} m", xlim=(0, 1), yticks=rows)
    axes[0].set_yticklabels(names, fontsize=8)
    axes[0].legend(loc="upper right", fontsize=9, framealpha=0.95)
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    axes[1].barh(rows, [table.confuse(name) for name in names], 0.8, color=VERMILION)
    axes[1].set(title="taken for another", xlim=(0, 1))
    for each in axes:
        each.grid(axis="x", alpha=0.3)


def _matrix(table: ViewNoiseTable, names: list[str], axes) -> None:
    taken = {name for row in table.rows.values() for name in row.names}
    reported = [*(n for n in names if n in taken), *sorted(taken - set(names))]
    grid = np.full((len(names), len(reported)), np.nan)
    for r, name in enumerate(names):
        row, total = table.rows[name], table.confuse(name)
        for other, share in zip(row.names, np.diff(row.upto, prepend=0), strict=True):
            grid[r, reported.index(other)] = total * share
    shown = axes.imshow(grid, cmap="YlOrRd", vmin=0, aspect="auto")
    axes.set(title="true class (row) reported as (column)", yticks=range(len(names)))
    axes.set_yticklabels(names, fontsize=8)
    axes.set_xticks(range(len(reported)), reported, rotation=90, fontsize=8)
    axes.grid(alpha=0.15)
    axes.figure.colorbar(shown, ax=axes, shrink=0.3, label="probability")


def _scores(table: ViewNoiseTable, axes) -> None:
    u = (np.arange(SAMPLES) + 0.5) / SAMPLES
    for kind, color in COLORS.items():
        scores = [table.score(kind, x, 1000) for x in u]
        axes.hist(
            scores,
            np.linspace(0, 1, 51),
            histtype="stepfilled",
            alpha=0.35,
            color=color,
            label=f"{kind}: {np.mean(np.array(scores) >= 0.25):.0%} above 0.25",
            density=True,
        )
    for name, threshold in THRESHOLDS.items():
        axes.axvline(threshold, color="k", lw=1, ls=":")
        axes.text(threshold + 0.005, 3.95, name, rotation=90, va="top", fontsize=9)
    axes.set(ylim=(0, 4), title="scores (1000 px)", xlabel="score", ylabel="density")
    axes.legend()


def _by_pixels(table: ViewNoiseTable, axes) -> None:
    pixels = np.geomspace(10, 100_000, 200).astype(np.int64)
    for name in ("mug", "remote control", "side table", "sofa"):
        rate = table.miss([name] * 200, pixels, np.full(200, DISTANCE_M))
        axes.semilogx(pixels, rate, lw=2, label=name)
    for distance_m, pixels_of_mug in ((1, 1400), (2, 350), (3, 150), (5, 55)):
        axes.axvline(pixels_of_mug, color="k", lw=0.5, ls=":")
        axes.text(
            pixels_of_mug, 0.02, f" mug at {distance_m} m", rotation=90, va="bottom", fontsize=8
        )
    axes.set(title=f"missed at {DISTANCE_M:g} m", xlabel="visible pixels", ylim=(0, 1.02))
    axes.legend()
    axes.grid(alpha=0.3)


def _by_angle(table: ViewNoiseTable, axes) -> None:
    degrees = np.arange(SECTORS // 2 + 1) * 360 / SECTORS
    axes.plot(degrees, alike(table)[: len(degrees)], "o-")
    s = table.shares
    axes.set(
        title=f"draws of two frames: thing {s.thing:g}, side {s.side:g}, view {s.view:g}, "
        f"frame {s.frame:g}",
        xlabel="angle between the views (degrees)",
        ylabel="correlation",
        ylim=(0, 1),
    )
    axes.grid(alpha=0.3)


def main() -> int:
    parser = argparse.ArgumentParser(description="Draw what a noise table does.")
    parser.add_argument("table", help="ovmm-v1, or a file of that format")
    parser.add_argument("--out", type=Path, required=True, help="PNG to write")
    parser.add_argument("--level", type=float, default=1.0, help="multiplies every rate")
    parser.add_argument("--correlation", type=float, default=None, help="0 to 1")
    given = parser.parse_args()
    try:
        table = view_table(given.table).scaled(given.level, given.correlation)
    except HeliosError as error:
        print(error.message, file=sys.stderr)
        return 2
    given.out.parent.mkdir(parents=True, exist_ok=True)
    draw(table, given.out)
    print(given.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
