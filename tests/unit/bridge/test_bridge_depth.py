"""A robot without depth: the bridge requests an estimate before it publishes a frame."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, ActionResult, Capture, RobotDriver
from helios_core.topics import ACT, ESTIMATE_DEPTH, KEYFRAME, LEASE
from helios_core.types import RobotDescription, RobotState

CAMERA = Pinhole(8.0, 9.0, 8.0, 6.0, 16, 12)
BASE = se2_to_se3(0, 0, 0)


class BlindRobot(RobotDriver):
    """Stands still; its depth image is empty."""

    def describe(self) -> RobotDescription:
        return RobotDescription("blind", 0.3, 1.0, CAMERA, 1.0, 0.8, 5.0)

    def state(self) -> RobotState:
        return RobotState(BASE)

    def capture(self) -> Capture:
        return Capture(
            stamp_ns=1,
            color=np.full((12, 16, 3), 7, np.uint8),
            depth_m=np.zeros((12, 16), np.float32),
            camera=CAMERA,
            T_world_cam=camera_on_base(BASE, 1.0, 0.5),
            T_world_base=BASE,
        )

    def act(self, action: Action, action_id: str) -> ActionResult:
        return ActionResult(True)

    def stop(self, reason: str) -> None:
        """Does not move."""

    def clear_stop(self) -> None:
        """Does not move."""

    def close(self) -> None:
        """Holds nothing."""


class Rig:
    """A bridge that requests depth, and a fake depth estimator."""

    def __init__(self, depth: Literal["sensor", "estimated"] = "estimated") -> None:
        hub = MemoryHub()
        self.bus = MemoryBus(hub)
        self.frames: list[pb.Frame] = []
        self.asked: list[pb.DepthRequest] = []
        self.focal_px, self.shape = 8.0, (12, 16)
        self.bus.subscribe(KEYFRAME, self.frames.append)
        settings = Settings(depth=depth, depth_timeout_s=1.0)
        self.bridge = BridgeService(MemoryBus(hub), BlindRobot(), settings, Health(), 1)

    def serve(self) -> None:
        self.bus.serve(ESTIMATE_DEPTH, self.answer)

    def answer(self, request: pb.DepthRequest) -> pb.DepthReply:
        self.asked.append(request)
        height, width = self.shape
        mm = np.full(self.shape, 2500, "<u2").tobytes()
        image = RawImage(width=width, height=height, encoding="16UC1", step=2 * width, data=mm)
        return pb.DepthReply(raw_depth=image, focal_px=self.focal_px, model="m")

    def look(self) -> pb.ActionResult:
        token = self.bus.call(LEASE, pb.LeaseRequest(holder="test"), 1.0).token
        request = pb.ActionRequest(action_id="1", lease_token=token, time_remaining_s=5.0)
        request.action.observe.SetInParent()
        return self.bus.call(ACT, request, 5.0)


def test_a_frame_is_published_with_depth_estimated_from_its_colour():
    rig = Rig()
    rig.serve()
    rig.look()
    frame = frame_from_proto(rig.frames[0])
    assert (frame.depth_m == 2.5).all()
    assert frame.camera == CAMERA
    (request,) = rig.asked
    assert request.calibration.K[0] == 8.0
    assert request.raw_color.data == b"\x07" * (12 * 16 * 3)


def test_the_frame_uses_the_focal_length_of_the_depth_model():
    rig = Rig()
    rig.serve()
    rig.focal_px = 16.0
    rig.look()
    camera = frame_from_proto(rig.frames[0]).camera
    assert (camera.fx, camera.fy, camera.cx) == (16.0, 18.0, 8.0)


def test_a_robot_with_a_depth_sensor_requests_no_estimate():
    rig = Rig("sensor")
    rig.serve()
    rig.look()
    assert rig.asked == []
    assert (frame_from_proto(rig.frames[0]).depth_m == 0).all()


def test_a_missing_depth_estimator_raises_an_error_and_no_frame_is_published():
    rig = Rig()
    with pytest.raises(Unavailable):
        rig.look()
    assert rig.frames == []


def test_depth_of_another_size_is_refused():
    rig = Rig()
    rig.serve()
    rig.shape = (6, 8)
    with pytest.raises(InvalidInput, match=r"m made depth of \(6, 8\) for an image of \(12, 16\)"):
        rig.look()
    assert rig.frames == []


@pytest.mark.parametrize("focal_px", [0.0, -8.0, float("nan"), float("inf")])
def test_depth_with_an_invalid_focal_length_is_refused(focal_px: float):
    rig = Rig()
    rig.serve()
    rig.focal_px = focal_px
    with pytest.raises(InvalidInput, match="focal length"):
        rig.look()
    assert rig.frames == []
