"""Interface of replay sources, independent of the format; `format_detection` finds the format."""

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

CARRIED_RADIUS_M = 0.3  # footprint radius of a person who carries a camera
DEFAULT_MAX_DEPTH_M = 5.0  # depth of small consumer cameras is mostly noise beyond this


@dataclass(frozen=True)
class Shot:
    """Time and camera pose of one image."""

    time_s: float  # since the start of the recording, by the clock that paces the replay
    stamp_ns: int  # the robot's clock
    T_world_cam: Matrix  # [4, 4]


@dataclass(frozen=True)
class ShotPixels:
    """The pixels of one shot, its calibration, and its base pose and message if recorded."""

    color: NDArray[np.uint8]  # [h, w, 3] RGB
    depth_m: NDArray[np.float32]  # [h, w]; 0 is invalid
    camera: Pinhole
    T_world_base: Matrix | None = None  # None: the base is below the camera
    recorded: pb.Frame | None = None  # its original message


class Source(Protocol):
    """Replay source: images in the order of capture; the pixels are read one by one."""

    @property
    def name(self) -> str: ...

    @property
    def shots(self) -> Sequence[Shot]: ...

    @property
    def left_out(self) -> str:
        """Number of images left out, of the total, and the reason; empty if all are played."""
        ...

    def describe(self) -> RobotDescription:
        """Description of the robot, without any abilities to act."""
        ...

    def read(self, index: int) -> ShotPixels:
        """Pixels of one shot. Raises InvalidInput, which names the unreadable data."""
        ...

    def contexts_before(self, index: int) -> Sequence[pb.SearchContext]:
        """Search contexts that began after the previous shot and up to this one."""
        ...

    def state_after(self, index: int) -> pb.RobotState | None:
        """The robot's state after the shot (-1: before the first); None if not recorded."""
        ...

    def state_when_answered(self, index: int) -> pb.RobotState | None:
        """The robot's state when the shot's detections arrived; None if unknown."""
        ...


@dataclass(frozen=True)
class PlaybackRange:
    """The part of a recording to play, and the topics of a ROS bag."""

    limit: int = 0  # number of shots; 0: all
    from_s: float = 0.0  # since the start of the recording
    to_s: float = float("inf")
    topics: str = ""  # of a ROS bag: "color=/a,depth=/b,info=/c,pose=/d"

    def of(self, times_s: Sequence[float], what: str) -> range:
        """Indices of the ascending times in this part. Raises InvalidInput if there are none."""
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
    """Text for `Source.left_out`."""
    return f"{images - played} of {images} images left out: {why}" if played < images else ""


def carried_camera(
    name: str, camera: Pinhole, heights_m: Sequence[float], max_depth_m: float
) -> RobotDescription:
    """Description of a camera that a person carries at these heights: a robot that cannot act."""
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
    """Base of sources with images only: no search contexts, no robot states, a carried camera."""

    def __init__(
        self,
        name: str,
        shots: Sequence[Shot],
        camera: Pinhole,
        max_depth_m: float,
        left_out: str = "",
    ) -> None:
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
