"""State of relocalisation over time: a fix counts only if new data confirms it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from helios_map2d.relocalisation.poses import Transform2

if TYPE_CHECKING:
    from helios_map2d.relocalisation.alignment import Alignment

AGREES_M, AGREES_RAD = 0.15, math.radians(3)  # between two alignments that confirm each other
NEW_M2 = 0.5  # area that becomes known between them, at least


class PlaceState(StrEnum):
    """What is known of the place of a stored map in the present frame."""

    UNKNOWN = "unknown"
    TENTATIVE = "tentative"  # one alignment passed; nothing may drive there
    RELOCALISED = "relocalised"


@dataclass(frozen=True)
class Fix:
    """Present estimate of the place of a stored map."""

    state: PlaceState = PlaceState.UNKNOWN
    T_stored_present: Transform2 | None = None  # None while unknown
    known_m2: float = 0.0  # area of the present map at the last alignment that passed

    def after(self, found: Alignment | None, known_m2: float, robot_m: NDArray[np.float64]) -> Fix:
        """Estimate after another alignment. known_m2: area of the present map; robot_m: position
        [2] of the robot in the present frame.

        A fix needs two alignments in a row that pass and agree, the second with at least `NEW_M2`
        of new area. An alignment that does not pass, or does not agree, starts over.
        """
        if self.state is PlaceState.RELOCALISED:
            return self
        if found is None or found.reason:
            return Fix()
        T = found.T_stored_present
        if self.T_stored_present is not None:
            away_m, turned_rad = T.difference(self.T_stored_present, robot_m)
            if away_m <= AGREES_M and turned_rad <= AGREES_RAD:
                if known_m2 < self.known_m2 + NEW_M2:
                    return self
                return Fix(PlaceState.RELOCALISED, T, known_m2)
        return Fix(PlaceState.TENTATIVE, T, known_m2)
