"""A robot that publishes one message of every kind that viewers show, and a client of Foxglove."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import (
    CONTEXT,
    DECISION,
    FRAME,
    KEYFRAME,
    OBSERVATION,
    PLAN,
    PREVIEW,
    ROBOT_DESCRIPTION,
    TASK,
)
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.unit.recorder.recorder_bus import CONTEXT_ID, context, description, frame
from tests.unit.recorder.recorder_maps import FakeMaps, snapshot_of

SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")
MESSAGE = struct.Struct("<BIQ")  # opcode 1, subscription, log time (ns); then the data
DRAWN = {  # channels of Foxglove's own types
    "/camera/color", "/camera/depth", "/camera/keyframe/color", "/camera/keyframe/depth",
    "/camera/calibration", "/tf", "/detector/annotations", "/log", "/map/occupancy",
    "/map/value/pick", "/map/obstacles", "/map/gaussians", "/map/objects", "/map/frontiers",
    "/map/trajectory", "/map/candidates", "/map/plan", "/map/path",
}  # fmt: skip


def maps_on(bus: Bus) -> FakeMaps:
    """Maps with an obstacle, a value layer, an object and Gaussians."""
    occupancy = np.zeros((30, 40), np.int8)
    occupancy[5, 5:20] = 100
    occupancy[20:, :] = -1
    maps = FakeMaps(bus, snapshot_of(occupancy, values={"pick": np.full((30, 40), 0.4, "f4")}))
    found = maps.objects.objects.add(id=3, class_name="cup", score=0.6, gaussians=3)
    found.center_m.CopyFrom(pb.Vector3(x=1, y=2, z=0.5))
    found.size_m.CopyFrom(pb.Vector3(x=0.1, y=0.2, z=0.3))
    return maps


def publish_all(bus: Bus, maps: FakeMaps, seq: int) -> None:
    """Publish one frame and keyframe `seq` with all that a running task says about them."""
    bus.publish(ROBOT_DESCRIPTION, description())
    bus.publish(CONTEXT, context())
    stream, key = frame(2 * seq, keyframe=False), frame(2 * seq + 1)
    bus.publish(FRAME, stream)
    bus.publish(KEYFRAME, key)
    preview = pb.Preview(id=stream.id)
    seen = preview.detections.add(class_name="cup", score=0.9)
    seen.mask.x, seen.mask.y, seen.mask.width, seen.mask.height = 4, 5, 10, 12
    bus.publish(PREVIEW, preview)
    bus.publish(OBSERVATION, pb.Observation(frame=key, context_id=CONTEXT_ID, detector="tiny"))
    bus.publish(TASK, pb.Task(id="t", instruction="Find the cup", state="running", progress=0.5))
    decision = pb.Decision(task_id="t", index=seq, why="the cup may be there")
    candidate = decision.candidates.add(kind="frontier", name="frontier 7", chosen=True)
    candidate.terms["total"] = 0.4
    candidate.position_m.CopyFrom(pb.Vector3(x=0.4, y=1.2))
    bus.publish(DECISION, decision)
    goal = pb.Pose2(x_m=1.0, y_m=1.0, yaw_rad=0.5)
    bus.publish(PLAN, pb.Plan(task_id="t", path_m=[0, 0, 1, 1], goal=goal, purpose="look"))
    maps.change(maps.snapshot)


def start_view(*args: str, stderr: int | None = None) -> subprocess.Popen[str]:
    """Start `helios view` with these arguments."""
    argv = [sys.executable, "-m", "helios_client", "view", *args]
    return subprocess.Popen(argv, stderr=stderr, text=True)


def say_of(*args: str) -> tuple[int, str]:
    """Exit status and stderr of a `helios view` that ends by itself."""
    argv = [sys.executable, "-m", "helios_client", "view", *args]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stderr


class FoxgloveClient:
    """A viewer: subscribes to every channel that the server advertises, and keeps the messages."""

    def __init__(self, port: int) -> None:
        self.schemas: dict[str, str] = {}  # channel -> schema name
        self.messages: dict[str, list[tuple[int, bytes]]] = {}  # channel -> log time, data
        self.other: list[dict[str, Any]] = []  # further messages of the server
        self._topics: dict[int, str] = {}
        self.socket: ClientConnection = connect(
            f"ws://127.0.0.1:{port}", subprotocols=[SUBPROTOCOL], max_size=None
        )

    def receive_all(self) -> None:
        """Handle what has come, up to 500 messages."""
        for _ in range(500):
            if not self.receive(0.02):
                return

    def receive(self, timeout_s: float) -> bool:
        """Handle one message. False if none came in time."""
        try:
            data = self.socket.recv(timeout_s)
        except TimeoutError:
            return False
        if isinstance(data, bytes):
            if data[0] == 1:
                _, subscription, log_time_ns = MESSAGE.unpack_from(data)
                topic = self._topics[subscription]
                self.messages.setdefault(topic, []).append((log_time_ns, data[MESSAGE.size :]))
            return True
        message = json.loads(data)
        if message["op"] == "advertise":
            self._subscribe(message["channels"])
        else:
            self.other.append(message)
        return True

    def _subscribe(self, channels: list[dict[str, Any]]) -> None:
        for channel in channels:
            self.schemas[channel["topic"]] = channel["schemaName"]
            self._topics[channel["id"]] = channel["topic"]
        wanted = [{"id": c["id"], "channelId": c["id"]} for c in channels]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def close(self) -> None:
        self.socket.close()


def recording(folder: Path) -> Path:
    """A finished recording of that robot, three rounds long."""
    from tests.support import wait_until
    from tests.unit.recorder.recorder_bus import Recorded
    from tests.unit.recorder.recorder_maps import last_of

    recorded = Recorded(folder, map_period_s=0.02, flush_s=0.05)
    maps = maps_on(recorded.bus)
    for seq in range(3):
        publish_all(recorded.bus, maps, seq)
    wait_until(lambda: last_of(folder).keys() >= DRAWN, 60, "every channel is recorded")
    recorded.close()
    (path,) = folder.glob("*.mcap")
    return path
