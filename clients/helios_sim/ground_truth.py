"""Ground-truth types, only for the simulated detector and the evaluation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix
from numpy.typing import NDArray


@dataclass(frozen=True)
class VisibleBody:
    """One body of the home that an image shows."""

    id: int
    name: str
    class_name: str
    graspable: bool
    center_m: tuple[float, float, float]  # world
    on: str = ""  # body on which a graspable object stands; empty for furniture
    turn_rad: float = 0.0  # of a shown object from how it was grasped, about the vertical


@dataclass(frozen=True)
class Segmentation:
    """Instance id of each pixel of an image; 0 is background."""

    stamp_ns: int
    ids: NDArray[np.int32]  # [h, w]
    instances: tuple[VisibleBody, ...]  # visible in the image
    T_world_cam: Matrix  # [4, 4] true pose of the camera, whatever pose the robot reports


@dataclass(frozen=True)
class TrueObjectState:
    """Current state of one piece of furniture or movable object. World frame, metres."""

    name: str
    class_name: str
    center_m: tuple[float, float, float]  # of its box
    size_m: tuple[float, float, float]  # of its box: along its rotated x and y axes, and upwards
    yaw_rad: float
    graspable: bool
    on: str = ""  # body that a graspable object was put on; empty: held, or on the floor
