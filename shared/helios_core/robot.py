"""Driver interface of a robot: subclass `RobotDriver`, then `helios up --robot my_package:MyRobot`.

The bridge hosts one driver, assigns frame ids, and manages the lease and the results of actions. It
calls the driver from one thread at a time, except for `stop`, `clear_stop` and `state`, which may
be called from another thread while an action runs. `python -m helios_contract my_package:MyRobot`
tests whether a driver meets this interface.
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
    """Drive straight ahead; a negative distance drives back, if the description allows it."""

    distance_m: float


@dataclass(frozen=True)
class Turn:
    """Turn in place; a positive angle turns left."""

    angle_rad: float


@dataclass(frozen=True)
class Tilt:
    """Tilt the head to an absolute angle; a positive angle looks down."""

    angle_rad: float


@dataclass(frozen=True)
class Pick:
    """Grasp the object at a world point."""

    point_world_m: tuple[float, float, float]
    class_name: str


@dataclass(frozen=True)
class Place:
    """Release the held object above a world point."""

    point_world_m: tuple[float, float, float]


@dataclass(frozen=True)
class Observe:
    """Take an image without moving."""


@dataclass(frozen=True)
class Show:
    """Hold the held object at `RobotDescription.show_base_m`, turned about the vertical from how it
    was carried; a positive angle turns left. It stays there until the next Forward, Turn or Place.
    """

    angle_rad: float


Action = Forward | Turn | Tilt | Pick | Place | Observe | Show


@dataclass(frozen=True)
class ActionResult:
    """Result of an action, as measured by the robot."""

    succeeded: bool
    reason: str = ""  # one sentence, if the action failed
    moved_m: float = 0.0  # length of the way, also of one back; never below 0
    turned_rad: float = 0.0
    collided: bool = False
    steps: int = 0  # steps of the robot since its start


@dataclass(frozen=True)
class Capture:
    """Posed RGB-D image from the driver; the bridge makes a Frame from it."""

    stamp_ns: int
    color: NDArray[np.uint8]  # [h, w, 3] RGB
    depth_m: NDArray[np.float32]  # [h, w]; 0 is invalid
    camera: Pinhole
    T_world_cam: Matrix
    T_world_base: Matrix
    recorded: pb.Frame | None = None  # frame of a replay, published unchanged, with its id
    searching: bool = True  # False before the first search of a replay: no detector answers


class EndOfRecording(Exception):
    """Raised by `capture` if a recording has no further frame."""


class RobotDriver(ABC):
    """Base class of a robot driver.

    Methods raise `helios_core.errors`; a failed action returns a result instead.
    """

    @abstractmethod
    def describe(self) -> RobotDescription:
        """Description of the robot; constant during the driver's lifetime."""

    @abstractmethod
    def state(self) -> RobotState:
        """State of the robot; the bridge adds a missing boot id. Called from any thread."""

    @abstractmethod
    def capture(self) -> Capture:
        """Newest image. Raises EndOfRecording at the end of a recording."""

    @abstractmethod
    def act(self, action: Action, action_id: str) -> ActionResult:
        """Execute an action and wait for its end. For a repeated id return the stored result."""

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        """Execute an action like `act`, and take up to `hz` images per second while it runs.

        Optional: `helios doctor --robot` measures the time between images and poses with them. The
        default takes no image; `helios_core.robot_checks.watching` helps to take some.
        """
        return self.act(action, action_id), ()

    @abstractmethod
    def stop(self, reason: str) -> None:
        """Stop now and refuse every action until `clear_stop`, with a failed result or a Conflict
        that gives the reason. Called from any thread."""

    @abstractmethod
    def clear_stop(self) -> None:
        """Allow actions again; an earlier cause must not restore the stop.

        Raises Conflict, which names the remaining cause, if the robot must stay stopped. Called
        from any thread, while no action runs.
        """

    def close(self) -> None:
        """Release the robot."""
        return
