"""Poses of base and camera: from TF, or from a pose topic and the mount in the settings. No I/O.

The floor is z = 0 and the base stands on it. If the base stays level (`level`), its roll, pitch and
height are dropped: odometry lets them drift.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from helios_core.errors import Unavailable
from helios_core.geometry import Matrix, camera_on_base, se2_to_se3, yaw_of

from helios_ros2.settings import Ros2Settings
from helios_ros2.transforms import Track, Transforms

BEYOND_NS = 500_000_000  # longest time between an image and a pose
WORLD_FRAMES = ("map", "odom")  # best first
BASE_FRAMES = ("base_footprint", "base_link")


def on_floor(T_world_base: Matrix) -> Matrix:
    """The same pose without roll, pitch and height."""
    x_m, y_m = (float(v) for v in T_world_base[:2, 3])
    return se2_to_se3(x_m, y_m, yaw_of(T_world_base))


class Poses(ABC):
    """Poses of one robot at the times of its own clock."""

    @abstractmethod
    def newest_ns(self) -> int:
        """Newest time at which the base's pose is known. Raises Unavailable before the first."""

    @abstractmethod
    def base(self, stamp_ns: int) -> Matrix:
        """T_world_base on the floor. Raises Unavailable if it is not known."""

    @abstractmethod
    def camera(self, stamp_ns: int) -> Matrix:
        """T_world_cam. Raises Unavailable if it is not known."""


class TopicPoses(Poses):
    """Poses of a topic, with the camera's mount of the settings."""

    def __init__(self, settings: Ros2Settings, tilt_rad: Callable[[], float]) -> None:
        """tilt_rad: present downward tilt of the camera."""
        self._s, self._tilt_rad = settings, tilt_rad
        self.track = Track()

    def newest_ns(self) -> int:
        if not self.track.times_ns:
            raise Unavailable(f"no pose has come on {self._s.odom} yet")
        return self.track.times_ns[-1]

    def base(self, stamp_ns: int) -> Matrix:
        T = self.track.at(stamp_ns, BEYOND_NS) if self.track.times_ns else None
        if T is None:
            raise Unavailable(
                f"no pose of {self._s.odom} is near {stamp_ns / 1e9:.3f} s, the newest is of "
                f"{self.newest_ns() / 1e9:.3f} s; are images and poses stamped by one clock?"
            )
        return on_floor(T)

    def camera(self, stamp_ns: int) -> Matrix:
        s = self._s
        return camera_on_base(
            self.base(stamp_ns), s.camera_height_m, self._tilt_rad(), s.camera_forward_m
        )


class TfPoses(Poses):
    """Poses of TF."""

    def __init__(self, settings: Ros2Settings, transforms: Transforms, camera_frame: str) -> None:
        """Chooses the frames. Raises Unavailable as long as TF does not connect them."""
        self._s, self._tf = settings, transforms
        self._camera = camera_frame
        # A named origin belongs to a map: the origin of odometry does not outlive a restart.
        worlds = WORLD_FRAMES[:1] if settings.origin else WORLD_FRAMES
        self.world_frame = settings.world_frame or self._known(worlds, "world")
        self._base = settings.base_frame or self._known(BASE_FRAMES, "base")
        for frame in (self._base, camera_frame):
            self._tf.newest_ns(self.world_frame, frame)

    def frames(self) -> set[str]:
        """Frames on the chains from world to base and from base to camera, without their common
        ancestors. Empty as long as TF does not connect them."""
        try:
            return self._tf.frames_between(self.world_frame, self._base) | self._tf.frames_between(
                self._base, self._camera
            )
        except Unavailable:
            return set()

    def newest_ns(self) -> int:
        return self._tf.newest_ns(self.world_frame, self._base)

    def base(self, stamp_ns: int) -> Matrix:
        return on_floor(self._tf.at(self.world_frame, self._base, stamp_ns))

    def camera(self, stamp_ns: int) -> Matrix:
        if not self._s.level:
            return self._tf.at(self.world_frame, self._camera, stamp_ns)
        above = np.eye(4)
        above[2, 3] = self._s.base_height_m
        return self.base(stamp_ns) @ above @ self._tf.at(self._base, self._camera, stamp_ns)

    def _known(self, frames: tuple[str, ...], what: str) -> str:
        for frame in frames:
            if self._tf.knows(frame):
                return frame
        raise Unavailable(
            f"TF has no frame {' or '.join(frames)}; name the {what} frame with "
            f"HELIOS_ROS2_{what.upper()}_FRAME"
        )
