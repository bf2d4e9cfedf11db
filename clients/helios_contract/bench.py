"""Test bench of a detector or a scorer, with its test frames."""

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
ANY_NAMES = ("table", "box", "shelf")  # searched with an open vocabulary; all are in the room
MOST_ASKED = 5  # names of a fixed vocabulary
UNKNOWN = "surely no such thing"


def room(yaw_rad: float = 0.0, seq: int = 1) -> Frame:
    """Frame in the painted room of the example, from its middle; colour and depth agree."""
    T_world_base = se2_to_se3(-0.5, 0.0, yaw_rad)
    T_world_cam = camera_on_base(T_world_base, CAMERA_HEIGHT_M, 0.4)
    color, depth_m = look(CAMERA, T_world_cam)
    return Frame(
        FrameId("contract", 0, seq),
        seq * 10**9,
        True,
        color,
        depth_m,
        CAMERA,
        T_world_cam,
        T_world_base,
    )


def plain(value: int) -> Frame:
    """Frame of one grey value."""
    frame = room()
    return replace(frame, color=np.full_like(frame.color, value))


def without_depth() -> Frame:
    """Frame whose depth is invalid everywhere."""
    frame = room()
    return replace(frame, depth_m=np.zeros_like(frame.depth_m))


def tiny(height: int = 6, width: int = 8) -> Frame:
    """Frame of a few pixels."""
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
    """Frame of an image [h, w, 3], with a depth of 2 m everywhere."""
    height, width = color.shape[:2]
    camera = Pinhole(width, width, (width - 1) / 2, (height - 1) / 2, width, height)
    depth_m = np.full((height, width), 2.0, np.float32)
    return replace(room(), color=color, depth_m=depth_m, camera=camera)


def views(pictures: Sequence[np.ndarray]) -> list[Frame]:
    """Frames that may show objects."""
    return [room(0.0), room(2.4, seq=2), *(photo(p) for p in pictures)]


def odd() -> dict[str, Frame]:
    """Unusual frames by name."""
    return {
        "black": plain(0),
        "grey": plain(128),
        "white": plain(255),
        "tiny": tiny(),
        "without depth": without_depth(),
    }


def searching(names: Sequence[str], threshold: float = 0.05) -> SearchContext:
    """Search context for these classes."""
    return SearchContext("contract", tuple(SearchClass(n, Role.OBJECT, threshold) for n in names))


@dataclass(frozen=True)
class Bench(Generic[B]):
    """Test bench of one back end. make: constructs a new one."""

    make: Callable[[], B]
    pictures: tuple[np.ndarray, ...] = ()  # [h, w, 3] RGB
    deterministic: bool = True  # the same frame gives the same result
    made: list[B] = field(default_factory=list)

    @property
    def back_end(self) -> B:
        """Warmed-up back end that all tests share."""
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
    """Test bench of one detector, which should find an object in each of its images.

    classes: names to search for; empty: names of its vocabulary.
    """

    classes: tuple[str, ...] = ()

    @property
    def detector(self) -> DetectorBackend:
        return self.back_end

    @property
    def class_names(self) -> tuple[str, ...]:
        """Class names that the detector knows."""
        return self.classes or (self.detector.vocabulary() or ANY_NAMES)[:MOST_ASKED]


class ScorerBench(Bench[ScorerBackend]):
    """Test bench of one scorer."""

    @property
    def scorer(self) -> ScorerBackend:
        return self.back_end
