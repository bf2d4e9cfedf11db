"""Frames from outside: named by the bridge, answered by the maps, refused with a reason."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from helios_bridge.push import LONGEST_WAIT_S, PushDriver, capture_of
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import frame_from_proto, frame_to_proto
from helios_core.codec.frames import pose_to_proto
from helios_core.errors import Conflict, DeadlineExceeded, InvalidInput, Unavailable
from helios_core.geometry import Pinhole, base_below_camera, camera_on_base, se2_to_se3
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import RobotDriver
from helios_core.topics import (
    CONTEXT,
    ESTIMATE_DEPTH,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    PUSH,
    ROBOT_STATE,
)
from helios_core.types import Frame, FrameId

from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot

CAMERA = Pinhole(8.0, 8.0, 8.0, 6.0, 16, 12)
T_WORLD_CAM = camera_on_base(se2_to_se3(1.0, 2.0, 0.3), 1.1, 0.4)
ALL = {"map2d/occupancy", "map2d/value", "objectmap/objects"}


def pushed(**id_: Any) -> pb.Frame:
    """A frame as an outsider sends it: without T_world_base."""
    frame = frame_to_proto(
        Frame(
            FrameId("", 0, 0), 5, True, np.full((12, 16, 3), 9, np.uint8),
            np.full((12, 16), 1.5, np.float32), CAMERA, T_WORLD_CAM, np.eye(4),
        )
    )  # fmt: skip
    frame.ClearField("T_world_base")
    frame.id.CopyFrom(pb.FrameId(**id_))
    return frame


class House:
    """A bridge that takes frames, and maps that answer what `parts` says."""

    def __init__(self, driver: RobotDriver | None = None, **settings: Any) -> None:
        hub = MemoryHub()
        self.bus, self.other = MemoryBus(hub), MemoryBus(hub)
        self.health = Health()
        values: dict[str, Any] = {"stream_hz": 0.0, **settings}
        self.bridge = BridgeService(
            self.bus, driver or PushDriver(), Settings(**values), self.health, 0
        )  # fmt: skip
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
                service=service, part=part, id=frame.id, accepted=not self.refusal,
                reason=self.refusal,
            )  # fmt: skip
            self.other.publish(topic, ack)

    def push(self, frame: pb.Frame, wait_s: float = 0.05, classes: tuple[str, ...] = ()):
        request = pb.PushRequest(frame=frame, wait_s=wait_s, classes=classes)
        return self.other.call(PUSH, request, 20)


def answered(reply: pb.PushReply) -> set[str]:
    return {f"{a.service}/{a.part}" for a in reply.acks if a.accepted}


def test_a_frame_becomes_a_keyframe_and_its_answer_says_which_maps_took_it() -> None:
    house = House()
    reply = house.push(pushed(), classes=("mug",))
    assert answered(reply) == ALL
    assert list(reply.unanswered) == []
    (sent,) = house.keyframes
    assert sent.id == reply.id
    frame = frame_from_proto(sent)
    np.testing.assert_allclose(frame.T_world_cam, T_WORLD_CAM, atol=1e-9)
    np.testing.assert_allclose(frame.T_world_base, base_below_camera(T_WORLD_CAM), atol=1e-9)
    np.testing.assert_allclose(frame.depth_m, 1.5)
    assert frame.keyframe


def test_frames_are_numbered_and_their_world_is_the_senders() -> None:
    house = House()
    ids = [house.push(pushed(robot_boot_id="me", world_epoch=3, seq=77)).id for _ in range(3)]
    assert ids[0].seq < ids[1].seq < ids[2].seq
    assert {(id.robot_boot_id, id.world_epoch) for id in ids} == {("me", 3)}
    state = house.bridge.state()
    assert (state.robot_boot_id, state.world_epoch) == ("me", 3)
    assert state.last_seq == ids[2].seq


def test_the_maps_hear_of_a_new_world_before_its_first_frame() -> None:
    house = House()
    heard: list[tuple[str, int]] = []
    house.other.subscribe(ROBOT_STATE, lambda s: heard.append(("state", s.world_epoch)))
    house.other.subscribe(KEYFRAME, lambda f: heard.append(("frame", f.id.world_epoch)))
    for epoch in (1, 2):
        house.push(pushed(robot_boot_id="me", world_epoch=epoch))
        assert heard.index(("state", epoch)) < heard.index(("frame", epoch))


def test_the_robots_state_is_told_after_each_frame() -> None:
    house = House()
    told: list[pb.RobotState] = []
    house.other.subscribe(ROBOT_STATE, told.append)
    for _ in range(2):
        id = house.push(pushed(robot_boot_id="me")).id
        assert (told[-1].robot_boot_id, told[-1].last_seq) == ("me", id.seq)


def test_without_a_world_of_its_own_all_frames_share_the_bridges() -> None:
    house = House()
    first, second = house.push(pushed()).id, house.push(pushed()).id
    assert first.robot_boot_id == second.robot_boot_id != ""


def test_a_refusal_of_a_map_comes_back_with_its_reason() -> None:
    house = House()
    house.refusal = "another world epoch"
    reply = house.push(pushed())
    assert {a.reason for a in reply.acks} == {"another world epoch"}
    assert answered(reply) == set()


def test_a_map_that_does_not_answer_is_named() -> None:
    house = House()
    house.parts = {"map2d/occupancy"}
    reply = house.push(pushed(), classes=("mug",))
    assert list(reply.unanswered) == ["map2d/value", "objectmap/objects"]


def test_while_nothing_is_looked_for_only_the_occupancy_is_waited_for() -> None:
    house = House()
    house.parts = {"map2d/occupancy"}
    reply = house.push(pushed(), wait_s=LONGEST_WAIT_S)
    assert answered(reply) == {"map2d/occupancy"}
    assert list(reply.unanswered) == []


def test_a_search_that_somebody_else_began_is_waited_for_too() -> None:
    house = House()
    house.parts = {"map2d/occupancy"}
    house.other.publish(CONTEXT, pb.SearchContext(id="a task"))
    assert list(house.push(pushed()).unanswered) == ["map2d/value", "objectmap/objects"]


def test_a_frame_is_captured_once() -> None:
    driver = PushDriver()
    driver.offer(capture_of(pushed(), estimated_depth=False), "me", 0)
    driver.capture()
    with pytest.raises(Unavailable, match="no frame has come since"):
        driver.capture()


def test_what_is_looked_for_is_announced_once_and_anew_when_it_changes() -> None:
    house = House()
    for classes in (("mug", " dining  table "), ("mug", "dining table"), (), ("sofa",)):
        house.push(pushed(), classes=classes)
    assert [[c.name for c in context.classes] for context in house.contexts] == [
        ["mug", "dining table"],
        ["sofa"],
    ]
    assert len({context.id for context in house.contexts}) == 2


def _no_depth(frame: pb.Frame) -> None:
    frame.ClearField("raw_depth")


def _no_color(frame: pb.Frame) -> None:
    frame.ClearField("raw_color")


def _other_size(frame: pb.Frame) -> None:
    frame.calibration.width = 17


def _no_pose(frame: pb.Frame) -> None:
    frame.ClearField("T_world_cam")


def _deep_color(frame: pb.Frame) -> None:
    deep = cv2.imencode(".png", np.zeros((12, 16, 3), np.uint16))[1].tobytes()
    frame.compressed_color.CopyFrom(CompressedImage(data=deep, format="png"))


def _long_name(frame: pb.Frame) -> None:
    frame.id.robot_boot_id = "x" * 1000


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_no_depth, "no depth image"),
        (_no_color, "no colour image"),
        (_deep_color, "16 bit a channel"),
        (_other_size, "sizes disagree"),
        (_no_pose, "T_world_cam"),
        (_long_name, "robot_boot_id"),
    ],
)
def test_a_frame_that_does_not_hold_together_is_refused_and_the_next_is_taken(
    spoil: Callable[[pb.Frame], None], said: str
) -> None:
    house, frame = House(), pushed()
    spoil(frame)
    with pytest.raises(InvalidInput, match=said):
        house.push(frame)
    assert house.keyframes == []
    assert answered(house.push(pushed()))


def posed(T_world_cam: np.ndarray, T_world_base: np.ndarray | None) -> pb.Frame:
    frame = pushed()
    frame.T_world_cam.CopyFrom(pose_to_proto(T_world_cam, 5))
    if T_world_base is not None:
        frame.T_world_base.CopyFrom(pose_to_proto(T_world_base, 5))
    return frame


def raised(T: np.ndarray, by_m: float) -> np.ndarray:
    out = T.copy()
    out[2, 3] += by_m
    return out


def leaning(degrees: float) -> np.ndarray:
    """A base that has rolled to its left."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    out = se2_to_se3(1.0, 2.0, 0.3)
    out[:3, :3] = out[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return out


ON_FLOOR = se2_to_se3(1.0, 2.0, 0.3)


@pytest.mark.parametrize(
    ("T_world_cam", "T_world_base", "said"),
    [
        (T_WORLD_CAM, leaning(180), "T_world_base leans by 180 degrees"),
        (T_WORLD_CAM, leaning(46), "upright"),
        (T_WORLD_CAM, raised(ON_FLOOR, 500), "T_world_base is at a height of 500.0 m"),
        (T_WORLD_CAM, raised(ON_FLOOR, -2.1), "height of -2.1 m"),
        (raised(T_WORLD_CAM, 500), None, "T_world_cam is at a height of 501.1 m"),
        (raised(T_WORLD_CAM, -3.2), None, "T_world_cam is at a height of -2.1 m"),
        (T_WORLD_CAM, se2_to_se3(40.0, 2.0, 0.3), "39.0 m from its base"),
    ],
)
def test_poses_that_no_robot_has_are_refused(
    T_world_cam: np.ndarray, T_world_base: np.ndarray | None, said: str
) -> None:
    house = House()
    with pytest.raises(InvalidInput, match=said):
        house.push(posed(T_world_cam, T_world_base), classes=("mug",))
    assert house.keyframes == []
    assert house.contexts == []


@pytest.mark.parametrize(
    ("T_world_cam", "T_world_base"),
    [
        (T_WORLD_CAM, leaning(44)),  # on stairs
        (raised(T_WORLD_CAM, 1.9), raised(ON_FLOOR, 1.9)),  # a ramp, or a drifting localisation
        (raised(T_WORLD_CAM, 8.0), None),  # on a mast
        (T_WORLD_CAM @ np.diag([-1.0, -1.0, 1.0, 1.0]), None),  # a camera that hangs upside down
        (camera_on_base(ON_FLOOR, 1.1, np.pi / 2), None),  # straight down
        (T_WORLD_CAM, ON_FLOOR @ raised(np.eye(4), 0.5)),  # a body's frame for the base's
    ],
)
def test_unusual_robots_are_taken(T_world_cam: np.ndarray, T_world_base: np.ndarray | None) -> None:
    house = House()
    assert answered(house.push(posed(T_world_cam, T_world_base)))


@pytest.mark.parametrize("wait_s", [-1.0, float("nan"), float("inf"), 1e6])
def test_a_wait_that_makes_no_sense_is_refused(wait_s: float) -> None:
    with pytest.raises(InvalidInput, match="wait_s"):
        House().push(pushed(), wait_s=wait_s)


@pytest.mark.parametrize("classes", [("",), ("x" * 65,), tuple(f"c{i}" for i in range(65))])
def test_names_that_make_no_sense_are_refused(classes: tuple[str, ...]) -> None:
    house = House()
    with pytest.raises(InvalidInput, match="classes"):
        house.push(pushed(), classes=classes)
    assert house.contexts == []


def test_a_claimed_size_allocates_nothing() -> None:
    house, frame = House(depth="estimated"), pushed()
    frame.ClearField("raw_depth")
    frame.calibration.width = frame.calibration.height = 2**32 - 1
    with pytest.raises(InvalidInput, match="smaller"):
        house.push(frame)


def test_a_frame_without_depth_is_taken_where_depth_is_estimated() -> None:
    house, frame = House(depth="estimated"), pushed()
    frame.ClearField("raw_depth")
    depth = pushed().raw_depth
    house.other.serve(
        ESTIMATE_DEPTH, lambda _: pb.DepthReply(raw_depth=depth, focal_px=8.0, model="m")
    )
    assert answered(house.push(frame))
    np.testing.assert_allclose(frame_from_proto(house.keyframes[0]).depth_m, 1.5, atol=1e-6)


def test_a_robot_with_a_camera_of_its_own_takes_no_frames() -> None:
    house = House(LineRobot())
    with pytest.raises(Conflict, match="--robot push"):
        house.push(pushed())


def test_frames_that_come_together_are_taken_one_after_the_other() -> None:
    house = House()
    replies: list[pb.PushReply] = []
    senders = [
        threading.Thread(target=lambda: replies.append(house.push(pushed()))) for _ in range(8)
    ]
    for sender in senders:
        sender.start()
    for sender in senders:
        sender.join(20)
    assert len({reply.id.seq for reply in replies}) == 8
    assert all(answered(reply) for reply in replies)


def test_a_frame_that_has_to_wait_too_long_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helios_bridge.push.LONGEST_TURN_S", 0.05)
    house = House()
    begun, go_on = threading.Event(), threading.Event()

    def hang(_: pb.Frame) -> None:
        begun.set()
        go_on.wait(10)

    house.other.subscribe(KEYFRAME, hang)
    slow = threading.Thread(target=lambda: house.push(pushed()))
    slow.start()
    wait_until(begun.is_set, 5, "the first frame is being taken")
    with pytest.raises(DeadlineExceeded, match="slower"):
        house.push(pushed())
    go_on.set()
    slow.join(10)
