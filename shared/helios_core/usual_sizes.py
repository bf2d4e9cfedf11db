"""Agreement of the measured size of an instance with the usual size of its class.

`sizes.toml` has the usual ranges of the longest horizontal side, the other one, and the height. A
class without an entry agrees with every size. Outside a range the likelihood falls like a
log-normal one, so that twice and half the size are equally unlikely. With the measured side e, the
range [lo, hi], sigma and the error of a box eps,

    small = max(0, ln(lo / (e + eps)) / sigma)^2, of the longest horizontal side
    large = sum over the sides of max(0, ln((e - eps) / hi) / sigma)^2
    agreement = (1 - w + w exp(-small / 2)) (m + (1 - m) exp(-large / 2)),    w = v / (v + v0)

Each factor is a mixture of two causes of the box of a true object. Too small: either the object was
seen in part, and its box is uninformative, or it was seen whole, with a probability w that grows
with its views v. Too large: either it is joined with an object beside it, with the small
probability m, or the box is its own. So a small box costs nothing at first and never everything; a
large one costs nearly everything at once.

Views complete only the longest horizontal side: neighbouring objects or the image's edge hide other
parts from each pose. Height and depth may be cut in every view, because table tops hide legs and
seats, and an object hides its own back. For these sides, a small value means nothing.

A class that may lie on any side is compared in all three ways, and the best counts.

An object that stands on the floor is as high as its top is above the floor, and a top is visible
from afar. So where the floor height is known, the height of the top is the third side, and a top
that is too low costs as much as a side that is too large: a rug is no bed, and a television on a
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

from helios_core.name_rules import plain

EDGE_SIGMA = 0.25  # one in three of the few objects outside a range is so by over a quarter
BOX_ERROR_M = 0.03  # per side: depth noise, and one pixel of the mask's edge at both ends
HALF_WHOLE_VIEWS = 10.0  # v0: 0.8 m of motion or 40 degrees of turn with the object in view
JOINED = 0.05  # m: share of true objects whose box contains a neighbour too
LEAST_M = 1e-3

Extents = NDArray[np.float64]  # [3] longest horizontal side, the other one, height; metres


@dataclass(frozen=True)
class UsualSize:
    """Usual size range of the objects of a class."""

    least_m: Extents
    most_m: Extents
    lies: bool  # may lie on any of its sides
    on_floor: bool  # stands on the floor: its height is that of its top


def extents_of(outline_m: NDArray[np.float64], height_m: float) -> Extents:
    """Extents of the smallest upright box around an outline [k, 2], k at least 1."""
    _, across, _ = cv2.minAreaRect(np.ascontiguousarray(outline_m, np.float32))
    return np.array([max(across), min(across), height_m])


def usual_extents(class_name: str) -> UsualSize | None:
    """Usual size of a class; None if the table lacks the class."""
    return _table().get(plain(class_name))


def agreement(
    class_name: str, measured_m: Extents, views: float, top_m: float | None = None
) -> float:
    """Likelihood, in (0, 1], of the measured size, relative to a usual object of the class.

    views: sum of the weights of its views; with 0, nothing is too small. top_m: height of its top
    above the floor, None if the floor height is unknown.
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
    """Extents of the same box with each of its sides as the height."""
    out = []
    for up in range(3):
        across = np.sort(np.delete(measured_m, up))
        out.append(np.array([across[1], across[0], measured_m[up]]))
    return tuple(out)


def _short(usual: UsualSize, measured_m: Extents, side: int) -> float:
    """Squared shortfall of a side below the usual range, in sigmas."""
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
    text = resources.files("helios_core").joinpath("sizes.toml").read_text()
    out = {}
    for kind, rows in tomllib.loads(text).items():
        for names, ranges in rows.items():
            least, most = np.array(ranges, np.float64).T
            for name in names.split(", "):
                out[name] = UsualSize(least, most, kind == "lies", kind == "floor")
    return out
