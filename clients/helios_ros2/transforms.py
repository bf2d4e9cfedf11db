"""Recent transforms between frames, interpolated at a time (TF). No I/O, not thread-safe."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field

import numpy as np
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Matrix, invert, rotation_from_quaternion
from helios_replay.ros_poses import slerp
from numpy.typing import NDArray

KEPT_NS = 10_000_000_000  # older transforms are forgotten
BACK_NS = 1_000_000_000  # a clock that goes back further has begun anew
LONGEST_CHAIN = 64

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]  # position m, unit quaternion xyzw


def pose_of(position: object, orientation: object) -> Pose:
    """Pose of a ROS position and orientation. Raises InvalidInput for numbers that are no pose."""
    p = np.array([getattr(position, axis) for axis in "xyz"], float)
    q = np.array([getattr(orientation, axis) for axis in "xyzw"], float)
    norm = float(np.linalg.norm(q))
    if not np.isfinite(p).all() or not abs(norm - 1) < 0.01:
        raise InvalidInput(f"position {p.tolist()} with orientation {q.tolist()} is no pose")
    return p, q / norm


def matrix_of(pose: Pose) -> Matrix:
    """T_parent_child [4, 4]."""
    out = np.eye(4)
    out[:3, :3] = rotation_from_quaternion(*(float(v) for v in pose[1]))
    out[:3, 3] = pose[0]
    return out


@dataclass
class Track:
    """Poses of one frame in its parent over time, or one static pose."""

    is_static: bool = False
    times_ns: list[int] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)

    def add(self, stamp_ns: int, pose: Pose) -> bool:
        """Add a pose. Returns False if the clock went back, which forgets all earlier poses."""
        if self.is_static:
            self.times_ns, self.poses = [stamp_ns], [pose]
            return True
        anew = bool(self.times_ns) and stamp_ns < self.times_ns[-1] - BACK_NS
        if anew:
            self.times_ns.clear()
            self.poses.clear()
        at = bisect.bisect_left(self.times_ns, stamp_ns)
        if at < len(self.times_ns) and self.times_ns[at] == stamp_ns:
            self.poses[at] = pose
        else:
            self.times_ns.insert(at, stamp_ns)
            self.poses.insert(at, pose)
        old = bisect.bisect_left(self.times_ns, self.times_ns[-1] - KEPT_NS)
        del self.times_ns[:old], self.poses[:old]
        return not anew

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose; None for a static frame, whose pose holds at any time."""
        return None if self.is_static else self.times_ns[-1]

    def at(self, stamp_ns: int, beyond_ns: int) -> Matrix | None:
        """T_parent_child, linear between two poses; None further than `beyond_ns` from one."""
        if self.is_static:
            return matrix_of(self.poses[-1])
        after = bisect.bisect_left(self.times_ns, stamp_ns)
        near = [i for i in (after - 1, after) if 0 <= i < len(self.times_ns)]
        if not near or min(abs(self.times_ns[i] - stamp_ns) for i in near) > beyond_ns:
            return None
        if len(near) == 1:
            return matrix_of(self.poses[near[0]])
        (p0, q0), (p1, q1) = self.poses[near[0]], self.poses[near[1]]
        t0, t1 = self.times_ns[near[0]], self.times_ns[near[1]]
        share = (stamp_ns - t0) / (t1 - t0)
        return matrix_of((p0 + share * (p1 - p0), slerp(q0, q1, share)))


class Transforms:
    """The tree of frames of a robot, as TF publishes it."""

    def __init__(self, beyond_s: float = 0.5) -> None:
        """beyond_s: longest time between a question and a pose."""
        self._tracks: dict[str, Track] = {}
        self._parents: dict[str, str] = {}
        self._beyond_ns = int(beyond_s * 1e9)

    def add(
        self, parent: str, child: str, stamp_ns: int, pose: Pose, is_static: bool = False
    ) -> bool:
        """Add one transform. Returns False if the clock went back."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if self._parents.get(child) != parent:
            self._parents[child] = parent
            self._tracks[child] = Track(is_static)
        return self._tracks[child].add(stamp_ns, pose)

    def knows(self, frame: str) -> bool:
        """True if a transform names this frame."""
        frame = frame.lstrip("/")
        return frame in self._parents or frame in self._parents.values()

    def newest_ns(self, frame: str, child: str) -> int:
        """Newest time at which the pose of `child` in `frame` is known; 0 if it is static.

        Raises Unavailable if no transforms connect them.
        """
        tracks = [self._tracks[name] for name in self.frames_between(frame, child)]
        moving = [track.newest_ns for track in tracks if track.newest_ns is not None]
        return min(moving, default=0)

    def at(self, frame: str, child: str, stamp_ns: int) -> Matrix:
        """T_frame_child at a time. Raises Unavailable if it is not known."""
        self.frames_between(frame, child)
        return invert(self._to_root(frame, stamp_ns)) @ self._to_root(child, stamp_ns)

    def frames_between(self, frame: str, child: str) -> set[str]:
        """Frames whose pose in their parent counts. Raises Unavailable without a connection."""
        one, other = self._chain(frame), self._chain(child)
        if one[-1] != other[-1]:
            raise Unavailable(
                f"TF connects no {child} with {frame}: {child} hangs below {other[-1]}, {frame} "
                f"below {one[-1]}; wanted one tree"
            )
        return set(one) ^ set(other)

    def _chain(self, frame: str) -> list[str]:
        out = [frame.lstrip("/")]
        while (parent := self._parents.get(out[-1])) is not None:
            out.append(parent)
            if len(out) > LONGEST_CHAIN:
                raise Unavailable(f"the transforms above {frame} go in a circle; wanted a tree")
        return out

    def _to_root(self, frame: str, stamp_ns: int) -> Matrix:
        out = np.eye(4)
        for name in self._chain(frame)[:-1]:
            T = self._tracks[name].at(stamp_ns, self._beyond_ns)
            if T is None:
                newest_ns = self._tracks[name].newest_ns or 0
                raise Unavailable(
                    f"TF has no pose of {name} at {stamp_ns / 1e9:.3f} s, the newest is of "
                    f"{newest_ns / 1e9:.3f} s; are both stamped by one clock?"
                )
            out = T @ out
        return out
