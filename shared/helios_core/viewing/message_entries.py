"""Conversion of one bus message to the entries that a recording or a viewer gets. No I/O."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from helios_core import proto as pb
from helios_core.recording_format import (
    ANNOTATIONS,
    CALIBRATION,
    KEYFRAME_CHANNELS,
    LOG,
    STREAM_CHANNELS,
    TRANSFORMS,
    channel_of,
    split_frame,
)
from helios_core.topics import DECISION, PLAN, PREVIEW, TASK
from helios_core.viewing.entry import Entry
from helios_core.viewing.foxglove_scene import stamp
from helios_core.viewing.plan_entries import candidate_entry, plan_entries

ORANGE = (1.0, 0.55, 0.0, 1.0)


class Entries:
    """Converter of messages.

    It keeps the stamps of the newest frames for image annotations, and the newest lines of the
    log: what is repeated at each step is logged once.
    """

    def __init__(self, jpeg_quality: int, lossless_keyframes: bool = True) -> None:
        """jpeg_quality: of stream frames, percent; also of keyframes if they are not lossless."""
        self._jpeg_quality = jpeg_quality
        self._keyframe_quality = None if lossless_keyframes else jpeg_quality
        self._stamps: dict[tuple[str, int, int], Timestamp] = {}
        self._said: dict[str, str] = {}  # newest line of the log by its name
        self._kinds: dict[str, Callable[[Message, int], Iterator[Entry]]] = {
            KEYFRAME_CHANNELS.head: self._frame,
            STREAM_CHANNELS.head: self._frame,
            channel_of(PREVIEW): self._preview,
            channel_of(TASK): self._task,
            channel_of(DECISION): self._decision,
            channel_of(PLAN): self._plan,
        }

    def of(self, channel: str, message: Message, log_time_ns: int) -> Iterator[Entry]:
        """All entries of one message. Raises InvalidInput for unreadable images."""
        kind = self._kinds.get(channel)
        if kind is None:
            yield Entry(channel, message)
        else:
            yield from kind(message, log_time_ns)

    def _frame(self, message: Message, _: int) -> Iterator[Entry]:
        assert isinstance(message, pb.Frame)
        id = message.id
        self._stamps[id.robot_boot_id, id.world_epoch, id.seq] = message.stamp
        while len(self._stamps) > 64:
            del self._stamps[next(iter(self._stamps))]
        channels = KEYFRAME_CHANNELS if message.keyframe else STREAM_CHANNELS
        parts = split_frame(
            message, self._keyframe_quality if message.keyframe else self._jpeg_quality
        )
        yield Entry(channels.head, parts.head)
        yield Entry(channels.color, parts.color)
        yield Entry(channels.depth, parts.depth)
        yield Entry(CALIBRATION, _calibration(message))
        yield Entry(TRANSFORMS, _transform(message.T_world_base, "base", message.stamp))
        yield Entry(TRANSFORMS, _transform(message.T_world_cam, "camera", message.stamp))

    def _preview(self, message: Message, log_time_ns: int) -> Iterator[Entry]:
        assert isinstance(message, pb.Preview)
        yield Entry(channel_of(PREVIEW), message)
        id = message.id
        taken = self._stamps.get((id.robot_boot_id, id.world_epoch, id.seq))
        yield Entry(ANNOTATIONS, _annotations(message, taken or stamp(log_time_ns)))

    def _task(self, message: Message, log_time_ns: int) -> Iterator[Entry]:
        assert isinstance(message, pb.Task)
        yield Entry(channel_of(TASK), message)
        said = f"{message.state} {message.phase}: {message.message}"
        level = Log.Level.WARNING if message.state == "failed" else Log.Level.INFO
        yield from self._log("task", said, level, log_time_ns)

    def _decision(self, message: Message, log_time_ns: int) -> Iterator[Entry]:
        assert isinstance(message, pb.Decision)
        yield Entry(channel_of(DECISION), message)
        yield from self._log("decision", message.why, Log.Level.INFO, log_time_ns)
        yield candidate_entry(message, log_time_ns)

    def _plan(self, message: Message, log_time_ns: int) -> Iterator[Entry]:
        assert isinstance(message, pb.Plan)
        yield Entry(channel_of(PLAN), message)
        yield from plan_entries(message, log_time_ns)

    def _log(
        self, name: str, said: str, level: Log.Level.ValueType, log_time_ns: int
    ) -> Iterator[Entry]:
        if self._said.get(name) != said:
            self._said[name] = said
            line = Log(timestamp=stamp(log_time_ns), level=level, message=said, name=name)
            yield Entry(LOG, line)


def _calibration(frame: pb.Frame) -> CameraCalibration:
    """Calibration of the frame, completed with P and R for viewers."""
    out = CameraCalibration()
    out.CopyFrom(frame.calibration)
    out.timestamp.CopyFrom(frame.stamp)
    K = list(frame.calibration.K)
    if not out.P and len(K) == 9:
        out.P.extend([*K[0:3], 0.0, *K[3:6], 0.0, *K[6:9], 0.0])
    if not out.R:
        out.R.extend([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    return out


def _transform(pose: PoseInFrame, child: str, taken: Timestamp) -> FrameTransform:
    out = FrameTransform(
        timestamp=taken,
        parent_frame_id="world",
        child_frame_id=child,
        rotation=pose.pose.orientation,
    )
    p = pose.pose.position
    out.translation.x, out.translation.y, out.translation.z = p.x, p.y, p.z
    return out


def _annotations(preview: pb.Preview, taken: Timestamp) -> ImageAnnotations:
    """Box and label for each detection."""
    out = ImageAnnotations()
    for detection in preview.detections:
        m = detection.mask
        box = out.points.add(timestamp=taken, type=PointsAnnotation.LINE_LOOP, thickness=2)
        for x, y in ((0, 0), (m.width, 0), (m.width, m.height), (0, m.height)):
            box.points.add(x=m.x + x, y=m.y + y)
        text = out.texts.add(timestamp=taken, font_size=12)
        text.text = f"{detection.class_name} {detection.score:.2f}"
        text.position.x, text.position.y = m.x, m.y
        for color in (box.outline_color, text.text_color):
            color.r, color.g, color.b, color.a = ORANGE
    return out
