"""A 2D map service on an in-process bus, and a stand-in for everything that it talks to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import (
    context_to_proto,
    description_to_proto,
    embedding_to_proto,
    frame_to_proto,
    observation_to_proto,
    state_to_proto,
)
from helios_core.embedding_similarity import image_text_score
from helios_core.geometry import se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CONTEXT,
    EMBED_TEXT,
    KEYFRAME,
    MAP2D_ACK,
    OBSERVATION,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SNAPSHOT,
)
from helios_core.types import (
    Detection,
    Embedding,
    Frame,
    Observation,
    RobotDescription,
    RobotState,
    SearchContext,
)
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings
from map2d_scene import CAMERA, CAMERA_HEIGHT_M, Walk, room, table

ROBOT = RobotDescription(
    name="test",
    footprint_radius_m=0.2,
    height_m=1.4,
    camera=CAMERA,
    camera_height_m=CAMERA_HEIGHT_M,
    reach_m=0.8,
    max_depth_m=10.0,
)
MODEL, SCALE, OFFSET = "test-clip", 0.5, 0.5


class Scorer:
    """An image-text scorer with random embeddings, seeded by the prompt or by the frame number."""

    def text(self, prompt: str) -> Embedding:
        return self._vector(f"text {prompt}")

    def image(self, frame: Frame) -> Embedding:
        return self._vector(f"image {frame.id.seq}")

    def score(self, frame: Frame, prompt: str) -> float:
        return image_text_score(self.image(frame), self.text(prompt), SCALE, OFFSET)

    def serve(self, bus: Bus) -> None:
        bus.serve(EMBED_TEXT, self._embed)

    def _embed(self, request: pb.EmbedTextRequest) -> pb.EmbedTextReply:
        found = [embedding_to_proto(self.text(p)) for p in request.prompts]
        return pb.EmbedTextReply(embeddings=found, scale=SCALE, offset=OFFSET)

    def _vector(self, name: str) -> Embedding:
        seed = int.from_bytes(name.encode()[-8:].rjust(8), "big")
        vector = np.random.default_rng(seed).normal(size=(1, 16)).astype(np.float16)
        return Embedding(MODEL, (vector / np.linalg.norm(vector)).astype(np.float32))


class Rig:
    """A 2D map service, and a stand-in for everything that it talks to."""

    def __init__(self, *flags: str, described: bool = True) -> None:
        self.bus = MemoryBus(MemoryHub())
        self.health = Health()
        self.acks: list[pb.Ack] = []
        self.bus.subscribe(MAP2D_ACK, self.acks.append)
        settings = Settings.load(["--size-cells", "640", *flags])
        self.service = Map2DService(self.bus, settings, self.health)
        self.walk = Walk([*room(), *table(2.5, 2.4)])
        self.scorer = Scorer()
        if described:
            self.describe()

    def describe(self, robot: RobotDescription = ROBOT) -> None:
        self.bus.publish(ROBOT_DESCRIPTION, description_to_proto(robot))

    def say_epoch(
        self,
        boot_id: str,
        world_epoch: int = 0,
        held: str = "",
        at: tuple[float, float, float] = (0.0, 0.0, 0.0),
        origin: str = "",
    ) -> None:
        """Publish the robot's state; `at` is x, y (m) and yaw (rad)."""
        state = RobotState(
            se2_to_se3(*at),
            held=held,
            world_epoch=world_epoch,
            robot_boot_id=boot_id,
            origin_id=origin,
        )
        self.bus.publish(ROBOT_STATE, state_to_proto(state))

    def search(self, name: str, prompts: Mapping[str, str] | None = None) -> None:
        asked = {"pick": "a mug", "place": "a counter"} if prompts is None else dict(prompts)
        self.bus.publish(CONTEXT, context_to_proto(SearchContext(name, (), asked)))

    def keyframe(self, frame: Frame) -> None:
        self.bus.publish(KEYFRAME, frame_to_proto(frame))

    def observe(
        self,
        frame: Frame,
        context_id: str,
        scores: Mapping[str, float] | None = None,
        detections: tuple[Detection, ...] = (),
    ) -> None:
        """Publish an observation; with `scores`, of a scorer that embeds images."""
        image = None if scores is None else self.scorer.image(frame)
        given = {"pick": 0.4, "place": 0.2} if scores is None else dict(scores)
        seen = Observation(frame, context_id, detections, given, "test", "test", image)
        self.bus.publish(OBSERVATION, observation_to_proto(seen))

    def snapshot(self, **request: Any) -> pb.MapSnapshot:
        return self.bus.call(SNAPSHOT, pb.SnapshotRequest(layers=True, **request), 5)

    def settle(self) -> None:
        self.search("first")
        for frame in self.walk.look_around(2.0, 1.5):
            self.keyframe(frame)
            self.observe(frame, "first")
