"""MCAP recording as a replay source: bit-exact keyframes with their search contexts."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core.codec import description_from_proto, frame_from_proto, frame_id_from_proto
from helios_core.codec.frames import pose_from_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.geometry import Pinhole
from helios_core.recording_format import join_frame
from helios_core.types import RobotDescription

from helios_replay.mcap_damage import Lost
from helios_replay.mcap_index import RecordedKeyframe, read_index
from helios_replay.replay_source import (
    DEFAULT_MAX_DEPTH_M,
    PlaybackRange,
    Shot,
    ShotPixels,
    carried_camera,
    left_out_of,
)

log = logging.getLogger(__name__)


class Recording:
    """One recording: one file, or several consecutive ones."""

    def __init__(self, paths: Sequence[Path], part: PlaybackRange) -> None:
        """Raises InvalidInput when the recording has nothing to play."""
        self._index = read_index(paths)
        self._name = paths[0].stem
        if self._index.description is None and not self._index.lost:
            raise InvalidInput(
                f"{paths[0]} does not say which robot it is of (channel /bridge/description); "
                "record while the bridge runs"
            )
        began_ns = self._index.began_ns
        times_s = [(key.log_time_ns - began_ns) / 1e9 for key in self._index.keys]
        self._part = part.of(times_s, str(paths[0]))
        self.shots = [_shot(self._index.keys[i], times_s[i]) for i in self._part]

    @property
    def name(self) -> str:
        return self._name

    @property
    def cut(self) -> str:
        """Why the recording ends early; empty if it is complete."""
        return self._index.cut

    @property
    def lost(self) -> Sequence[Lost]:
        """Damaged stretches, which are not played."""
        return self._index.lost

    @property
    def assumed(self) -> str:
        """Assumption in place of a lost robot description; empty if none is needed."""
        if self._index.description is not None:
            return ""
        return (
            "the robot's description is lost: a camera that somebody carries is assumed, with "
            f"depth up to {DEFAULT_MAX_DEPTH_M:g} m"
        )

    @property
    def left_out(self) -> str:
        """Number of keyframes without pixels or without a valid pose, as `Source.left_out`."""
        left_out = self._index.left_out
        return left_out_of(
            len(self._index.keys) + left_out, len(self._index.keys), "no pixels, or no pose"
        )

    def describe(self) -> RobotDescription:
        if self._index.description is None:
            return self._described_by_keyframes()
        robot = description_from_proto(self._index.description)
        had_body = robot.can_move or robot.recorded
        return replace(
            robot,
            can_move=False,
            can_pick=False,
            can_place=False,
            simulated=False,
            recorded=had_body,
        )

    def _described_by_keyframes(self) -> RobotDescription:
        """Description of a carried camera, in place of the lost one. Raises InvalidInput without
        a readable keyframe."""
        heights_m = [float(shot.T_world_cam[2, 3]) for shot in self.shots]
        camera = next((c for i in range(len(self.shots)) if (c := self._camera_of(i))), None)
        if camera is None:
            raise InvalidInput(
                f"{self._name} is damaged: neither the robot's description nor a keyframe can be "
                "read; record it again"
            )
        log.warning("%s: %s", self._name, self.assumed)
        return carried_camera(self._name, camera, heights_m, DEFAULT_MAX_DEPTH_M)

    def _camera_of(self, index: int) -> Pinhole | None:
        try:
            return self.read(index).camera
        except InvalidInput:
            return None

    def read(self, index: int) -> ShotPixels:
        key = self._index.keys[self._part[index]]
        assert key.color is not None
        assert key.depth is not None
        color = self._index.message(key.color, CompressedImage)
        depth = self._index.message(key.depth, RawImage)
        try:
            message = join_frame(key.head, color, depth)
            frame = frame_from_proto(message)
        except HeliosError as error:
            raise InvalidInput(
                f"keyframe {key.head.id.seq} of {self._name}: {error.message}"
            ) from (error)
        return ShotPixels(frame.color, frame.depth_m, frame.camera, frame.T_world_base, message)

    def contexts_before(self, index: int) -> Sequence[pb.SearchContext]:
        here = self._part[index]
        before = self._part[index - 1] if index else -1
        return [s.context for s in self._index.contexts if before < s.before <= here]

    def state_after(self, index: int) -> pb.RobotState:
        """The last state before the next keyframe, in the world of keyframe `index`. `index` -1:
        before the first keyframe."""
        known = self._index.states
        here = self._part[0] if index < 0 else self._part[index] + 1
        then = next((known[i] for i in range(here, -1, -1) if i in known), None)
        return self._in_world(then or pb.RobotState(), max(index, 0))

    def state_when_answered(self, index: int) -> pb.RobotState | None:
        id = frame_id_from_proto(self._index.keys[self._part[index]].head.id)
        answer = self._index.observations.get(id)
        if answer is None or answer.state is None:
            return None
        return self._in_world(answer.state, index)

    def found(self, index: int) -> pb.Observation | None:
        """What the detector found then in a shot; None if it was not recorded."""
        id = frame_id_from_proto(self._index.keys[self._part[index]].head.id)
        answer = self._index.observations.get(id)
        return None if answer is None else self._index.message(answer.where, pb.Observation)

    def _in_world(self, state: pb.RobotState, index: int) -> pb.RobotState:
        """A copy of the state with the world of keyframe `index`."""
        out = pb.RobotState()
        out.CopyFrom(state)
        head = self._index.keys[self._part[index]].head
        out.robot_boot_id, out.world_epoch = head.id.robot_boot_id, head.id.world_epoch
        out.origin_id = head.origin_id
        return out


def _shot(key: RecordedKeyframe, time_s: float) -> Shot:
    stamp = key.head.stamp
    T_world_cam = pose_from_proto(key.head.T_world_cam, "T_world_cam")
    return Shot(time_s, stamp.seconds * 1_000_000_000 + stamp.nanos, T_world_cam)
