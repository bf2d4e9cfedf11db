"""The 2D map service on an in-process bus."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import state_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.map_snapshot import decode_snapshot
from helios_core.topics import (
    KEYFRAME,
    PICTURE,
    RESET_MAP2D,
    ROBOT_STATE,
    SIGHT,
    SNAPSHOT,
)
from helios_core.types import FrameId, RobotState, Shown
from helios_map2d.service import MOST_WAITING
from map2d_rig import ROBOT, Rig
from map2d_scene import Block, Walk, room


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_keyframes_and_observations_are_acknowledged_and_the_snapshot_decodes(rig: Rig) -> None:
    rig.settle()
    assert [(a.part, a.accepted) for a in rig.acks] == [
        ("occupancy", True),
        ("value", True),
    ] * 12
    versions = [a.version for a in rig.acks]
    assert versions == sorted(set(versions))
    view = decode_snapshot(rig.snapshot())
    assert view.version == versions[-1]
    assert set(view.values) == {"pick", "place"}
    assert (view.occupancy == 100).sum() > 200
    assert view.top_m.max() == pytest.approx(1.5, abs=0.03)
    assert view.robot_pose[:2] == pytest.approx((2.0, 1.5))
    assert view.context_id == "first"
    assert view.explored_m2 > 5
    unchanged = rig.snapshot(if_newer=view.version)
    assert unchanged.unchanged
    assert not unchanged.occupancy


def test_a_planner_can_request_the_ground_alone(rig: Rig) -> None:
    rig.settle()
    whole = decode_snapshot(rig.snapshot())
    reply = rig.bus.call(SNAPSHOT, pb.SnapshotRequest(ground_only=True), 5)
    ground = decode_snapshot(reply)
    assert np.array_equal(ground.occupancy, whole.occupancy)
    assert np.array_equal(ground.top_m, whole.top_m)
    assert (ground.version, ground.origin_m) == (whole.version, whole.origin_m)
    assert list(ground.frontiers) == list(whole.frontiers)
    assert not any((reply.explored, reply.bottom_mm, reply.values))
    assert decode_snapshot(rig.snapshot()).explored.any()  # the two replies are kept apart


def test_keyframes_wait_for_the_robot_description() -> None:
    rig = Rig(described=False)
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    assert not rig.acks
    assert rig.health.state == ("ready", "waits for the robot's description")
    rig.describe()
    assert [(a.part, a.accepted) for a in rig.acks] == [("occupancy", True)]
    assert rig.health.state == ("ready", "")


def test_an_observation_that_waits_too_long_is_refused_with_what_it_waits_for() -> None:
    rig = Rig(described=False)
    rig.search("first")
    frame = rig.walk.frame(2.0, 1.5, 0.0)
    for context_id in ("first", "second", "first"):
        rig.observe(frame, context_id)
    for _ in range(MOST_WAITING - 1):
        rig.observe(frame, "third")
    assert [ack.reason for ack in rig.acks] == [
        "the robot has not described itself; start its bridge",
        "search context 'second' was never announced here",
    ]
    rig.describe(dataclasses.replace(ROBOT, max_depth_m=0.0))
    rig.observe(frame, "third")
    assert "max_depth_m 0" in rig.acks[-1].reason


def test_observations_wait_for_their_context_and_old_ones_are_refused(rig: Rig) -> None:
    rig.search("first")
    early = rig.walk.frame(2.0, 1.5, 0.0)
    rig.observe(early, "second")
    assert not rig.acks
    rig.search("second")
    assert [(a.part, a.accepted, a.context_id) for a in rig.acks] == [("value", True, "second")]
    rig.observe(rig.walk.frame(2.0, 1.5, 0.1), "first")
    assert not rig.acks[-1].accepted
    assert "'first'" in rig.acks[-1].reason


def test_an_invalid_frame_is_refused_with_a_reason_and_the_next_frame_is_accepted(
    rig: Rig,
) -> None:
    good = rig.walk.frame(2.0, 1.5, 0.0)
    rig.keyframe(good)
    far = good.T_world_base.copy()
    far[0, 3] = 300.0
    bad = dataclasses.replace(rig.walk.frame(2.0, 1.5, 0.0), T_world_base=far)
    rig.keyframe(bad)
    assert not rig.acks[-1].accepted
    assert "send both poses in one world" in rig.acks[-1].reason
    rig.bus.publish(KEYFRAME, pb.Frame(id=pb.FrameId(robot_boot_id="boot", seq=77)))
    assert not rig.acks[-1].accepted
    assert rig.acks[-1].reason
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    assert rig.acks[-1].accepted


@pytest.mark.parametrize(("by_then", "now"), [("mug", ""), ("", "mug")])
def test_the_held_object_of_the_frame_overrides_that_of_the_robot_state(
    rig: Rig, by_then: str, now: str
) -> None:
    rig.walk = Walk([*room(), Block((2.35, 1.42, 0.7), (2.45, 1.58, 0.9))])  # like a held object
    for _ in range(3):
        frame = rig.walk.frame(2.0, 1.5, 0.0)
        state = RobotState(
            frame.T_world_base,
            held=now,
            robot_boot_id=frame.id.robot_boot_id,
            world_epoch=frame.id.world_epoch,
        )
        rig.bus.publish(ROBOT_STATE, state_to_proto(state))
        rig.keyframe(dataclasses.replace(frame, held=by_then))
    view = decode_snapshot(rig.snapshot())
    column, row = (
        int((at - low) / view.cell_m) for at, low in zip((2.36, 1.5), view.origin_m, strict=True)
    )
    assert (view.occupancy[row, column] == 100) == (by_then == "")


def test_a_frame_with_a_shown_object_leaves_the_map_as_it_is(rig: Rig) -> None:
    rig.settle()
    before = decode_snapshot(rig.snapshot())
    rig.walk = Walk([*room(), Block((2.5, 1.42, 0.7), (2.6, 1.58, 0.9))])
    for _ in range(3):
        frame = rig.walk.frame(2.0, 1.5, 0.0)
        shown = Shown((2.55, 1.5, 0.8), 0.0)
        rig.keyframe(dataclasses.replace(frame, held="mug", shown=shown))
        assert rig.acks[-1].accepted
    after = decode_snapshot(rig.snapshot())
    assert np.array_equal(before.occupancy, after.occupancy)


def test_a_new_world_epoch_starts_a_fresh_map_with_a_higher_version(rig: Rig) -> None:
    rig.settle()
    before = rig.snapshot()
    rig.walk.epoch = 1
    rig.keyframe(rig.walk.frame(0.5, 0.5, 0.0))
    after = rig.snapshot()
    assert after.id.world_epoch == 1
    assert after.version > before.version
    assert after.explored_m2 < before.explored_m2
    rig.walk.epoch = 0
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    assert not rig.acks[-1].accepted
    assert "is over" in rig.acks[-1].reason


@pytest.mark.parametrize("stranger", [("stranger", 0), (None, 999)])
def test_a_frame_of_another_sender_does_not_block_the_robots_frames(
    rig: Rig, stranger: tuple[str | None, int]
) -> None:
    rig.settle()
    before, mine = rig.snapshot(), rig.walk.frame(2.0, 1.5, 0.0)
    rig.bus.publish(
        ROBOT_STATE,
        pb.RobotState(robot_boot_id=mine.id.robot_boot_id, world_epoch=mine.id.world_epoch),
    )
    boot = stranger[0] or mine.id.robot_boot_id
    rig.keyframe(dataclasses.replace(mine, id=FrameId(boot, stranger[1], 1)))
    rig.search("second")
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.3))
    rig.observe(rig.walk.frame(2.0, 1.5, 0.3), "second")
    assert [a.accepted for a in rig.acks[-2:]] == [True, True], rig.acks[-1].reason
    after = rig.snapshot()
    assert after.version > before.version
    assert after.explored_m2 >= before.explored_m2
    assert after.context_id == "second"


def test_an_empty_map_is_reported_and_a_reset_empties_the_map(rig: Rig) -> None:
    assert rig.snapshot().cell_m == 0
    with pytest.raises(Unavailable, match="no keyframe"):
        rig.bus.call(PICTURE, pb.PictureRequest(), 5)
    rig.settle()
    version = rig.snapshot().version
    rig.bus.call(RESET_MAP2D, pb.Empty(), 5)
    assert rig.snapshot().cell_m == 0
    rig.keyframe(rig.walk.frame(2.0, 1.5, 0.0))
    again = rig.snapshot()
    assert again.version > version
    assert again.context_id == "first"


@pytest.mark.parametrize("layer", ["", "occupancy", "pick"])
def test_a_map_picture_is_a_png_of_the_requested_size(rig: Rig, layer: str) -> None:
    rig.settle()
    mug = pb.MarkedObject(
        label="mug",
        score=0.7,
        center_m=pb.Vector3(x=2.5, y=2.4, z=0.8),
        size_m=pb.Vector3(x=0.1, y=0.1, z=0.1),
    )
    request = pb.PictureRequest(layer=layer, size_px=400, path_m=[1, 1, 2, 1], objects=[mug])
    png = rig.bus.call(PICTURE, request, 5).png
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (400, 400, 3)


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (pb.PictureRequest(layer="nonsense"), "no layer 'nonsense'"),
        (pb.PictureRequest(size_px=100_000), "100000 px"),
        (pb.PictureRequest(path_m=[1.0]), "send x, y"),
        (pb.PictureRequest(path_m=[1.0, math.nan]), "NaN"),
    ],
)
def test_an_invalid_map_picture_request_is_refused(
    rig: Rig, request_: pb.PictureRequest, reason: str
) -> None:
    rig.settle()
    with pytest.raises(InvalidInput, match=reason):
        rig.bus.call(PICTURE, request_, 5)


def test_a_line_of_sight_request_is_answered_for_every_target(rig: Rig) -> None:
    rig.settle()
    targets = [pb.Vector3(x=2.5, y=2.4, z=0.8), pb.Vector3(x=-1.0, y=1.5, z=0.8)]
    request = pb.SightRequest(x_m=2.0, y_m=1.5, z_m=1.31, targets_m=targets)
    assert list(rig.bus.call(SIGHT, request, 5).visible) == [True, False]
