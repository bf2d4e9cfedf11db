"""Camera poses from the transforms of a ROS recording."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, invert, rotation_from_quaternion
from numpy.typing import NDArray

FARTHEST_S = 0.5  # longest time between an image and a pose; poses are interpolated
LONGEST_CHAIN = 64


@dataclass
class Track:
    """A frame's pose in its parent frame, over time or static."""

    parent: str
    is_static: bool
    samples: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(
        default_factory=dict
    )  # ns -> (position m, quaternion xyzw)
    times_ns: list[int] = field(default_factory=list)  # sorted sample times, filled on first use
    other_parent: str = ""  # second parent that the recording also names


class Poses:
    """All transforms of a recording."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = {}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        position_m: list[float],
        quaternion: list[float],
        is_static: bool = False,
    ) -> None:
        """Add one transform sample. Raises InvalidInput for numbers that are not a pose."""
        norm = float(np.linalg.norm(quaternion))
        if not math.isfinite(norm) or abs(norm - 1) > 0.01 or not np.isfinite(position_m).all():
            raise InvalidInput(f"the transform from {child} to {parent} holds no pose")
        track = self._tracks.setdefault(_bare(child), Track(_bare(parent), is_static))
        if track.parent != _bare(parent):
            track.other_parent = _bare(parent)
        track.samples[stamp_ns] = (np.array(position_m), np.array(quaternion) / norm)
        track.times_ns.clear()

    def replace(self, others: Poses) -> None:
        """Replace the tracks of all frames that `others` contains."""
        self._tracks |= others._tracks

    def root_of(self, child: str) -> str:
        """The root frame above `child`: the world.

        Raises InvalidInput when a frame in the chain has two parents, or the chain is a cycle.
        """
        for _ in range(LONGEST_CHAIN):
            track = self._track(child)
            if track is None:
                return _bare(child)
            child = track.parent
        raise InvalidInput(f"the transforms above {child} go in a circle")

    def at(self, world: str, child: str, stamp_ns: int) -> Matrix | None:
        """T_world_child [4, 4] at a time; None without poses within `FARTHEST_S`.

        Raises InvalidInput when no chain or two chains of transforms connect the two frames.
        """
        T_root_child = self._to_root(child, stamp_ns)
        T_root_world = self._to_root(world, stamp_ns)
        if self.root_of(child) != self.root_of(world):
            raise InvalidInput(f"no transforms lead from {child} to {world}")
        if T_root_child is None or T_root_world is None:
            return None
        return invert(T_root_world) @ T_root_child

    def _to_root(self, child: str, stamp_ns: int) -> Matrix | None:
        out = np.eye(4)
        for _ in range(LONGEST_CHAIN):
            track = self._track(child)
            if track is None:
                return out
            T_parent_child = _interpolated(track, stamp_ns)
            if T_parent_child is None:
                return None
            out = T_parent_child @ out
            child = track.parent
        raise InvalidInput(f"the transforms above {child} go in a circle")

    def _track(self, child: str) -> Track | None:
        """The track of a frame; None for a root. Raises InvalidInput for a frame with two parents,
        since its samples mix both."""
        track = self._tracks.get(_bare(child))
        if track is not None and track.other_parent:
            raise InvalidInput(
                f"the frame {_bare(child)} hangs below {track.parent} and below "
                f"{track.other_parent}; wanted one parent: name a topic that says where it is, "
                "--topics pose=/the/topic, or record one of the two only"
            )
        return track


def _interpolated(track: Track, stamp_ns: int) -> Matrix | None:
    if not track.times_ns:
        track.times_ns.extend(sorted(track.samples))
    times = track.times_ns
    if track.is_static:
        return _matrix(*track.samples[times[-1]])
    after = bisect.bisect_left(times, stamp_ns)
    near = [times[i] for i in (after - 1, after) if 0 <= i < len(times)]
    if min(abs(t - stamp_ns) for t in near) > FARTHEST_S * 1e9:
        return None
    if len(near) == 1:
        return _matrix(*track.samples[near[0]])
    (p0, q0), (p1, q1) = track.samples[near[0]], track.samples[near[1]]
    share = (stamp_ns - near[0]) / (near[1] - near[0])
    return _matrix(p0 + share * (p1 - p0), slerp(q0, q1, share))


def slerp(q0: NDArray[np.float64], q1: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The unit quaternion [4] at fraction `share` of the shorter arc from q0 to q1."""
    dot = float(q0 @ q1)
    if dot < 0:
        q1, dot = -q1, -dot
    angle = math.acos(min(1.0, dot))
    if angle < 1e-6:
        return q0 + share * (q1 - q0)
    return (math.sin((1 - share) * angle) * q0 + math.sin(share * angle) * q1) / math.sin(angle)


def _matrix(position_m: NDArray[np.float64], quaternion: NDArray[np.float64]) -> Matrix:
    out = np.eye(4)
    out[:3, :3] = rotation_from_quaternion(*(float(q) for q in quaternion))
    out[:3, 3] = position_m
    return out


def _bare(frame: str) -> str:
    return frame.lstrip("/")
