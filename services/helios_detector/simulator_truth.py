"""The simulator's truth about one frame: which pixel belongs to which instance, of which class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import vector_from_proto
from helios_core.errors import InvalidInput
from helios_core.topics import TRUTH_SEGMENTATION, WORLD_DESCRIBE
from helios_core.types import Frame
from numpy.typing import NDArray

TIMEOUT_S = 3.0  # longest wait for the simulated world


@dataclass(frozen=True)
class TruthInstance:
    """One thing of the simulated home."""

    id: int
    class_name: str
    center_world_m: NDArray[np.float64]  # [3]
    graspable: bool
    name: str = ""  # the same in every process, as "mug_3"

    @property
    def key(self) -> str:
        """What it is known by: its name, or its number where it has none."""
        return self.name or f"#{self.id}"


@dataclass(frozen=True)
class Truth:
    """The truth of one frame."""

    ids: NDArray[np.uint16]  # [h, w]; 0 is background
    instances: Mapping[int, TruthInstance]


class TruthSource(Protocol):
    """Whoever knows the truth: the world over the bus, or a test."""

    def segmentation(self, stamp_ns: int) -> Truth:
        """Of the frame taken at that stamp. Raises a HeliosError when it is not known."""
        ...

    def check(self) -> None:
        """Raises Unavailable when the truth cannot be asked now."""
        ...


def truth_from_proto(message: pb.TruthSegmentation) -> Truth:
    """Raises InvalidInput when the image does not have the size that it says."""
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
                i.id, i.class_name, vector_from_proto(i.center_m), i.graspable, i.name
            )
            for i in message.instances
        },
    )


class BusTruth:
    """Asks the simulated world by method call."""

    def __init__(self, bus: Bus, timeout_s: float = TIMEOUT_S) -> None:
        self._bus = bus
        self._timeout_s = timeout_s

    def segmentation(self, stamp_ns: int) -> Truth:
        """Of the frame taken at that stamp (ns, the robot's clock). Raises Unavailable or
        DeadlineExceeded when the world does not answer, InvalidInput for a stamp that it has
        forgotten or an answer that does not hold together."""
        request = pb.TruthSegmentationRequest(stamp_ns=stamp_ns)
        return truth_from_proto(self._bus.call(TRUTH_SEGMENTATION, request, self._timeout_s))

    def check(self) -> None:
        self._bus.call(WORLD_DESCRIBE, pb.Empty(), self._timeout_s)


def truth_of(frame: Frame, source: TruthSource) -> Truth:
    """The frame's truth, of the frame's size. Raises InvalidInput when the sizes disagree."""
    truth = source.segmentation(frame.stamp_ns)
    if truth.ids.shape != frame.depth_m.shape:
        raise InvalidInput(
            f"the truth of frame {frame.id} is {truth.ids.shape} (height x width), the frame "
            f"{frame.depth_m.shape}; render both with one camera"
        )
    return truth
