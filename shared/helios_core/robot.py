"""What a robot must offer: subclass `RobotDriver`, then `helios up --robot my_package:MyRobot`.

The bridge hosts one driver, gives frames their identity, keeps the lease and the results of
actions, and calls the driver from one thread at a time, except for `stop`, `clear_stop` and
`state`, which may come from another thread while an action runs. `python -m helios_contract
my_package:MyRobot` says whether a driver keeps all that is asked here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.geometry import Matrix, Pinhole
from helios_core.types import RobotDescription, RobotState


@dataclass(frozen=True)
class Forward:
    """Drive straight ahead; below 0 straight back, where the description allows it."""

    distance_m: float


@dataclass(frozen=True)
class Turn:
    """Turn on the spot; positive turns left."""

    angle_rad: float


@dataclass(frozen=True)
class Tilt:
    """Point the head; absolute, positive looks down."""

    angle_rad: float


@dataclass(frozen=True)
class Pick:
    """Grasp the thing at a point of the world."""

    point_world_m: tuple[float, float, float]
    class_name: str


@dataclass(frozen=True)
class Place:
    """Release the held thing above a point of the world."""

    point_world_m: tuple[float, float, float]


@dataclass(frozen=True)
class Observe:
    """Do nothing but look."""


Action = Forward | Turn | Tilt | Pick | Place | Observe


@dataclass(frozen=True)
class ActionResult:
    """What came of an action, as the robot itself measured it."""

    succeeded: bool
    reason: str = ""  # one sentence when it failed
    moved_m: float = 0.0
    turned_rad: float = 0.0
    collided: bool = False
    steps: int = 0  # of the robot since it started


@dataclass(frozen=True)
class Capture:
    """One posed RGB-D image as the driver gives it; the bridge makes a Frame of it."""

    stamp_ns: int
    color: NDArray[np.uint8]  # [h, w, 3] RGB
    depth_m: NDArray[np.float32]  # [h, w]; 0 is invalid
    camera: Pinhole
    T_world_cam: Matrix
    T_world_base: Matrix
    recorded: pb.Frame | None = None  # of a replay: sent as it is, identity and all
    searching: bool = True  # False before a replay's first search: no detector answers it


class EndOfRecording(Exception):
    """Raised by `capture` when a recording has no further frame."""


class RobotDriver(ABC):
    """A robot. Errors are raised as `helios_core.errors`; a failed action is a result, no error."""

    @abstractmethod
    def describe(self) -> RobotDescription:
        """What the robot is; constant while the driver lives."""

    @abstractmethod
    def state(self) -> RobotState:
        """How the robot is; where it has no boot id, the bridge gives it one. From any thread."""

    @abstractmethod
    def capture(self) -> Capture:
        """The newest image. Raises EndOfRecording when a recording is over."""

    @abstractmethod
    def act(self, action: Action, action_id: str) -> ActionResult:
        """Do it and wait until it is done. The same id is done once, then answered from memory."""

    @abstractmethod
    def stop(self, reason: str) -> None:
        """Stop now, and until `clear_stop` refuse every action, by a failed result or Conflict that
        gives the reason. May come from any thread."""

    @abstractmethod
    def clear_stop(self) -> None:
        """Allow actions again, for good: what was before never brings the stop back. Raises
        Conflict, which says who or what still holds the robot; then it stays stopped. From any
        thread."""

    def close(self) -> None:
        """Let go of the robot."""
        return
