"""Everything that the robot sends: images, calibration, poses and joints, guarded by one lock."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.geometry import Matrix, wrap_angle, yaw_of
from helios_core.log_rate_limit import LogRateLimit
from helios_replay.ros_images import Lens, stamp_ns

from helios_ros2.image_pairs import ImagePair, ImagePairs
from helios_ros2.pose_jumps import is_new_origin
from helios_ros2.poses import WORLD_FRAMES, Poses, TfPoses, TopicPoses
from helios_ros2.robot_clock import RobotClock
from helios_ros2.ros_node import RosNode
from helios_ros2.settings import Ros2Settings
from helios_ros2.topic_choice import (
    BATTERY,
    COMPRESSED,
    RAW,
    battery_topic,
    color_topic,
    depth_topic,
    info_beside,
)
from helios_ros2.topic_reader import TopicReader
from helios_ros2.transforms import BACK_NS, Transforms, pose_of
from helios_ros2.zenoh_node import ZenohNode

log = logging.getLogger(__name__)

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
INFO = "sensor_msgs/msg/CameraInfo"
REST_NS = 150_000_000  # span over which a base at rest does not move
REST_M, REST_RAD = 0.004, 0.006
HISTORY = 400  # poses
TF_WITHIN_S = 20.0  # longest wait for TF to connect the camera, if TF is heard


@dataclass(frozen=True)
class BasePose:
    """Pose of the base at a time of the robot's clock."""

    stamp_ns: int
    T_world_base: Matrix
    world_epoch: int = 0  # poses of different epochs have different origins


