"""Frames of a small camera, and a recorder on a bus in this process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.codec import context_to_proto, description_to_proto, frame_to_proto, state_to_proto
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, OBSERVATION, ROBOT_DESCRIPTION, ROBOT_STATE
from helios_core.types import (
    Frame,
    FrameId,
    RobotDescription,
    RobotState,
    Role,
    SearchClass,
    SearchContext,
)
from helios_recorder.service import RecorderService
from helios_recorder.settings import Settings

CAMERA = Pinhole(52.5, 52.5, 32.0, 24.0, 64, 48)
CONTEXT_ID = "seek-a-cup"


def frame(seq: int, keyframe: bool = True, seed: int | None = None) -> pb.Frame:
    """A frame of noise, which no lossy codec preserves."""
    random = np.random.default_rng(seq if seed is None else seed)
    depth_mm = random.integers(500, 4000, (48, 64)).astype(np.float32)
    T_world_base = se2_to_se3(0.1 * seq, -0.2, 0.3 + 0.01 * seq)
    return frame_to_proto(
        Frame(
            id=FrameId("boot", 0, seq),
            stamp_ns=1_000_000_000 + seq * 100_000_000,
            keyframe=keyframe,
            color=random.integers(0, 256, (48, 64, 3)).astype(np.uint8),
            depth_m=depth_mm / np.float32(1000),
            camera=CAMERA,
            T_world_cam=camera_on_base(T_world_base, 1.2, 0.3),
            T_world_base=T_world_base,
        )
    )


def context(name: str = CONTEXT_ID) -> pb.SearchContext:
    return context_to_proto(
        SearchContext(name, (SearchClass("cup", Role.WATCH, 0.2),), {"pick": "a cup"})
    )


def description() -> pb.RobotDescription:
    return description_to_proto(RobotDescription("tiny", 0.25, 1.4, CAMERA, 1.2, 0.8, 4.0))


class Recorded:
    """A bus with a recorder on it."""

    def __init__(self, out: Path, **settings: Any) -> None:
        self.hub = MemoryHub()
        self.bus = MemoryBus(self.hub)
        self.health = Health()
        chosen: dict[str, Any] = {"min_free_mb": 0.0} | settings
        self.service = RecorderService(
            MemoryBus(self.hub),
            Settings(out=out, **chosen),
            self.health,
        )

    def robot(self) -> None:
        """Publishes what a bridge publishes when it starts."""
        self.bus.publish(ROBOT_DESCRIPTION, description())
        state = RobotState(se2_to_se3(0, 0, 0), robot_boot_id="boot")
        self.bus.publish(ROBOT_STATE, state_to_proto(state))

    def look(self, seq: int, context_id: str = CONTEXT_ID, keyframe: bool = True) -> pb.Frame:
        """Publishes one frame, and its observation if it is a keyframe."""
        message = frame(seq, keyframe)
        self.bus.publish(KEYFRAME if keyframe else FRAME, message)
        if keyframe:
            observation = pb.Observation(frame=message, context_id=context_id, detector="tiny")
            observation.detections.add(class_name="cup", score=0.9)
            self.bus.publish(OBSERVATION, observation)
        return message

    def tour(self, frames: int) -> list[pb.Frame]:
        """Publishes a robot, a search context and keyframes: a short recording."""
        self.robot()
        self.bus.publish(CONTEXT, context())
        return [self.look(seq) for seq in range(frames)]

    def close(self) -> None:
        self.service.close()
