"""ROS 2 bag (or ROS 1 .bag) as a replay source: images, calibration, and tf or a pose topic.

Topics are selected by type and name. Ambiguous ones must be named:
`color=/a,depth=/b,info=/c,pose=/d,world=map,camera=optical_frame`. Without `pose`, tf gives the
camera's pose; with it, tf gives only the other frames. Depth must be registered to colour. The
`rosbags` library reads the bag.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Matrix

from helios_replay.replay_source import (
    DEFAULT_MAX_DEPTH_M,
    Images,
    PlaybackRange,
    Shot,
    ShotPixels,
    left_out_of,
)
from helios_replay.ros_images import Lens, color_of, depth_of, stamp_ns
from helios_replay.ros_poses import FARTHEST_S, Poses

CLOSE_NS = 20_000_000  # longest time between colour and depth of one image
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
POSES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TransformStamped",
)
NAMES = ("color", "depth", "info", "pose", "world", "camera")


@dataclass(frozen=True)
class _Image:
    """Location of one image in the bag."""

    stamp_ns: int
    bag_time_ns: int


class RosBag(Images):
    """ROS bag as a replay source. The file stays open."""

    def __init__(self, path: Path, part: PlaybackRange) -> None:
        """Raises InvalidInput when the bag is unreadable or incomplete, Unavailable without the
        library."""
        self._path = path
        self._reader = _open(path)
        named = _named(part.topics)
        self._color = self._one("color", named, IMAGES, ("color", "rgb", "image"), ("depth",))
        self._depth = self._one("depth", named, IMAGES, ("depth",), ())
        info = self._one("info", named, (INFO,), ("color", "rgb", "camera_info"), ("depth",))
        colors, frame = self._images(self._color)
        depths, _ = self._images(self._depth)
        pairs = _pairs(colors, depths)
        self._lens = Lens.of(self._first(info), f"{info.topic} of {path}", self._color.topic)
        camera_frame = named.get("camera", frame)
        poses, world, seen = self._poses(named, camera_frame)
        posed: list[tuple[_Image, _Image, Matrix]] = []
        for color, depth in pairs:
            T_world_cam = poses.at(world, seen, color.stamp_ns)
            if T_world_cam is not None:
                posed.append((color, depth, T_world_cam))
        if not posed:
            raise InvalidInput(
                f"{path} has {len(colors)} colour and {len(depths)} depth images, {len(pairs)} "
                f"pairs, and none with a pose of {camera_frame} in {world} near in time"
            )
        began_ns = posed[0][0].stamp_ns
        times_s = [(color.stamp_ns - began_ns) / 1e9 for color, _, _ in posed]
        inside = part.of(times_s, str(path))
        self._pairs = [posed[i][:2] for i in inside]
        shots = [Shot(times_s[i], posed[i][0].stamp_ns, posed[i][2]) for i in inside]
        left_out = left_out_of(
            len(colors),
            len(posed),
            f"no depth within {CLOSE_NS / 1e9:g} s or no pose within {FARTHEST_S:g} s",
        )
        super().__init__(path.stem, shots, self._lens.camera, DEFAULT_MAX_DEPTH_M, left_out)

    def read(self, index: int) -> ShotPixels:
        color_at, depth_at = self._pairs[index]
        where = f"of {self._path} at {color_at.stamp_ns / 1e9:.3f} s"
        color = color_of(
            self._message(self._color, color_at), _is_compressed(self._color), f"colour {where}"
        )
        depth_m = depth_of(
            self._message(self._depth, depth_at), _is_compressed(self._depth), f"depth {where}"
        )
        camera = self._lens.camera
        if color.shape[:2] != depth_m.shape or depth_m.shape != (camera.height, camera.width):
            raise InvalidInput(
                f"colour {where} is {color.shape[1]}x{color.shape[0]}, depth "
                f"{depth_m.shape[1]}x{depth_m.shape[0]}, the calibration {camera.width}x"
                f"{camera.height}; record depth that is registered to colour"
            )
        return ShotPixels(*self._lens.straight(color, depth_m), camera)

    # --- contents of the bag ------------------------------------------------------------------
    def _one(
        self,
        what: str,
        named: dict[str, str],
        types: Sequence[str],
        hints: Sequence[str],
        not_hints: Sequence[str],
    ) -> Any:
        """Connection of the named topic, or of the only matching one. Raises InvalidInput."""
        fitting = [c for c in self._reader.connections if c.msgtype in types]
        if what in named:
            found = [c for c in fitting if c.topic == named[what]]
        else:
            left = [c for c in fitting if not any(n in c.topic for n in not_hints)]
            by_hint = ([c for c in left if hint in c.topic] for hint in hints)
            found = next((f for f in by_hint if f), left)
        if len(found) == 1:
            return found[0]
        have = ", ".join(sorted(c.topic for c in fitting)) or f"no topic of {' or '.join(types)}"
        asked = f"{what}={named[what]}" if what in named else f"which one is {what}"
        raise InvalidInput(
            f"{self._path} does not say {asked}: it holds {have}; name it, "
            f"--topics {what}=/the/topic"
        )

    def _images(self, connection: Any) -> tuple[list[_Image], str]:
        """(all images of a topic in ascending order of stamps, their frame id)."""
        out: list[_Image] = []
        frame = ""
        for bag_time_ns, message in self._messages([connection]):
            out.append(_Image(stamp_ns(message.header), bag_time_ns))
            frame = frame or str(message.header.frame_id)
        return sorted(out, key=lambda image: image.stamp_ns), frame

    def _poses(self, named: dict[str, str], camera: str) -> tuple[Poses, str, str]:
        """(all transforms, the world's frame, the camera's frame)."""
        poses = Poses()
        tf = [c for c in self._reader.connections if c.msgtype == TRANSFORMS]
        for connection in tf:
            is_static = connection.topic.endswith("tf_static")
            for _, message in self._messages([connection]):
                for t in message.transforms:
                    _add(poses, t.header, t.child_frame_id, t.transform, is_static)
        if "pose" in named:
            connection, stored = self._one("pose", named, POSES, (), ()), Poses()
            for _, message in self._messages([connection]):
                child = str(getattr(message, "child_frame_id", "")) or camera
                _add(stored, message.header, child, _pose(message), False)
            poses.replace(stored)
        elif not tf:
            raise InvalidInput(
                f"{self._path} has neither tf nor a named topic of poses; give --topics "
                "pose=/the/topic"
            )
        return poses, named.get("world") or poses.root_of(camera), camera

    def _first(self, connection: Any) -> Any:
        for _, message in self._messages([connection]):
            return message
        raise InvalidInput(f"{self._path} has no message on {connection.topic}")

    def _message(self, connection: Any, image: _Image) -> Any:
        at = image.bag_time_ns
        for _, message in self._messages([connection], start=at, stop=at + 1):
            if stamp_ns(message.header) == image.stamp_ns:
                return message
        raise InvalidInput(f"{self._path} has lost its message at {at} on {connection.topic}")

    def _messages(self, connections: Sequence[Any], **span: int) -> Any:
        try:
            for connection, bag_time_ns, data in self._reader.messages(connections, **span):
                yield bag_time_ns, self._reader.deserialize(data, connection.msgtype)
        except InvalidInput:
            raise
        except Exception as error:  # the library's own errors have no common base
            raise InvalidInput(f"{self._path} cannot be read: {_said(error)}") from error


def _open(path: Path) -> Any:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise Unavailable(
            f"a ROS bag needs the library rosbags ({error}); pip install 'helios-ovmm[ros]'"
        ) from error
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # the library's own errors have no common base
        raise InvalidInput(f"{path} is no ROS bag that can be read: {_said(error)}") from error
    return reader


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


def _named(topics: str) -> dict[str, str]:
    out: dict[str, str] = {}
    for part in filter(None, (p.strip() for p in topics.split(","))):
        name, _, value = part.partition("=")
        if name.strip() not in NAMES or not value.strip():
            raise InvalidInput(f"--topics has {part!r}; wanted NAME=/topic with {', '.join(NAMES)}")
        out[name.strip()] = value.strip()
    return out


def _is_compressed(connection: Any) -> bool:
    return connection.msgtype == IMAGES[1]


def _pairs(colors: Sequence[_Image], depths: Sequence[_Image]) -> list[tuple[_Image, _Image]]:
    """Each colour image with the depth image nearest in time, within `CLOSE_NS`."""
    times = [d.stamp_ns for d in depths]
    out: list[tuple[_Image, _Image]] = []
    for color in colors:
        at = bisect.bisect_left(times, color.stamp_ns)
        near = [i for i in (at - 1, at) if 0 <= i < len(times)]
        best = min(near, key=lambda i: abs(times[i] - color.stamp_ns), default=None)
        if best is not None and abs(times[best] - color.stamp_ns) <= CLOSE_NS:
            out.append((color, depths[best]))
    return out


def _pose(message: Any) -> Any:
    """The pose in a message of one of the types `POSES`."""
    if hasattr(message, "transform"):
        return message.transform
    pose = message.pose
    return pose.pose if hasattr(pose, "pose") else pose


def _add(poses: Poses, header: Any, child: str, pose: Any, is_static: bool) -> None:
    p = pose.translation if hasattr(pose, "translation") else pose.position
    q = pose.rotation if hasattr(pose, "rotation") else pose.orientation
    poses.add(
        str(header.frame_id),
        child,
        stamp_ns(header),
        [float(p.x), float(p.y), float(p.z)],
        [float(q.x), float(q.y), float(q.z), float(q.w)],
        is_static,
    )
