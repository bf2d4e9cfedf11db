"""Newest image of the robot's camera, with the detector's boxes if they fit it."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.codec.images import color_array
from helios_core.errors import HeliosError, Internal, Unavailable
from helios_core.image_messages import (
    FrameMessage,
    ImageMessage,
    ObservationMessage,
    image_data,
    kept,
)
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_gateway.box_drawing import Box, draw_boxes
from helios_gateway.cached_responses import JPEG, Encoded

BOXES_HOLD_S = 1.0  # the last image with boxes stands in for a newer one this long
JPEG_QUALITY = 82  # percent
POSES_KEPT = 64
STILL = 2e-3  # largest difference of each number (m, quaternion) of equal poses


@dataclass(frozen=True)
class _Picture:
    id: FrameId
    received_s: float
    raw: FrameMessage | bytes  # a frame, or a preview's JPEG


@dataclass(frozen=True)
class _Boxes:
    picture: _Picture
    boxes: tuple[Box, ...]


class Camera:
    """Newest camera image. Thread-safe. Encodes an image once, on request.

    It copies the colour of each frame, because a request may come at any later time.
    """

    def __init__(
        self,
        hold_s: float = BOXES_HOLD_S,
        quality: int = JPEG_QUALITY,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._hold_s = hold_s
        self._quality = quality
        self._clock = clock
        self._lock = threading.Lock()
        self._making = threading.Lock()
        self._newest: _Picture | None = None
        self._boxed: _Boxes | None = None
        self._poses: OrderedDict[FrameId, tuple[float, ...]] = OrderedDict()
        self._made: OrderedDict[tuple[FrameId, FrameId | None], Encoded] = OrderedDict()

    def on_frame(self, frame: FrameMessage) -> None:
        """Take a stream frame or a keyframe."""
        self._take_frame(frame)

    def on_preview(self, preview: pb.Preview) -> None:
        picture = _Picture(frame_id_from_proto(preview.id), self._clock(), preview.jpeg)
        self._take_boxes(picture, preview.detections)

    def on_observation(self, observation: ObservationMessage) -> None:
        self._take_boxes(self._take_frame(observation.frame), observation.detections)

    @property
    def has_picture(self) -> bool:
        """True after the first image."""
        with self._lock:
            return self._newest is not None or self._boxed is not None

    def jpeg(self, raw: bool) -> Encoded:
        """JPEG of the image; a header names its frame.

        Raises Unavailable before the first frame, Internal for an unreadable one.
        """
        with self._lock:
            newest, boxed = self._newest, self._boxed
            picture, boxes = self._choose(newest, None if raw else boxed)
        if picture is None:
            raise Unavailable("no camera picture has come yet; is the bridge running?")
        key = (picture.id, boxes.picture.id if boxes else None)
        with self._making:
            if key not in self._made:
                self._made[key] = self._make(picture, boxes.boxes if boxes else ())
                while len(self._made) > 4:
                    self._made.popitem(last=False)
            return self._made[key]

    def _take_frame(self, frame: FrameMessage) -> _Picture:
        id, received_s = frame_id_from_proto(frame.id), self._clock()
        with self._lock:
            newest = self._newest
        same = newest is not None and newest.id == id and not isinstance(newest.raw, bytes)
        picture = _Picture(id, received_s, newest.raw if newest and same else _color_of(frame))
        with self._lock:
            self._poses[id] = _pose(frame)
            while len(self._poses) > POSES_KEPT:
                self._poses.popitem(last=False)
            if self._newest is None or not _older(id, self._newest.id):
                self._newest = picture
        return picture

    def _take_boxes(self, picture: _Picture, detections: Sequence[pb.Detection]) -> None:
        boxes = tuple(
            Box(d.class_name, d.score, d.mask.x, d.mask.y, d.mask.width, d.mask.height)
            for d in detections
        )
        with self._lock:
            if self._boxed is None or not _older(picture.id, self._boxed.picture.id):
                self._boxed = _Boxes(picture, boxes)

    def _choose(
        self, newest: _Picture | None, boxed: _Boxes | None
    ) -> tuple[_Picture | None, _Boxes | None]:
        """Image to show and its boxes.

        Boxes go on their own image, which is shown for `hold_s`, or on a newer one from the same
        pose.
        """
        if boxed is None:
            return newest, None
        if newest is None or newest.id == boxed.picture.id or _older(newest.id, boxed.picture.id):
            return boxed.picture, boxed
        here, there = self._poses.get(newest.id), self._poses.get(boxed.picture.id)
        same_world = newest.id.epoch == boxed.picture.id.epoch
        if here and there and same_world and np.allclose(here, there, rtol=0, atol=STILL):
            return newest, boxed
        if same_world and newest.received_s - boxed.picture.received_s < self._hold_s:
            return boxed.picture, boxed
        return newest, None

    def _make(self, picture: _Picture, boxes: tuple[Box, ...]) -> Encoded:
        try:
            color = _pixels(picture.raw)
        except HeliosError as error:
            raise Internal(f"the newest camera picture cannot be shown: {error.message}") from error
        bgr = draw_boxes(cv2.cvtColor(color, cv2.COLOR_RGB2BGR), boxes)
        encoded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
        if not encoded:
            raise Internal("the newest camera picture could not be encoded")
        shown = f"{picture.id.world_epoch}/{picture.id.seq}"
        return Encoded.of(data.tobytes(), JPEG, x_frame_id=shown)


def _color_of(frame: FrameMessage) -> FrameMessage:
    """The frame's message with a copy of its colour and without its depth."""
    if not isinstance(frame, ImageMessage):
        return frame
    color = {path: image for path, image in frame.images.items() if path == "raw_color"}
    return kept(ImageMessage(frame.head, color))


def _pixels(raw: FrameMessage | bytes) -> NDArray[np.uint8]:
    if isinstance(raw, bytes):
        return color_array(None, CompressedImage(format="jpeg", data=raw))
    return color_array(
        raw.raw_color if raw.HasField("raw_color") else None,
        raw.compressed_color if raw.HasField("compressed_color") else None,
        image_data(raw, "raw_color"),
    )


def _pose(frame: FrameMessage) -> tuple[float, ...]:
    p, q = frame.T_world_cam.pose.position, frame.T_world_cam.pose.orientation
    return (p.x, p.y, p.z, q.x, q.y, q.z, q.w)


def _older(a: FrameId, b: FrameId) -> bool:
    """True if `a` precedes `b` within one robot boot; images of another boot are never older."""
    return a.robot_boot_id == b.robot_boot_id and (a.world_epoch, a.seq) < (b.world_epoch, b.seq)
