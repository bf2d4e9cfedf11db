"""Charts of the runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from helios_core.atomic_file import replacing
from matplotlib.axes import Axes
from numpy.typing import NDArray

from helios_eval.palette import BLUE, GREEN, GREY, VERMILION
from helios_eval.studies.map_growth.full_scene_comparison import Growth
from helios_eval.studies.map_growth.long_run import LongRunResult
from helios_eval.studies.map_growth.update_cost import Cost

mpl.use("Agg")
WIDTH_IN, DPI = 9.0, 110


def cost(run: Cost, path: Path) -> None:
    """Draw the Gaussians mapped and in view, and the cost of an update against those mapped."""
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(
        1, 2, figsize=(WIDTH_IN, 3.6), dpi=DPI, layout="constrained"
    )
    frames = np.arange(run.mapped.size)
    left.plot(frames, run.mapped.ravel() / 1e3, color=GREY, label="in the map")
    left.plot(frames, run.in_view.ravel() / 1e3, color=BLUE, lw=0.8, label="in view")
    left.set(xlabel="frame", ylabel="thousand Gaussians", ylim=(0, None))
    left.legend(frameon=False)
    mapped = np.median(run.mapped, axis=1) / 1e3
    low, middle, high = np.quantile(run.cpu_ms, (0.25, 0.5, 0.75), axis=1)
    right.fill_between(mapped, low, high, color=GREEN, alpha=0.2, lw=0, label="half of all frames")
    right.plot(mapped, middle, color=GREEN, marker="o", ms=4, label="median of a lap")
    right.set(
        xlabel="thousand Gaussians in the map",
        ylabel="CPU ms of an update",
        xlim=(0, None),
        ylim=(0, 1.5 * float(high.max())),
    )
    right.legend(frameon=False)
    _finish(figure, (left, right), path)


def scene(runs: Mapping[str, Growth], path: Path) -> None:
    """Draw Gaussians, bytes and time per frame of the two maps over an episode."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(WIDTH_IN, 3.2), dpi=DPI, layout="constrained")
    for (name, run), color in zip(runs.items(), (BLUE, VERMILION), strict=True):
        axes[0].plot(run.gaussians / 1e3, color=color, label=name)
        axes[1].plot(run.mb, color=color)
        axes[2].plot(_smooth(run.cpu_ms), color=color)
    labels = ("thousand Gaussians", "MB of Gaussians", "CPU ms of an update, median of 15")
    for axis, label in zip(axes, labels, strict=True):
        axis.set(xlabel="frame", ylabel=label, ylim=(0, None))
    axes[0].legend(frameon=False)
    _finish(figure, tuple(axes), path)


def memory(mb: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Draw the memory of each map by step: mean and middle 80 % of the episodes.

    mb: by name of the map, [episodes, steps].
    """
    from matplotlib import pyplot as plt

    episodes = max(len(values) for values in mb.values())
    figure, axis = plt.subplots(figsize=(WIDTH_IN * 0.7, 3.6), dpi=DPI, layout="constrained")
    for (name, values), color in zip(mb.items(), (BLUE, VERMILION), strict=True):
        low, high = np.quantile(values, (0.1, 0.9), axis=0)
        steps = np.arange(values.shape[1])
        axis.fill_between(steps, low, high, color=color, alpha=0.2, lw=0)
        axis.plot(steps, values.mean(axis=0), color=color, label=name)
    axis.set(xlabel="step", ylabel="MB of Gaussians", xlim=(0, None), ylim=(0, None))
    axis.legend(frameon=False, title=f"mean and middle 80 % of {episodes} episodes")
    _finish(figure, (axis,), path)


def hours(run: LongRunResult, path: Path) -> None:
    """Draw memory and Gaussians over hours of robot time."""
    from matplotlib import pyplot as plt

    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(WIDTH_IN, 4.6), dpi=DPI, layout="constrained", sharex=True
    )
    at_h = np.array([s.frame for s in run.samples]) * run.every_s / 3600
    upper.plot(at_h, [s.gaussians / 1e3 for s in run.samples], color=GREY)
    upper.set(ylabel="thousand Gaussians", ylim=(0, None))
    lower.plot(at_h, [s.rss_mb for s in run.samples], color=BLUE)
    lower.set(xlabel="hours of the robot", ylabel="memory of the process, MB", ylim=(0, None))
    _finish(figure, (upper, lower), path)


def _smooth(values: np.ndarray, width: int = 15) -> np.ndarray:
    padded = np.pad(values, width // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)


def _finish(figure, axes: tuple[Axes, ...], path: Path) -> None:
    from matplotlib import pyplot as plt

    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        figure.savefig(temporary)
    plt.close(figure)
