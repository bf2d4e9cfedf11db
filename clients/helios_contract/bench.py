"""A detector or a scorer on the test bench, and the frames that it is shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import cv2
import numpy as np
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.types import Frame, FrameId, Role, SearchClass, SearchContext
from helios_detector.backend import DetectorBackend, ScorerBackend
from helios_examples.room import look

B = TypeVar("B", DetectorBackend, ScorerBackend)

CAMERA = Pinhole(fx=140, fy=140, cx=79.5, cy=59.5, width=160, height=120)
CAMERA_HEIGHT_M = 1.2
ANY_NAMES = ("table", "box", "shelf")  # asked of an open vocabulary; they are in the room
MOST_ASKED = 5  # of a fixed vocabulary
UNKNOWN = "surely no such thing"


def room(yaw_rad: float = 0.0, seq: int = 1) -> Frame:
    """The painted room of the example, seen from its middle; colour and depth agree."""
    T_world_base = se2_to_se3(-0.5, 0.0, yaw_rad)
    T_world_cam = camera_on_base(T_world_base, CAMERA_HEIGHT_M, 0.4)
    color, depth_m = look(CAMERA, T_world_cam)
    return Frame(
        FrameId("contract", 0, seq), seq * 10**9, True, color, depth_m, CAMERA, T_world_cam,
        T_world_base,
    )  # fmt: skip


def plain(value: int) -> Frame:
    """A frame of one grey."""
    frame = room()
    return replace(frame, color=np.full_like(frame.color, value))


def without_depth() -> Frame:
    """A frame whose depth is invalid everywhere."""
    frame = room()
    return replace(frame, depth_m=np.zeros_like(frame.depth_m))


def tiny(height: int = 6, width: int = 8) -> Frame:
    """A frame of a few pixels."""
    frame, scale = room(), width / CAMERA.width
    camera = Pinhole(
        CAMERA.fx * scale, CAMERA.fy * scale, (width - 1) / 2, (height - 1) / 2, width, height
    )
    return replace(
        frame,
        color=cv2.resize(frame.color, (width, height)),
        depth_m=cv2.resize(frame.depth_m, (width, height), interpolation=cv2.INTER_NEAREST),
        camera=camera,
    )


def photo(color: np.ndarray) -> Frame:
    """A picture [h, w, 3] as a frame, everything 2 m away."""
    height, width = color.shape[:2]
    camera = Pinhole(width, width, (width - 1) / 2, (height - 1) / 2, width, height)
    depth_m = np.full((height, width), 2.0, np.float32)
    return replace(room(), color=color, depth_m=depth_m, camera=camera)


def views(pictures: Sequence[np.ndarray]) -> list[Frame]:
    """Frames in which there may be something."""
    return [room(0.0), room(2.4, seq=2), *(photo(p) for p in pictures)]


def odd() -> dict[str, Frame]:
    """Frames that a detector meets seldom."""
    return {
        "black": plain(0), "grey": plain(128), "white": plain(255), "tiny": tiny(),
        "without depth": without_depth(),
    }  # fmt: skip


def searching(names: Sequence[str], threshold: float = 0.05) -> SearchContext:
    """A search for these classes."""
    return SearchContext("contract", tuple(SearchClass(n, Role.OBJECT, threshold) for n in names))


@dataclass(frozen=True)
class Bench(Generic[B]):
    """One back end. make: a new one."""

    make: Callable[[], B]
    pictures: tuple[np.ndarray, ...] = ()  # [h, w, 3] RGB
    deterministic: bool = True  # the same frame gives the same
    made: list[B] = field(default_factory=list)

    @property
    def back_end(self) -> B:
        """The one that all claims share, warm."""
        if not self.made:
            made = self.make()
            made.warm_up()
            self.made.append(made)
        return self.made[0]

    def close(self) -> None:
        for made in self.made:
            made.close()


@dataclass(frozen=True)
class DetectorBench(Bench[DetectorBackend]):
    """One detector, which should find something in its pictures. classes: what to ask for, empty:
    of its vocabulary."""

    classes: tuple[str, ...] = ()

    @property
    def detector(self) -> DetectorBackend:
        return self.back_end

    @property
    def asked(self) -> tuple[str, ...]:
        """Names that it knows."""
        return self.classes or (self.detector.vocabulary() or ANY_NAMES)[:MOST_ASKED]


class ScorerBench(Bench[ScorerBackend]):
    """One scorer."""

    @property
    def scorer(self) -> ScorerBackend:
        return self.back_end
