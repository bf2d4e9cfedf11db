"""Test rig: a bridge for pushed frames, maps that acknowledge them, and a pushed frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from helios_bridge.pushed_frames import PushDriver
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import frame_to_proto
from helios_core.geometry import camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import RobotDriver
from helios_core.topics import CONTEXT, KEYFRAME, MAP2D_ACK, OBJECTMAP_ACK, PUSH
from helios_core.types import Frame, FrameId

from tests.unit.bridge.bridge_stage import CAMERA

T_WORLD_CAM = camera_on_base(se2_to_se3(1.0, 2.0, 0.3), 1.1, 0.4)
ALL = {"map2d/occupancy", "map2d/value", "objectmap/objects"}


def pushed(**id_: Any) -> pb.Frame:
    """A frame as an external sender pushes it: without T_world_base."""
    frame = frame_to_proto(
        Frame(
            FrameId("", 0, 0),
            5,
            True,
            np.full((12, 16, 3), 9, np.uint8),
            np.full((12, 16), 1.5, np.float32),
            CAMERA,
            T_WORLD_CAM,
            np.eye(4),
        )
    )
    frame.ClearField("T_world_base")
    frame.id.CopyFrom(pb.FrameId(**id_))
    return frame


class Rig:
    """A bridge that accepts pushed frames, and maps that acknowledge the parts in `parts`."""

    def __init__(self, driver: RobotDriver | None = None, **settings: Any) -> None:
        hub = MemoryHub()
        self.bus, self.other = MemoryBus(hub), MemoryBus(hub)
        self.health = Health()
        values: dict[str, Any] = {"stream_hz": 0.0, **settings}
        self.bridge = BridgeService(
            self.bus, driver or PushDriver(), Settings(**values), self.health, 0
        )
        self.parts = set(ALL)
        self.refusal = ""
        self.keyframes: list[pb.Frame] = []
        self.contexts: list[pb.SearchContext] = []
        self.other.subscribe(CONTEXT, self.contexts.append)
        self.other.subscribe(KEYFRAME, self._answer)

    def _answer(self, frame: pb.Frame) -> None:
        self.keyframes.append(frame)
        for name in sorted(self.parts):
            service, part = name.split("/")
            topic = MAP2D_ACK if service == "map2d" else OBJECTMAP_ACK
            ack = pb.Ack(
                service=service,
                part=part,
                id=frame.id,
                accepted=not self.refusal,
                reason=self.refusal,
            )
            self.other.publish(topic, ack)

    def push(self, frame: pb.Frame, wait_s: float = 0.05, classes: tuple[str, ...] = ()):
        request = pb.PushRequest(frame=frame, wait_s=wait_s, classes=classes)
        return self.other.call(PUSH, request, 20)


def answered(reply: pb.PushReply) -> set[str]:
    return {f"{a.service}/{a.part}" for a in reply.acks if a.accepted}
