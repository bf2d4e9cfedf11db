"""Does a thing measure what things of its class usually do?

`sizes.toml` says what is usual: ranges of the longest horizontal side, the other one, and the
height. A class that is not in it has no usual size, and everything agrees with it. Beyond a range
the likelihood falls as a log-normal one, so that twice and half as much are equally strange. With
the measured side e, the range [lo, hi], sigma and the error of a box eps,

    small = max(0, ln(lo / (e + eps)) / sigma)^2, of the longest horizontal side
    large = sum over the sides of max(0, ln((e - eps) / hi) / sigma)^2
    agreement = (1 - w + w exp(-small / 2)) (m + (1 - m) exp(-large / 2)),    w = v / (v + v0)

Each factor is a mixture of two ways in which a true thing gets such a box. Too small: it was seen
in part, and then its box says nothing; or it was seen whole, with a chance w that grows with its
views v. Too large: it is joined with a thing beside it, with the small chance m; or the box is its
own. So what is too small costs nothing at first and never all, and what is too large costs nearly
all at once.

Views make only the longest horizontal side whole: what stands beside a thing, or the image's edge,
hides other parts of it from each place. The height and the depth may be cut in every view: table
tops hide legs and seats, and a thing hides its own back. There, too small means nothing.

A thing that may lie on any side is compared in all three ways, and the best counts.

What stands on the floor has its top as high above it as the thing is high, and tops are seen from
afar also where little else is. So where the floor is known the height of the top is its third side,
and a top that is too low costs what a too large side does: a rug is no bed, and a television on a
wall is no washing machine.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

import cv2
import numpy as np
from numpy.typing import NDArray

EDGE_SIGMA = 0.25  # one in three of the few things beyond a range is so by more than a quarter
BOX_ERROR_M = 0.03  # of a side: depth noise, and a pixel of a mask's edge on both ends
HALF_WHOLE_VIEWS = 10.0  # v0: a walk of 0.8 m, or a turn of 40 degrees, past a thing
JOINED = 0.05  # m: share of true things whose box holds more than themselves
LEAST_M = 1e-3

Extents = NDArray[np.float64]  # [3] longest horizontal side, the other one, height; metres


@dataclass(frozen=True)
class UsualSize:
    """What things of a class usually measure."""

    least_m: Extents
    most_m: Extents
    lies: bool  # may lie on any of its sides
    on_floor: bool  # is as high as its top is above the floor


def extents_of(outline_m: NDArray[np.float64], height_m: float) -> Extents:
    """Of the smallest upright box around an outline [k, 2], k at least 1."""
    _, across, _ = cv2.minAreaRect(np.ascontiguousarray(outline_m, np.float32))
    return np.array([max(across), min(across), height_m])


def usual_extents(class_name: str) -> UsualSize | None:
    """None where nothing is known of the class."""
    name = " ".join(class_name.replace("_", " ").replace("-", " ").lower().split())
    return _table().get(name)


def agreement(
    class_name: str, measured_m: Extents, views: float, top_m: float | None = None
) -> float:
    """Likelihood in (0, 1] of what was measured, by that of a usual thing of the class.

    views: sum of the weights of the views that saw it; with 0, nothing is too small. top_m: of its
    top above the floor, None where the floor is unknown.
    """
    usual = usual_extents(class_name)
    if usual is None:
        return 1.0
    if usual.on_floor and top_m is not None:
        standing = np.array([*measured_m[:2], max(top_m, LEAST_M)])
        return _likelihood(usual, standing, views, too_low=_short(usual, standing, 2))
    ways = _ways_to_lie(measured_m) if usual.lies else (measured_m,)
    return max(_likelihood(usual, way, views) for way in ways)


def _ways_to_lie(measured_m: Extents) -> tuple[Extents, ...]:
    """The same box with each of its sides as the height."""
    out = []
    for up in range(3):
        across = np.sort(np.delete(measured_m, up))
        out.append(np.array([across[1], across[0], measured_m[up]]))
    return tuple(out)


def _short(usual: UsualSize, measured_m: Extents, side: int) -> float:
    """Square of how far a side is below what is usual, in sigmas."""
    short = math.log(usual.least_m[side] / (measured_m[side] + BOX_ERROR_M)) / EDGE_SIGMA
    return max(short, 0.0) ** 2


def _likelihood(usual: UsualSize, measured_m: Extents, views: float, too_low: float = 0.0) -> float:
    beyond = np.log(np.maximum(measured_m - BOX_ERROR_M, LEAST_M) / usual.most_m) / EDGE_SIGMA
    large = float((np.maximum(beyond, 0) ** 2).sum()) + too_low
    whole = views / (views + HALF_WHOLE_VIEWS)
    fits = 1 - whole + whole * math.exp(-_short(usual, measured_m, 0) / 2)
    return fits * (JOINED + (1 - JOINED) * math.exp(-large / 2))


@cache
def _table() -> Mapping[str, UsualSize]:
    text = resources.files("helios_objectmap").joinpath("sizes.toml").read_text()
    out = {}
    for kind, rows in tomllib.loads(text).items():
        for names, ranges in rows.items():
            least, most = np.array(ranges, np.float64).T
            for name in names.split(", "):
                out[name] = UsualSize(least, most, kind == "lies", kind == "floor")
    return out
