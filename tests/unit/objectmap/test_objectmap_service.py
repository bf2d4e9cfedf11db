"""The object map service on a MemoryBus: acknowledgements, contexts, epochs, replies, errors."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import (
    context_to_proto,
    object_from_proto,
    observation_to_proto,
    state_to_proto,
)
from helios_core.codec.frames import pinhole_to_proto, transform_to_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CONTEXT,
    GAUSSIANS,
    OBJECTMAP_ACK,
    OBJECTS,
    OBSERVATION,
    RESET_OBJECTS,
    RETIRE,
    RETIRED,
    ROBOT_STATE,
    WHAT_IF,
)
from helios_core.types import RobotState, SearchContext
from helios_objectmap.object_messages import camera_of
from helios_objectmap.service import MOST_WAITING, ObjectMapService
from helios_objectmap.settings import ObjectMapSettings
from objectmap_scene import (
    CAMERA,
    MUG,
    ROOM,
    SETTINGS,
    looking_at,
    mug_at,
    observe,
)
from objectmap_scene import (
    CONTEXT as SOUGHT,
)

from tests.support import wait_until

SCENE = (*ROOM, mug_at(1.2, 0.0))
MUG_CENTER = (1.2, 0.0, 0.8)


class Rig:
    """A service on a bus, and a stand-in for all its clients."""

    def __init__(self, settings: ObjectMapSettings = SETTINGS) -> None:
        hub = MemoryHub()
        self.bus = MemoryBus(hub)
        self.health = Health()
        self.acks: list[pb.Ack] = []
        self.next_seq = 0
        self.bus.subscribe(OBJECTMAP_ACK, self.acks.append)
        self.service = ObjectMapService(MemoryBus(hub), settings, self.health)

    def ask_for(self, context: SearchContext = SOUGHT) -> None:
        self.bus.publish(CONTEXT, context_to_proto(context))

    def see(self, x: float = 0.0, y: float = 0.0, seq: int | None = None, **kw) -> None:
        """Send an observation; seq: number of its frame, by default that of the next frame."""
        seq = self.next_seq if seq is None else seq
        self.next_seq = seq + 1
        o = observe(SCENE, looking_at(x, y, MUG_CENTER), seq=seq, **kw)
        self.bus.publish(OBSERVATION, observation_to_proto(o))

    def objects(self, *names: str):
        reply = self.bus.call(OBJECTS, pb.ObjectsRequest(class_names=names), 30.0)
        return [object_from_proto(o) for o in reply.objects]


@pytest.fixture
def rig() -> Rig:
    return Rig()


@pytest.mark.parametrize(
    "flags",
    [
        ("--min-depth-m=9",),
        ("--max-depth-m=0.2",),
        ("--min-depth-m=1", "--max-depth-m=1"),
    ],
)
def test_depth_limits_that_leave_no_depth_are_refused(flags, capsys):
    with pytest.raises(SystemExit):
        ObjectMapSettings.load(flags)
    assert "give a max_depth_m above min_depth_m" in capsys.readouterr().err


def test_warm_up_makes_the_service_ready(rig):
    assert rig.health.state[0] == "starting"
    rig.service.warm_up()
    assert rig.health.state[0] == "ready"
    assert not rig.objects()


DEADLINE_S = 30.0


@pytest.fixture
def compiling(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """The kernels are compiled until this event is set."""
    compiled = threading.Event()
    monkeypatch.setattr("helios_objectmap.service.warm_up", lambda _: compiled.wait(DEADLINE_S))
    yield compiled
    compiled.set()


def in_thread(call: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    return thread


def test_queries_are_answered_and_the_service_ends_while_kernels_are_compiled(tmp_path, compiling):
    rig = Rig(SETTINGS.model_copy(update={"state_dir": tmp_path, "save_every_s": 3600.0}))
    warming = in_thread(rig.service.warm_up)
    wait_until(rig.service._compiling.locked, DEADLINE_S, "the kernels are compiled")
    assert not rig.objects()
    ending = in_thread(rig.service.close)
    ending.join(DEADLINE_S)
    assert not ending.is_alive()
    assert warming.is_alive()
    assert not compiling.is_set()


def test_the_service_ends_while_a_query_compiles_kernels(tmp_path, monkeypatch):
    monkeypatch.setattr("helios_objectmap.service.CLOSE_WITHIN_S", 0.01)
    rig = Rig(SETTINGS.model_copy(update={"state_dir": tmp_path, "save_every_s": 3600.0}))
    with rig.service._lock:  # as a query holds it
        ending = in_thread(rig.service.close)
        ending.join(DEADLINE_S)
        assert not ending.is_alive()


def test_all_observations_that_come_while_kernels_are_compiled_count_afterwards(rig, compiling):
    rig.ask_for()
    warming = in_thread(rig.service.warm_up)
    wait_until(rig.service._compiling.locked, DEADLINE_S, "the kernels are compiled")
    poses = [(0.3 * k, 0.1 * k) for k in range(MOST_WAITING + 2)]
    looking = in_thread(lambda: [rig.see(*pose, seq=k) for k, pose in enumerate(poses)])
    assert not rig.acks
    compiling.set()
    for thread in (warming, looking):
        thread.join(DEADLINE_S)
    assert [(a.accepted, a.id.seq) for a in rig.acks] == [(True, k) for k in range(len(poses))]
    assert rig.health.state[0] == "ready"


def test_every_observation_is_acknowledged_and_its_objects_can_be_queried(rig):
    rig.ask_for()
    rig.see(seq=1)
    rig.see(0.2, 0.3, seq=2)
    assert [(a.accepted, a.id.seq, a.part, a.service) for a in rig.acks] == [
        (True, 1, "objects", "objectmap"),
        (True, 2, "objects", "objectmap"),
    ]
    (mug,) = rig.objects("mug")
    assert np.linalg.norm(mug.center_m - MUG_CENTER) < 0.06
    reply = rig.bus.call(OBJECTS, pb.ObjectsRequest(), 30.0)
    assert {o.class_name for o in reply.objects} == {"mug", "table"}
    assert reply.id.seq == 2
    assert reply.version == rig.acks[-1].version
    assert reply.gaussians > 1000
    assert not rig.bus.call(OBJECTS, pb.ObjectsRequest(min_class_score=0.99), 30.0).objects


def test_an_observation_waits_for_its_search_context(rig):
    rig.see(seq=1)
    assert not rig.acks
    rig.ask_for()
    assert [a.accepted for a in rig.acks] == [True]


def test_an_observation_waits_for_its_search_context_while_another_one_comes(rig):
    rig.see(seq=1)
    rig.ask_for(SearchContext("another", (MUG,)))
    assert not rig.acks
    rig.ask_for()
    assert [(a.accepted, a.id.seq) for a in rig.acks] == [(True, 1)]


def test_of_observations_of_a_context_that_never_comes_the_oldest_are_refused_with_the_reason(rig):
    for seq in range(MOST_WAITING + 1):
        rig.see(seq=seq)
    assert [(a.accepted, a.id.seq) for a in rig.acks] == [(False, 0)]
    rig.ask_for(SearchContext("another", (MUG,)))
    rig.see(seq=MOST_WAITING + 1)
    assert [(a.accepted, a.id.seq) for a in rig.acks] == [(False, 0), (False, 1)]
    assert "c1" in rig.acks[-1].reason


def test_an_observation_of_an_ended_context_is_refused(rig):
    rig.ask_for()
    rig.ask_for(SearchContext("c2", (MUG,)))
    rig.see(seq=1)
    (ack,) = rig.acks
    assert not ack.accepted
    assert "c2" in ack.reason


def test_a_new_world_epoch_parks_the_map_and_observations_of_the_old_one_are_refused(rig):
    rig.ask_for()
    rig.see(seq=1)
    rig.see(seq=1, epoch=1, called={})
    assert not rig.objects()
    rig.see(seq=2, epoch=0)
    assert [a.accepted for a in rig.acks] == [True, True, False]
    assert "put aside" in rig.acks[-1].reason


def test_a_frame_of_another_sender_does_not_block_the_robots_frames(rig):
    rig.ask_for()
    rig.see(seq=1)
    found = rig.objects()
    assert found
    boot = observe(SCENE, looking_at(0, 0, MUG_CENTER), seq=1).frame.id.robot_boot_id
    rig.bus.publish(ROBOT_STATE, state_to_proto(RobotState(np.eye(4), robot_boot_id=boot)))
    rig.see(seq=1, epoch=999, called={})
    assert not rig.objects()
    rig.see(seq=2, epoch=0)
    assert [a.accepted for a in rig.acks] == [True, True, True]
    assert [o.id for o in rig.objects()] == [o.id for o in found]


def test_an_unreadable_observation_is_acknowledged_as_refused(rig, monkeypatch):
    def broken(_):
        raise ValueError("a fault")

    monkeypatch.setattr("helios_objectmap.service.observation_from_proto", broken)
    rig.see(seq=1)
    assert [a.accepted for a in rig.acks] == [False]


def test_a_corrupt_observation_is_refused_and_the_next_one_is_accepted(rig):
    rig.ask_for()
    o = observation_to_proto(observe(SCENE, looking_at(0, 0, MUG_CENTER), seq=1))
    o.frame.T_world_cam.pose.position.x = float("nan")
    rig.bus.publish(OBSERVATION, o)
    rig.see(seq=2)
    assert [a.accepted for a in rig.acks] == [False, True]
    assert rig.acks[0].reason


def test_a_held_object_is_not_added_to_the_map(rig):
    rig.ask_for()
    rig.bus.publish(ROBOT_STATE, state_to_proto(RobotState(np.eye(4), held="mug")))
    near = (*ROOM, ("mug", (0.5, -0.1, 0.9), (0.6, 0.1, 1.1)))
    o = observe(near, looking_at(0, 0, MUG_CENTER))
    rig.bus.publish(OBSERVATION, observation_to_proto(o))
    assert not rig.objects("mug")


@pytest.mark.parametrize(("by_then", "now"), [("mug", ""), ("", "mug")])
def test_the_held_object_of_the_frame_overrides_that_of_the_robot_state(
    rig, by_then: str, now: str
):
    rig.ask_for()
    rig.bus.publish(ROBOT_STATE, state_to_proto(RobotState(np.eye(4), held=now)))
    near = (*ROOM, ("mug", (0.5, -0.1, 0.9), (0.6, 0.1, 1.1)))
    message = observation_to_proto(observe(near, looking_at(0, 0, MUG_CENTER)))
    message.frame.held = by_then
    rig.bus.publish(OBSERVATION, message)
    assert bool(rig.objects("mug")) == (by_then == "")


def what_if(
    rig: Rig, object_id: int, name: str = "mug", joint: bool = False, other: float | None = None
):
    poses = [looking_at(0.4, y, MUG_CENTER) for y in (-0.2, 0.2)]
    return rig.bus.call(
        WHAT_IF,
        pb.WhatIfRequest(
            object_id=object_id,
            class_name=name,
            T_world_cam=[transform_to_proto(T) for T in poses],
            camera=pinhole_to_proto(CAMERA),
            joint=joint,
            other_share=other,
        ),
        1.0,
    )


def test_what_if_answers_per_pose_or_jointly(rig):
    rig.ask_for()
    rig.see()
    (mug,) = rig.objects("mug")
    each, joint = what_if(rig, mug.id), what_if(rig, mug.id, joint=True)
    assert len(each.score) == 2
    assert min(each.score) > mug.score
    assert joint.score[0] > max(each.score)
    assert joint.information_gain[0] > max(each.information_gain)
    assert len(each.pixels) == 2
    assert joint.pixels[0] == pytest.approx(sum(each.pixels))
    assert each.area_m2 == joint.area_m2 > 0


def test_a_what_if_gains_less_if_a_share_of_the_view_is_expected_to_be_something_else(rig):
    rig.ask_for()
    rig.see()
    (mug,) = rig.objects("mug")
    gains = [
        what_if(rig, mug.id, joint=True, other=share).information_gain[0]
        for share in (None, 0.0, 0.5)
    ]
    assert gains[0] == gains[1] > gains[2]
    for wrong in (-0.1, 1.1, float("nan")):
        with pytest.raises(InvalidInput, match="other_share"):
            what_if(rig, mug.id, other=wrong)


def test_a_what_if_about_an_unknown_object_or_an_invalid_camera_is_refused(rig):
    rig.ask_for()
    rig.see()
    (mug,) = rig.objects("mug")
    for object_id, name in ((99999, "mug"), (mug.id, "cat"), (0, "mug")):
        with pytest.raises(InvalidInput, match="ask for the objects again"):
            what_if(rig, object_id, name)
    with pytest.raises(InvalidInput):
        rig.bus.call(WHAT_IF, pb.WhatIfRequest(object_id=mug.id, class_name="mug"), 30.0)


def test_a_what_if_of_more_pixels_than_a_picture_may_have_is_refused_before_it_is_rendered(rig):
    rig.ask_for()
    rig.see()
    (mug,) = rig.objects("mug")
    camera = pb.Pinhole(fx=3e3, fy=3e3, cx=2e3, cy=2e3, width=4000, height=4000)
    request = pb.WhatIfRequest(
        object_id=mug.id,
        class_name="mug",
        T_world_cam=[transform_to_proto(looking_at(0.4, 0.2, MUG_CENTER))],
        camera=camera,
    )
    with pytest.raises(InvalidInput, match="4000x4000 pixels asked for; at most 2304000 in"):
        rig.bus.call(WHAT_IF, request, 30.0)
    request.camera.CopyFrom(pinhole_to_proto(CAMERA))
    assert rig.bus.call(WHAT_IF, request, 30.0).pixels


def test_the_pixels_of_a_strided_picture_are_those_that_the_stride_keeps():
    camera = pb.Pinhole(fx=1e5, fy=1e5, cx=6e4, cy=5e2, width=131_072, height=1124)
    assert camera_of(camera, 8).height == 1124  # 140 rows of 16,384 pixels
    camera.height = 1125
    with pytest.raises(InvalidInput, match="131072x1125 pixels asked for; at most 147456000 in"):
        camera_of(camera, 8)


def test_a_picture_whose_side_is_too_long_for_the_renderer_is_refused():
    camera = pb.Pinhole(fx=1e5, fy=1e5, cx=2e4, cy=2, width=16_384, height=4)
    assert camera_of(camera).width == 16_384
    camera.width = 16_385
    with pytest.raises(InvalidInput, match="16385x4 pixels asked for; at most 16384 to a side"):
        camera_of(camera)


def test_retire_by_id_or_point_removes_the_object(rig):
    rig.ask_for()
    for by_point in (False, True):
        rig.bus.call(RESET_OBJECTS, pb.Empty(), 30.0)
        rig.see(0.1 if by_point else 0.0)
        (mug,) = rig.objects("mug")
        x, y, z = MUG_CENTER
        request = (
            pb.RetireRequest(point_m=pb.Vector3(x=x, y=y, z=z), radius_m=0.3, reason="picked")
            if by_point
            else pb.RetireRequest(object_id=mug.id, reason="picked")
        )
        reported: list[pb.Retired] = []
        rig.bus.subscribe(RETIRED, reported.append)
        reply = rig.bus.call(RETIRE, request, 30.0)
        assert reply.retired_gaussians >= mug.gaussians
        assert (reply.object_id, reply.class_name) == (mug.id, "mug")
        assert (reported[-1].object_id, reported[-1].class_name) == (mug.id, "mug")
        assert not rig.objects("mug")
        assert rig.objects("table")
        again = rig.bus.call(RETIRE, request, 30.0)
        assert again.retired_gaussians == 0
        assert "no object" in again.reason
    with pytest.raises(InvalidInput):
        rig.bus.call(RETIRE, pb.RetireRequest(), 30.0)


UNNAMED = 10**9 + 123  # the planner's id of a thing that the map does not know


def retire_unnamed(rig: Rig, x: float, y: float, z: float) -> pb.RetireReply:
    point = pb.Vector3(x=x, y=y, z=z)
    request = pb.RetireRequest(object_id=UNNAMED, point_m=point, radius_m=0.15, reason="picked")
    return rig.bus.call(RETIRE, request, 30.0)


def test_retire_with_an_unknown_id_removes_the_object_at_the_point(rig):
    rig.ask_for()
    rig.see()
    (mug,) = rig.objects("mug")
    reply = retire_unnamed(rig, *MUG_CENTER)
    assert (reply.object_id, reply.class_name) == (mug.id, "mug")
    assert not rig.objects("mug")


def test_retire_with_an_unknown_id_and_nothing_at_the_point_only_forgets_past_views():
    rig = Rig(SETTINGS.model_copy(update={"evidence": "hindsight"}))
    rig.ask_for()
    rig.see(called={})
    rig.see(0.2, 0.3)
    known = rig.objects()
    past = rig.service._maps.current._past._views
    assert [view.names for view in past] == [("mug", "table")] * 2
    reply = retire_unnamed(rig, 1.6, 0.5, 0.8)
    assert reply.retired_gaussians == 0
    assert str(UNNAMED) in reply.reason
    assert "no object lies within 0.15 m of the point" in reply.reason
    assert [o.id for o in rig.objects()] == [o.id for o in known]
    assert [view.names for view in past] == [("", "table")] * 2


def test_a_known_id_counts_more_than_the_point(rig):
    rig.ask_for()
    rig.see()
    (mug,) = rig.objects("mug")
    for x in (50.0, float("nan")):
        request = pb.RetireRequest(
            object_id=mug.id, point_m=pb.Vector3(x=x), radius_m=0.15, reason="picked"
        )
        reply = rig.bus.call(RETIRE, request, 30.0)
        assert (reply.object_id, reply.class_name) == (mug.id, "mug")
        rig.see(0.3, 0.4)
        (mug,) = rig.objects("mug")


@pytest.mark.parametrize("x", [float("nan"), 1e30])
def test_retire_with_an_impossible_point_is_refused(rig, x):
    for object_id in (0, UNNAMED):
        request = pb.RetireRequest(object_id=object_id, point_m=pb.Vector3(x=x), radius_m=0.15)
        with pytest.raises(InvalidInput, match="wanted a point within 10000 m"):
            rig.bus.call(RETIRE, request, 30.0)


def test_gaussian_arrays_agree_in_length_and_a_reset_clears_them(rig):
    rig.ask_for()
    rig.see()
    reply = rig.bus.call(GAUSSIANS, pb.GaussiansRequest(), 30.0)
    n = reply.count
    assert n > 1000
    assert len(np.frombuffer(reply.means_m, "<f4")) == 3 * n
    assert len(np.frombuffer(reply.scales_m, "<f4")) == n
    assert len(np.frombuffer(reply.opacities, "<f4")) == n
    assert len(reply.colors) == 3 * n
    assert set(np.frombuffer(reply.instances, "<u4")) == {o.id for o in rig.objects()}
    assert list(reply.class_names) == ["other", "mug", "table"]
    assert len(np.frombuffer(reply.concentration, "<f4")) == 3 * n
    rig.bus.call(RESET_OBJECTS, pb.Empty(), 30.0)
    assert not rig.objects()
    assert rig.bus.call(GAUSSIANS, pb.GaussiansRequest(), 30.0).count == 0
