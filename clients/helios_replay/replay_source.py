"""What a replay plays, whatever it was read from; `format_detection` finds the format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, Pinhole
from helios_core.types import RobotDescription
from numpy.typing import NDArray

CARRIED_RADIUS_M = 0.3  # of a person who carries a camera
DEFAULT_MAX_DEPTH_M = 5.0  # beyond it the depth of small consumer cameras is mostly noise


@dataclass(frozen=True)
class Shot:
    """One image: when it was taken and where its camera was."""

    time_s: float  # since the recording began, of the clock that paces it
    stamp_ns: int  # the robot's clock
    T_world_cam: Matrix  # [4, 4]


@dataclass(frozen=True)
class Picture:
    """The pixels of one shot, and what else is known of it."""

    color: NDArray[np.uint8]  # [h, w, 3] RGB
    depth_m: NDArray[np.float32]  # [h, w]; 0 is invalid
    camera: Pinhole
    T_world_base: Matrix | None = None  # None: below the camera
    recorded: pb.Frame | None = None  # the message it was sent as


class Source(Protocol):
    """Images in the order in which they were taken; pixels are read one by one."""

    @property
    def name(self) -> str: ...

    @property
    def shots(self) -> Sequence[Shot]: ...

    @property
    def left_out(self) -> str:
        """How many images are not played, of how many, and why; empty where all are."""
        ...

    def describe(self) -> RobotDescription:
        """The robot, as one that cannot act."""
        ...

    def read(self, index: int) -> Picture:
        """Raises InvalidInput, naming what cannot be read."""
        ...

    def contexts_before(self, index: int) -> Sequence[pb.SearchContext]:
        """The searches that began after the shot before and up to this one."""
        ...

    def state_after(self, index: int) -> pb.RobotState | None:
        """How the robot was when it had taken the shot (-1: before the first); None where nobody
        wrote it down."""
        ...

    def state_when_answered(self, index: int) -> pb.RobotState | None:
        """How the robot was by the time the detections of the shot came; None where unknown."""
        ...


@dataclass(frozen=True)
class Part:
    """Which part of a recording is played, and where in it things lie."""

    limit: int = 0  # shots; 0: all
    from_s: float = 0.0  # since the recording began
    to_s: float = float("inf")
    topics: str = ""  # of a ROS bag: "color=/a,depth=/b,info=/c,pose=/d"

    def of(self, times_s: Sequence[float], what: str) -> range:
        """The indices of a rising sequence that are in it. Raises InvalidInput when none is."""
        inside = [i for i, t in enumerate(times_s) if self.from_s <= t <= self.to_s]
        if not inside:
            length_s = times_s[-1] if times_s else 0.0
            raise InvalidInput(
                f"{what} has no frame from {self.from_s:g} s to {self.to_s:g} s; it is "
                f"{length_s:.1f} s long"
            )
        out = range(inside[0], inside[-1] + 1)
        return out[: self.limit] if self.limit else out


def left_out_of(images: int, played: int, why: str) -> str:
    """As `Source.left_out` says it."""
    return f"{images - played} of {images} images left out: {why}" if played < images else ""


def carried_camera(
    name: str, camera: Pinhole, heights_m: Sequence[float], max_depth_m: float
) -> RobotDescription:
    """A robot that cannot act, of a camera that somebody carries at these heights."""
    return RobotDescription(
        name=name,
        footprint_radius_m=CARRIED_RADIUS_M,
        height_m=float(max(heights_m)),
        camera=camera,
        camera_height_m=float(np.median(heights_m)),
        reach_m=0.0,
        max_depth_m=max_depth_m,
        can_move=False,
        can_pick=False,
        can_place=False,
    )


class Images:
    """What all sources of mere images share: no searches, no states, a camera that is carried."""

    def __init__(
        self, name: str, shots: Sequence[Shot], camera: Pinhole, max_depth_m: float,
        left_out: str = "",
    ) -> None:  # fmt: skip
        self._name, self._shots, self._camera = name, shots, camera
        self._max_depth_m, self._left_out = max_depth_m, left_out

    @property
    def name(self) -> str:
        return self._name

    @property
    def shots(self) -> Sequence[Shot]:
        return self._shots

    @property
    def left_out(self) -> str:
        return self._left_out

    def describe(self) -> RobotDescription:
        heights_m = [float(shot.T_world_cam[2, 3]) for shot in self._shots]
        return carried_camera(self._name, self._camera, heights_m, self._max_depth_m)

    def contexts_before(self, index: int) -> Sequence[pb.SearchContext]:
        return ()

    def state_after(self, index: int) -> pb.RobotState | None:
        return None

    def state_when_answered(self, index: int) -> pb.RobotState | None:
        return None
