"""What only the simulated detector and the evaluation may know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TruthInstance:
    """One body of the home that is seen in a picture."""

    id: int
    name: str
    class_name: str
    graspable: bool
    center_m: tuple[float, float, float]  # world
    on: str = ""  # body on which it stands, as far as it is a graspable thing


@dataclass(frozen=True)
class Segmentation:
    """Which instance each pixel of a picture shows; 0 is background."""

    stamp_ns: int
    ids: NDArray[np.int32]  # [h, w]
    instances: tuple[TruthInstance, ...]  # those that the picture shows


@dataclass(frozen=True)
class TrueThing:
    """One piece of furniture or movable thing as it is now. World frame, metres."""

    name: str
    class_name: str
    center_m: tuple[float, float, float]  # of its box
    size_m: tuple[float, float, float]  # of its box: along its turned x and y, and upwards
    yaw_rad: float
    graspable: bool
    on: str = ""  # receptacle that a graspable thing was put on; empty: held, or on the floor