class RobotInput:
    """Readers of one robot's topics. Thread-safe."""

    def __init__(self, ros: RosNode | ZenohNode, settings: Ros2Settings) -> None:
        self._ros, self._s = ros, settings
        self._news = threading.Condition()
        self.clock = RobotClock()
        self._pairs = ImagePairs(settings.pair_s)
        self._lenses: dict[str, Lens] = {}
        self._info_frames: dict[str, str] = {}
        self._tilt_rad: float | None = None
        self._tf = Transforms()
        self._topic_poses = TopicPoses(settings, self.tilt_rad)
        self._poses: Poses | None = None
        self._history: deque[BasePose] = deque(maxlen=HISTORY)
        self._newest_came_s = 0.0  # when the newest pose came, by a monotonic clock
        self._names: dict[str, str] = {}
        self._connected = False
        self._sought_tf_s = 0.0  # when poses by TF were first sought, by a monotonic clock
        self._told_of_map = False
        self._seldom = LogRateLimit(log)
        self._pose_frame = "odom"
        self.battery: float | None = None  # charge, 0 to 1; None: not known
        self.world_epoch = 0
        self.after_ns = 0  # the next image must be later
        self._make_readers()

    def _make_readers(self) -> None:
        s, ros = self._s, self._ros

        def named(what: str, find: Callable[[], str]) -> Callable[[], str]:
            def name() -> str:
                if what not in self._names or not self._connected:  # more topics may appear
                    self._names[what] = find()
                return self._names[what]

            return name

        color = named("color", lambda: color_topic(ros.graph(), s.color))
        depth = named("depth", lambda: depth_topic(ros.graph(), s.depth))
        images = (RAW, COMPRESSED)
        self.color = TopicReader(ros, color, images, self._on_color, 3)
        self.depth = TopicReader(ros, depth, images, self._on_depth, 3)
        self.infos = {
            "color": TopicReader(
                ros,
                lambda: s.color_info or info_beside(color()),
                (INFO,),
                lambda m: self._on_info("color", m),
                1,
            ),
            "depth": TopicReader(
                ros,
                lambda: s.depth_info or info_beside(depth()),
                (INFO,),
                lambda m: self._on_info("depth", m),
                1,
            ),
        }
        self.odom = TopicReader(ros, lambda: s.odom, POSES, self._on_pose, 50)
        self.tf: TopicReader | None = None
        if s.pose != "topic" and ros.has_interface(TF_MESSAGE):
            self.tf = TopicReader(
                ros, lambda: "/tf", (TF_MESSAGE,), lambda m: self._on_tf(m, False), 100
            )
            self._tf_static = TopicReader(
                ros,
                lambda: "/tf_static",
                (TF_MESSAGE,),
                lambda m: self._on_tf(m, True),
                100,
                retained=True,
            )
        if s.tilt_joint:
            self._joints = TopicReader(
                ros, lambda: s.joint_states, ("sensor_msgs/msg/JointState",), self._on_joints, 10
            )

        self._battery = TopicReader(
            ros, lambda: battery_topic(ros.graph(), s.battery), (BATTERY,), self._on_battery, 1
        )

    # --- in the node's thread -----------------------------------------------------------------
    def _on_color(self, message: Any) -> None:
        self._on_image(message, self._pairs.add_color)

    def _on_depth(self, message: Any) -> None:
        self._on_image(message, self._pairs.add_depth)

    def _on_image(self, message: Any, add: Callable[[int, Any], ImagePair | None]) -> None:
        ns = stamp_ns(message.header)
        with self._news:
            newest = self._pairs.newest
            if newest is not None and ns < newest.stamp_ns - BACK_NS:
                self._begin_anew("the images")
            if add(ns, message) is not None:
                self._news.notify_all()

    def _on_info(self, what: str, message: Any) -> None:
        lens = Lens.of(message, f"the CameraInfo of {what}", self._names.get(what, ""))
        with self._news:
            self._lenses[what] = lens
            self._info_frames[what] = message.header.frame_id
            self._news.notify_all()

    def _on_pose(self, message: Any) -> None:
        pose = message.pose
        while hasattr(pose, "pose"):  # with covariance
            pose = pose.pose
        with self._news:
            self._pose_frame = str(message.header.frame_id)
            track = self._topic_poses.track
            going_on = track.add(stamp_ns(message.header), pose_of(pose.position, pose.orientation))
            if self._poses in (None, self._topic_poses):
                self._note(self._topic_poses, "" if going_on else f"the poses of {self._s.odom}")

    def _on_tf(self, message: Any, is_static: bool) -> None:
        with self._news:
            back: set[str] = set()  # frames whose stamps went back
            for t in message.transforms:
                child, ns = t.child_frame_id.lstrip("/"), stamp_ns(t.header)
                try:
                    pose = pose_of(t.transform.translation, t.transform.rotation)
                except InvalidInput as error:  # the others of the message may be sound
                    said = f"{child} in {t.header.frame_id}: {error.message}"
                    self._seldom.warn(child, f"a transform of TF was left out, that of {said}")
                    continue
                if not self._tf.add(t.header.frame_id, child, ns, pose, is_static):
                    back.add(child)
            if isinstance(self._poses, TfPoses):
                ours = sorted(back & self._poses.frames()) if back else []
                self._note(self._poses, f"the TF frame {', '.join(ours)}" if ours else "")
                self._tell_of_map(self._poses)

    def _tell_of_map(self, poses: TfPoses) -> None:
        """Warn once if TF has a better world frame than the one that was chosen at the start."""
        best = WORLD_FRAMES[0]
        if self._told_of_map or self._s.world_frame or poses.world_frame == best:
            return
        if self._tf.knows(best):
            self._told_of_map = True
            log.warning(
                "TF now has the frame %s; poses stay in %s until the bridge starts again. Set "
                "HELIOS_ROS2_WORLD_FRAME=%s, so that it waits for that frame",
                best,
                poses.world_frame,
                best,
            )

    def _on_joints(self, message: Any) -> None:
        s, names, angles_rad = self._s, list(message.name), message.position
        if s.tilt_joint not in names:
            return
        index = names.index(s.tilt_joint)
        angle_rad = float(angles_rad[index]) if index < len(angles_rad) else math.nan
        if not math.isfinite(angle_rad):
            raise InvalidInput(
                f"the joint {s.tilt_joint} has no angle: {len(names)} names with the positions "
                f"{list(angles_rad)[:8]}; wanted a finite position for each name, in rad"
            )
        with self._news:
            self._tilt_rad = s.tilt_sign * angle_rad + s.tilt_offset_rad
            self._news.notify_all()

    def _on_battery(self, message: Any) -> None:
        charge = float(message.percentage)  # NaN if the robot does not measure it
        self.battery = charge if 0 <= charge <= 1 else None

    def _note(self, poses: Poses, went_back: str) -> None:
        """Note the newest pose; count a new world if it cannot follow the one before.

        went_back: what has stamps that went back; "" if nothing has.
        """
        if went_back:
            self._begin_anew(went_back)
        try:
            ns = poses.newest_ns()
            T_world_base = poses.base(ns)
        except HeliosError:  # not all transforms are there yet
            return
        before = self._history[-1] if self._history else None
        if before is not None and before.stamp_ns == ns:
            return
        if before is not None and is_new_origin(
            before.T_world_base, before.stamp_ns, T_world_base, ns, self._s.jump_m
        ):
            log.warning("the robot's poses have jumped: a new world begins")
            self.world_epoch += 1
            self._history.clear()
        self._history.append(BasePose(ns, T_world_base, self.world_epoch))
        self._newest_came_s = time.monotonic()
        self.clock.note(ns)
        self._news.notify_all()

    def _begin_anew(self, went_back: str) -> None:
        log.warning("the clock of %s went back: a new world begins", went_back)
        self._pairs.clear()
        self._history.clear()
        self.after_ns = 0
        self.world_epoch += 1

    # --- from any thread ----------------------------------------------------------------------
    def connect(self, within_s: float) -> Lens:
        """Wait for calibration and poses, and choose the source of poses. Raises Unavailable."""
        with self._news:
            if not self._news.wait_for(lambda: "color" in self._lenses, within_s):
                raise self.infos["color"].silence()
            if self._poses is None:
                for camera in (self.color, self.depth):
                    _ = camera.topic  # raises Unavailable if there are several by now
                self._poses = self._choose(within_s)
                self._connected = True
                log.info("poses come from %s", type(self._poses).__name__)
            return self._lenses["color"]

    def _choose(self, within_s: float) -> Poses:
        """Source of poses. TF is waited for if frames are named, and for a while if it is heard:
        a topic brings no mount of the camera."""
        why: list[HeliosError] = []

        def by_tf() -> TfPoses | None:
            try:
                return TfPoses(self._s, self._tf, self._camera_frame())
            except Unavailable as error:
                why[:] = [error]
                return None

        if self.tf is not None:
            self._news.wait_for(lambda: by_tf() is not None, within_s)
            if (poses := by_tf()) is not None:
                return poses
        if self._s.pose == "tf":
            if self.tf is None:
                raise InvalidInput(
                    "pose = tf needs tf2_msgs, which is not installed; build it with `helios ros2 "
                    "build-interfaces DIR`, or set HELIOS_ROS2_POSE=topic"
                )
            raise why[-1]
        if self.tf is not None and self._s.pose == "auto":
            self._sought_tf_s = self._sought_tf_s or time.monotonic()
            waited_s = time.monotonic() - self._sought_tf_s
            is_heard = self.tf.count + self._tf_static.count > 0
            if self._s.world_frame or self._s.base_frame or (is_heard and waited_s < TF_WITHIN_S):
                raise why[-1]
            if is_heard:
                log.warning(
                    "poses come from %s, and the camera's mount from the settings, since TF is "
                    "heard but does not help: %s",
                    self._s.odom,
                    why[-1].message,
                )
        if not self._news.wait_for(lambda: bool(self._topic_poses.track.times_ns), within_s):
            raise self.odom.silence()
        return self._topic_poses

    def _camera_frame(self) -> str:
        """Frame of the colour image. Raises Unavailable before the first one."""
        newest = self._pairs.newest
        if newest is not None:
            return str(newest.color.header.frame_id)
        if "color" in self._info_frames:
            return self._info_frames["color"]
        raise self.color.silence()

    def lens(self, what: str, within_s: float) -> Lens:
        """Calibration of the camera `color` or `depth`. Raises Unavailable."""
        with self._news:
            if not self._news.wait_for(lambda: what in self._lenses, within_s):
                raise self.infos[what].silence()
            return self._lenses[what]

    @property
    def world_frame(self) -> str:
        """Name of the frame of the poses in the robot's own messages."""
        if isinstance(self._poses, TfPoses):
            return self._poses.world_frame
        return self._pose_frame

    def tilt_rad(self) -> float:
        """Downward tilt of the camera: measured, else that of the settings."""
        return self._s.camera_tilt_rad if self._tilt_rad is None else self._tilt_rad

    def here(self) -> BasePose:
        """Newest pose of the base. Raises Unavailable if none has come for `silent_s`.

        A topic that others keep alive does not count: several nodes publish on /tf.
        """
        source = self.tf if isinstance(self._poses, TfPoses) and self.tf else self.odom
        with self._news:
            if not self._history:
                self._news.wait_for(lambda: bool(self._history), self._s.silent_s)
            if not self._history or source.age_s() > self._s.silent_s:
                raise source.silence()
            newest = self._history[-1]
            age_s = time.monotonic() - self._newest_came_s
            if newest.stamp_ns and age_s > self._s.silent_s:  # stamp 0: the pose is static
                raise Unavailable(
                    f"{source.described()} brings messages, but no new pose of the base for "
                    f"{age_s:.1f} s; its last stamp is {newest.stamp_ns / 1e9:.3f} s: does the "
                    "robot's odometry still run?"
                )
            return newest

    def wait_newer(self, than_ns: int, within_s: float) -> None:
        """Wait for a pose newer than `than_ns`."""
        with self._news:
            self._news.wait_for(
                lambda: bool(self._history) and self._history[-1].stamp_ns > than_ns, within_s
            )

    def rests(self) -> bool:
        """True if the base has not moved for a moment, by its own poses."""
        with self._news:
            if not self._history:
                return False
            last = self._history[-1]
            span = [p for p in self._history if p.stamp_ns >= last.stamp_ns - 2 * REST_NS]
        if last.stamp_ns - span[0].stamp_ns < REST_NS:
            return False
        return all(_is_close(p.T_world_base, last.T_world_base) for p in span)

    def image(self, within_s: float) -> ImagePair:
        """Newest pair of images later than `after_ns`, with its pose known. Raises Unavailable."""
        until_s = time.monotonic() + within_s
        with self._news:

            def newer() -> bool:
                newest = self._pairs.newest
                return newest is not None and newest.stamp_ns > self.after_ns

            if not self._news.wait_for(newer, within_s):
                raise self._no_image()
            pair = self._pairs.newest
            assert pair is not None
            self.after_ns = pair.stamp_ns
            left_s = max(until_s - time.monotonic(), 0.0)
            self._news.wait_for(lambda: self._pose_is_known(pair.stamp_ns), left_s)
            return pair

    def poses_at(self, ns: int) -> tuple[Matrix, Matrix]:
        """T_world_base and T_world_cam at a time. Raises Unavailable."""
        with self._news:
            if self._poses is None:
                raise Unavailable("the robot is not connected yet")
            return self._poses.base(ns), self._poses.camera(ns)

    def between(self, frame: str, child: str, ns: int) -> Matrix:
        """T_frame_child by TF. Raises Unavailable."""
        with self._news:
            return self._tf.at(frame, child, ns)

    def _pose_is_known(self, ns: int) -> bool:
        return bool(self._history) and self._history[-1].stamp_ns >= ns

    def _no_image(self) -> Unavailable:
        for reader in (self.color, self.depth):
            if reader.age_s() > self._s.silent_s:
                return reader.silence()
        newest = self._pairs.newest
        if newest is None:
            return Unavailable(
                f"{self.color.topic} and {self.depth.topic} have no two images within "
                f"{self._s.pair_s:g} s; are they synchronised? HELIOS_ROS2_PAIR_S sets the limit"
            )
        return Unavailable(
            f"no image of {self.color.topic} is later than {self.after_ns / 1e9:.3f} s, the newest "
            f"is of {newest.stamp_ns / 1e9:.3f} s; are images and poses stamped by one clock?"
        )


def _is_close(a: Matrix, b: Matrix) -> bool:
    away_m = math.hypot(*(a - b)[:2, 3])
    return bool(away_m < REST_M) and abs(wrap_angle(yaw_of(a) - yaw_of(b))) < REST_RAD
