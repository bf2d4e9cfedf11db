"""Contents of a fake world: boxes on its floor, and objects that a detector may report."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from helios_planner.decisions.held_object import HeldObject
from numpy.typing import NDArray

UNKNOWN = HeldObject(1.0, 0, ())


@dataclass
class Box:
    """A box on the floor: x0, y0, x1, y1, height; hidden ones are never seen, only touched."""

    x0: float
    y0: float
    x1: float
    y1: float
    top_m: float
    hidden: bool = False


@dataclass
class Thing:
    """An object that a detector can see. rate: share of views in which it is detected."""

    id: int
    class_name: str
    center_m: NDArray[np.float64]
    size_m: NDArray[np.float64]
    rate: float = 1.0
    views: list[tuple[float, float, float]] = field(default_factory=list)
    graspable: bool = True
    slippery: int = 0  # picks that fail first
    in_hand: HeldObject = UNKNOWN  # what it looks like in the hand
    remembered: bool = False  # the object map has it from a stored map

    def score_at(self, views: int) -> tuple[float, float, float]:
        """Return (Psi, S, U) after that many views (eq. 4, 7), four classes, alpha_cpa 3."""
        total = 4.0 + 3.0 * views
        s = (1.0 + 3.0 * views * self.rate) / total
        u = math.sqrt(s * (1 - s) / (1 + total))
        return s - u, s, u


def corners_of(thing: Thing) -> NDArray[np.float64]:
    """Return the corners [8, 3] of an object's box."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return thing.center_m + signs * thing.size_m / 2
