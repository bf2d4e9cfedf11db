"""Simulator ground truth of one frame: instance of each pixel and class of each instance."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import transform_from_proto, vector_from_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Matrix
from helios_core.topics import TRUTH_SEGMENTATION, WORLD_DESCRIBE
from helios_core.types import Frame
from numpy.typing import NDArray

TIMEOUT_S = 3.0  # longest wait for the simulated world
STARTS_WITHIN_S = 10.0  # longest wait for its start; then the reason is reported
ASK_AGAIN_S = 0.1


@dataclass(frozen=True)
class TruthInstance:
    """One object of the simulated home."""

    id: int
    class_name: str
    center_world_m: NDArray[np.float64]  # [3]
    graspable: bool
    name: str = ""  # identical in every process, such as "mug_3"
    turn_rad: float = 0.0  # of an object that the gripper shows, from how it was grasped

    @property
    def key(self) -> str:
        """Its name, or "#id" if it has none."""
        return self.name or f"#{self.id}"

    def center_seen_from(self, eye_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centre [3] that an unturned object would need to show a camera at eye_m [3] the same
        side, at the same distance."""
        if not self.turn_rad:
            return self.center_world_m
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        x, y, z = eye_m - self.center_world_m
        return eye_m - np.array([c * x + s * y, c * y - s * x, z])


@dataclass(frozen=True)
class Extents:
    """Visible pixels and boxes of the n ids in an image, ascending by id."""

    ids: NDArray[np.uint16]  # [n]
    pixels: NDArray[np.int64]  # [n]
    boxes_xyxy: NDArray[np.int64]  # [n, 4] half open


@dataclass(frozen=True)
class Truth:
    """Ground truth of one frame."""

    ids: NDArray[np.uint16]  # [h, w]; 0 is background
    instances: Mapping[int, TruthInstance]
    T_world_cam: Matrix | None = None  # [4, 4] true pose of the camera; None: as the robot reports

    def in_world(self, frame: Frame) -> Frame:
        """The frame with the true pose of the camera, in the frame of the instances."""
        return frame if self.T_world_cam is None else replace(frame, T_world_cam=self.T_world_cam)

    @cached_property
    def extents(self) -> Extents:
        """Pixels and box of each id in the image, 0 included."""
        return extents_of(self.ids)


def extents_of(ids: NDArray[np.uint16]) -> Extents:
    """Pixels and box of each id of an image [h, w]."""
    width = ids.shape[1]
    flat = ids.ravel()
    # Runs of equal pixels within a row are far fewer than pixels.
    begins = np.empty(flat.size, bool)
    np.not_equal(flat[1:], flat[:-1], out=begins[1:])
    begins[::width] = True
    starts = np.flatnonzero(begins)
    ends = np.append(starts[1:], flat.size)
    order = np.argsort(flat[starts], kind="stable")
    starts, ends = starts[order], ends[order]
    run_ids = flat[starts]
    first = np.flatnonzero(np.append(True, run_ids[1:] != run_ids[:-1]))
    boxes = (
        np.minimum.reduceat(starts % width, first),
        np.minimum.reduceat(starts // width, first),
        np.maximum.reduceat((ends - 1) % width, first) + 1,
        np.maximum.reduceat(starts // width, first) + 1,
    )
    pixels = np.add.reduceat(ends - starts, first)
    return Extents(run_ids[first], pixels, np.stack(boxes, -1))


class TruthSource(Protocol):
    """Source of ground truth: the simulated world over the bus, or a test."""

    def segmentation(self, stamp_ns: int) -> Truth:
        """Ground truth of the frame with that stamp. Raises a HeliosError when it is unknown."""
        ...

    def check(self) -> None:
        """Raises Unavailable when the source does not answer."""
        ...


def truth_from_proto(message: pb.TruthSegmentation) -> Truth:
    """Ground truth from its message. Raises InvalidInput for a wrong number of bytes."""
    size = message.width * message.height
    if size == 0 or len(message.ids) != 2 * size:
        raise InvalidInput(
            f"a truth segmentation of {message.width}x{message.height} came with "
            f"{len(message.ids)} bytes; wanted 16 bit for each pixel"
        )
    ids = np.frombuffer(message.ids, "<u2").reshape(message.height, message.width)
    return Truth(
        ids.astype(np.uint16, copy=False),
        {
            i.id: TruthInstance(
                i.id, i.class_name, vector_from_proto(i.center_m), i.graspable, i.name, i.turn_rad
            )
            for i in message.instances
        },
        transform_from_proto(message.T_world_cam, "T_world_cam")
        if message.HasField("T_world_cam")
        else None,
    )


class BusTruth:
    """Ground truth from the simulated world by method call."""

    def __init__(
        self, bus: Bus, timeout_s: float = TIMEOUT_S, starts_within_s: float = STARTS_WITHIN_S
    ) -> None:
        self._bus = bus
        self._timeout_s, self._starts_within_s = timeout_s, starts_within_s
        self._closed = threading.Event()

    def segmentation(self, stamp_ns: int) -> Truth:
        """Ground truth of the frame with that stamp (ns, the robot's clock). Raises Unavailable or
        DeadlineExceeded when the world does not answer, InvalidInput for a discarded stamp or an
        inconsistent response."""
        request = pb.TruthSegmentationRequest(stamp_ns=stamp_ns)
        return truth_from_proto(self._bus.call(TRUTH_SEGMENTATION, request, self._timeout_s))

    def check(self) -> None:
        """Wait for the world while it starts. Raises Unavailable if it does not, or on `close`."""
        deadline_s = time.monotonic() + self._starts_within_s
        while True:
            try:
                self._bus.call(WORLD_DESCRIBE, pb.Empty(), self._timeout_s)
                return
            except Unavailable:
                if time.monotonic() > deadline_s or self._closed.wait(ASK_AGAIN_S):
                    raise

    def close(self) -> None:
        """End the wait of `check`."""
        self._closed.set()


def truth_of(frame: Frame, source: TruthSource) -> Truth:
    """Ground truth of a frame. Raises InvalidInput when its size differs from the frame's."""
    truth = source.segmentation(frame.stamp_ns)
    if truth.ids.shape != frame.depth_m.shape:
        raise InvalidInput(
            f"the truth of frame {frame.id} is {truth.ids.shape} (height x width), the frame "
            f"{frame.depth_m.shape}; render both with one camera"
        )
    return truth
