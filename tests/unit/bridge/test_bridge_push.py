"""Pushed frames: numbered by the bridge, announced to the maps, answered by them, in turn."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from helios_bridge.pushed_frames import LONGEST_WAIT_S, PushDriver, capture_of
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable
from helios_core.geometry import base_below_camera
from helios_core.topics import CONTEXT, DETECTOR_ACK, ESTIMATE_DEPTH, KEYFRAME, ROBOT_STATE

from tests.support import wait_until
from tests.unit.bridge.bridge_push_stage import ALL, T_WORLD_CAM, Rig, answered, pushed


def test_a_pushed_frame_becomes_a_keyframe_and_the_reply_lists_the_maps_that_accept() -> None:
    rig = Rig()
    reply = rig.push(pushed(), classes=("mug",))
    assert answered(reply) == ALL
    assert list(reply.unanswered) == []
    (sent,) = rig.keyframes
    assert sent.id == reply.id
    frame = frame_from_proto(sent)
    np.testing.assert_allclose(frame.T_world_cam, T_WORLD_CAM, atol=1e-9)
    np.testing.assert_allclose(frame.T_world_base, base_below_camera(T_WORLD_CAM), atol=1e-9)
    np.testing.assert_allclose(frame.depth_m, 1.5)
    assert frame.keyframe


def test_pushed_frames_are_numbered_and_keep_the_world_of_their_sender() -> None:
    rig = Rig()
    ids = [rig.push(pushed(robot_boot_id="me", world_epoch=3, seq=77)).id for _ in range(3)]
    assert ids[0].seq < ids[1].seq < ids[2].seq
    assert {(id.robot_boot_id, id.world_epoch) for id in ids} == {("me", 3)}
    state = rig.bridge.state()
    assert (state.robot_boot_id, state.world_epoch) == ("me", 3)
    assert state.last_seq == ids[2].seq


def test_the_origin_id_of_a_sender_is_in_its_keyframes_and_the_state() -> None:
    rig = Rig()
    for origin_id in ("kitchen", "garage", ""):
        frame = pushed(robot_boot_id="me")
        frame.origin_id = origin_id
        rig.push(frame)
        assert rig.keyframes[-1].origin_id == origin_id
        assert rig.bridge.state().origin_id == origin_id


def test_an_overlong_origin_id_is_refused() -> None:
    frame = pushed()
    frame.origin_id = "x" * 65
    with pytest.raises(InvalidInput, match="origin_id is longer than 64"):
        Rig().push(frame)


def test_a_new_world_is_published_before_its_first_frame() -> None:
    rig = Rig()
    heard: list[tuple[str, int]] = []
    rig.other.subscribe(ROBOT_STATE, lambda s: heard.append(("state", s.world_epoch)))
    rig.other.subscribe(KEYFRAME, lambda f: heard.append(("frame", f.id.world_epoch)))
    for epoch in (1, 2):
        rig.push(pushed(robot_boot_id="me", world_epoch=epoch))
        assert heard.index(("state", epoch)) < heard.index(("frame", epoch))


def test_the_robot_state_is_published_after_each_frame() -> None:
    rig = Rig()
    reported: list[pb.RobotState] = []
    rig.other.subscribe(ROBOT_STATE, reported.append)
    for _ in range(2):
        id = rig.push(pushed(robot_boot_id="me")).id
        assert (reported[-1].robot_boot_id, reported[-1].last_seq) == ("me", id.seq)


def test_frames_without_a_world_share_the_world_of_the_bridge() -> None:
    rig = Rig()
    first, second = rig.push(pushed()).id, rig.push(pushed()).id
    assert first.robot_boot_id == second.robot_boot_id != ""


def test_the_reply_contains_the_reason_of_a_refusal_by_a_map() -> None:
    rig = Rig()
    rig.refusal = "another world epoch"
    reply = rig.push(pushed())
    assert {a.reason for a in reply.acks} == {"another world epoch"}
    assert answered(reply) == set()


def test_the_reply_names_the_map_parts_that_do_not_answer() -> None:
    rig = Rig()
    rig.parts = {"map2d/occupancy"}
    reply = rig.push(pushed(), classes=("mug",))
    assert list(reply.unanswered) == ["map2d/value", "objectmap/objects"]


def test_detections_that_the_detector_refused_are_not_waited_for_and_the_reason_returns() -> None:
    rig = Rig()
    rig.parts = {"map2d/occupancy"}

    def refuse(frame: pb.Frame) -> None:
        ack = pb.Ack(service="detector", part="observation", id=frame.id, reason="no model")
        rig.other.publish(DETECTOR_ACK, ack)

    rig.other.subscribe(KEYFRAME, refuse)
    reply = rig.push(pushed(), classes=("mug",), wait_s=LONGEST_WAIT_S)
    assert list(reply.unanswered) == []
    reported = {(a.service, a.accepted, a.reason) for a in reply.acks}
    assert len(reply.acks) == 2
    assert ("detector", False, "no model") in reported


def test_only_the_occupancy_is_waited_for_without_a_search() -> None:
    rig = Rig()
    rig.parts = {"map2d/occupancy"}
    reply = rig.push(pushed(), wait_s=LONGEST_WAIT_S)
    assert answered(reply) == {"map2d/occupancy"}
    assert list(reply.unanswered) == []


def test_the_parts_of_a_search_by_another_client_are_waited_for() -> None:
    rig = Rig()
    rig.parts = {"map2d/occupancy"}
    rig.other.publish(CONTEXT, pb.SearchContext(id="a task"))
    assert list(rig.push(pushed()).unanswered) == ["map2d/value", "objectmap/objects"]


def test_a_frame_is_captured_once() -> None:
    driver = PushDriver()
    driver.offer(capture_of(pushed(), estimated_depth=False), "me", 0)
    driver.capture()
    with pytest.raises(Unavailable, match="no frame has come since"):
        driver.capture()


def test_a_search_context_is_published_once_and_again_when_the_classes_change() -> None:
    rig = Rig()
    for classes in (("mug", " dining  table "), ("mug", "dining table"), (), ("sofa",)):
        rig.push(pushed(), classes=classes)
    assert [[c.name for c in context.classes] for context in rig.contexts] == [
        ["mug", "dining table"],
        ["sofa"],
    ]
    assert len({context.id for context in rig.contexts}) == 2


def test_a_push_gets_its_search_back_after_another_client_began_one() -> None:
    rig = Rig()
    rig.push(pushed(), classes=("mug",))
    rig.other.publish(CONTEXT, pb.SearchContext(id="a task"))
    rig.push(pushed())  # without classes: as before, which is the task's search
    for _ in range(2):
        rig.push(pushed(), classes=("mug",))
    assert [[c.name for c in context.classes] for context in rig.contexts] == [["mug"], [], ["mug"]]
    assert len({context.id for context in rig.contexts}) == 3


def test_a_frame_without_depth_is_accepted_if_depth_is_estimated() -> None:
    rig, frame = Rig(depth="estimated"), pushed()
    frame.ClearField("raw_depth")
    depth = pushed().raw_depth
    rig.other.serve(
        ESTIMATE_DEPTH, lambda _: pb.DepthReply(raw_depth=depth, focal_px=8.0, model="m")
    )
    assert answered(rig.push(frame))
    np.testing.assert_allclose(frame_from_proto(rig.keyframes[0]).depth_m, 1.5, atol=1e-6)


def test_concurrent_frames_are_handled_one_after_the_other() -> None:
    rig = Rig()
    replies: list[pb.PushReply] = []
    senders = [
        threading.Thread(target=lambda: replies.append(rig.push(pushed()))) for _ in range(8)
    ]
    for sender in senders:
        sender.start()
    for sender in senders:
        sender.join(20)
    assert len({reply.id.seq for reply in replies}) == 8
    assert all(answered(reply) for reply in replies)


def test_a_frame_that_waits_too_long_for_its_turn_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("helios_bridge.pushed_frames.LONGEST_TURN_S", 0.05)
    rig = Rig()
    begun, go_on = threading.Event(), threading.Event()

    def hang(_: pb.Frame) -> None:
        begun.set()
        go_on.wait(10)

    rig.other.subscribe(KEYFRAME, hang)
    slow = threading.Thread(target=lambda: rig.push(pushed()))
    slow.start()
    wait_until(begun.is_set, 60, "the first frame is being taken")
    with pytest.raises(DeadlineExceeded, match="slower"):
        rig.push(pushed())
    go_on.set()
    slow.join(10)
