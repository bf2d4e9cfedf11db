"""The keyframe after each action: of another world, missing, or lost by a map."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import cast
from unittest.mock import create_autospec

import pytest
from helios_core import proto as pb
from helios_core.codec import description_to_proto
from helios_core.errors import Conflict
from helios_core.heartbeat import HeartbeatSender
from helios_core.keyframe_acks import KeyframeAcks, MapPart
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, ActionResult, Observe, Show, Turn
from helios_core.topics import ACT, MAP2D_ACK, OBJECTMAP_ACK, PLANNER_HEARTBEAT, SNAPSHOT
from helios_planner.robot import client
from helios_planner.robot.client import RobotClient, TaskListener
from helios_planner.robot.rpc import RobotConnection
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks import run_control
from helios_planner.tasks.run_control import Journal, last_action
from helios_planner.tasks.store import Entry, Store
from planner_flat import flat
from planner_peers import Peers

IMPATIENT = Settings(ack_timeout_s=0.1, away_s=0.1)


@pytest.fixture(autouse=True)
def short_ack_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "ACK_PATIENCE_S", 0.05)
    monkeypatch.setattr(client, "RETRY_S", 0.01)


class Scene:
    """A task's client of a fake robot; all peers answer before a call returns."""

    def __init__(self, parts: tuple[str, ...] = tuple(MapPart)) -> None:
        hub, acks = MemoryHub(), KeyframeAcks()
        self.peers, self.bus = Peers(hub, flat()), MemoryBus(hub)
        self.bus.subscribe(MAP2D_ACK, acks.add)
        self.bus.subscribe(OBJECTMAP_ACK, acks.add)
        self.listener = create_autospec(TaskListener, instance=True)
        line = RobotConnection(self.bus, IMPATIENT, threading.Event(), self.listener.on_wait)
        self.robot = RobotClient(
            self.bus, line, IMPATIENT, description_to_proto(self.peers.world.description), acks,
            "task", "", 100, self.listener, parts,
        )  # fmt: skip
        self.robot.begin()

    def done(self) -> list[type]:
        return [type(action) for action in self.peers.world.log]


@pytest.mark.parametrize(("what", "new"), [("boot", "another"), ("world_epoch", 2)])
def test_poses_of_another_world_end_the_task(what: str, new: object) -> None:
    scene = Scene()
    scene.robot.act(Turn(0.3))
    setattr(scene.peers, what, new)
    with pytest.raises(TaskFailed, match="restarted or its localisation jumped") as failure:
        scene.robot.act(Turn(0.3))
    assert failure.value.cause is Cause.SYSTEM_ERROR


@pytest.mark.parametrize(("what", "new"), [("boot", "another"), ("world_epoch", 2)])
def test_a_task_of_another_world_is_not_resumed(what: str, new: object) -> None:
    peers = Peers(hub := MemoryHub(), flat())
    setattr(peers, what, new)
    line = RobotConnection(MemoryBus(hub), IMPATIENT, threading.Event(), lambda _: None)
    journal = Journal(create_autospec(Store, instance=True), "task", Entry(epoch=("boot", 1)))
    with pytest.raises(TaskFailed, match="jumped while the planner was away"):
        last_action(line, IMPATIENT, journal)


def test_a_robot_that_sends_no_keyframe_fails_the_task() -> None:
    scene = Scene()
    scene.peers.bus.serve(ACT, lambda request: pb.ActionResult(action_id=request.action_id))
    with pytest.raises(TaskFailed, match="sent no image after turn") as failure:
        scene.robot.act(Turn(0.3))
    assert failure.value.cause is Cause.SYSTEM_ERROR


@pytest.mark.parametrize("part", MapPart)
def test_a_keyframe_that_a_map_lost_is_taken_again_without_repeating_the_action(
    part: str,
) -> None:
    scene = Scene()
    scene.peers.silent.add(part)
    scene.listener.on_wait.side_effect = lambda _: scene.peers.silent.clear()  # the map is back
    result = scene.robot.act(Turn(0.3))
    assert result.turned_rad == pytest.approx(0.3)
    assert scene.done()[-2:] == [Turn, Observe]
    assert scene.done().count(Turn) == 1
    reported = [cast("str | None", call.args[0]) for call in scene.listener.on_wait.call_args_list]
    assert "to answer keyframe" in (reported[0] or "")
    assert reported[-1] is None


@pytest.mark.parametrize("part", MapPart)
def test_a_keyframe_that_a_map_refused_is_taken_again_without_repeating_the_action(
    part: str,
) -> None:
    scene = Scene()
    scene.peers.refusing[part] = "the observation answers another search: observe again"
    scene.listener.on_wait.side_effect = lambda _: scene.peers.refusing.clear()
    result = scene.robot.act(Turn(0.3))
    assert result.turned_rad == pytest.approx(0.3)
    assert scene.done()[-2:] == [Turn, Observe]
    reported = [cast("str | None", call.args[0]) for call in scene.listener.on_wait.call_args_list]
    assert "observe again" in (reported[0] or "")
    assert reported[-1] is None


def test_a_keyframe_that_a_map_took_up_for_another_search_is_taken_again() -> None:
    scene = Scene()
    scene.peers.context = pb.SearchContext(id="another")
    scene.listener.on_wait.side_effect = lambda _: setattr(
        scene.peers, "context", pb.SearchContext()
    )
    scene.robot.act(Turn(0.3))
    assert scene.done()[-2:] == [Turn, Observe]


def test_a_map_that_refuses_every_keyframe_ends_the_task_with_its_reason() -> None:
    scene = Scene()
    scene.peers.refusing["objects"] = "a fault in the object map: KeyError: 'mug'"
    with pytest.raises(TaskFailed, match=r"did not take up.*KeyError: 'mug'") as failure:
        scene.robot.act(Turn(0.3))
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert scene.done()[-client.MOST_REFUSALS :] == [Turn, *[Observe] * (client.MOST_REFUSALS - 1)]


def test_a_refusal_by_a_map_that_the_task_does_not_need_is_ignored() -> None:
    scene = Scene(parts=(MapPart.OCCUPANCY,))
    scene.peers.refusing["objects"] = "the frame is damaged"
    scene.robot.act(Turn(0.3))
    assert scene.done()[-1] is Turn


def test_a_late_refusal_of_an_earlier_keyframe_is_ignored() -> None:
    scene = Scene()
    scene.robot.act(Turn(0.3))
    earlier = pb.FrameId(robot_boot_id="boot", world_epoch=1, seq=scene.peers.seq)
    scene.peers.bus.publish(OBJECTMAP_ACK, pb.Ack(part="objects", id=earlier, reason="too late"))
    scene.robot.act(Turn(0.3))
    assert scene.done()[-2:] == [Turn, Turn]


def test_the_result_of_an_action_is_known_before_its_lost_keyframe_is_taken_again() -> None:
    scene = Scene()
    scene.peers.silent.add("value")
    scene.listener.on_wait.side_effect = lambda _: scene.peers.silent.clear()
    before: list[tuple[type, int]] = []
    scene.robot.on_result = lambda action, _: before.append((type(action), len(scene.done())))
    already = len(scene.done())
    scene.robot.act(Turn(0.3))
    assert before == [(Turn, already + 1), (Observe, already + 2)]


def test_a_new_keyframe_after_a_stop_does_not_hide_that_the_action_was_cut_short(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = Scene()
    scene.peers.silent.add("value")
    act = scene.peers.world.act

    def stopped(action: Action) -> ActionResult:
        if isinstance(action, Turn):
            scene.peers.stopped = True
            return ActionResult(False, "a person")
        return act(action)

    monkeypatch.setattr(scene.peers.world, "act", stopped)
    scene.listener.on_paused.side_effect = lambda _: setattr(scene.peers, "stopped", False)
    scene.listener.on_wait.side_effect = lambda _: scene.peers.silent.clear()
    assert not scene.robot.act(Turn(0.3)).succeeded
    assert scene.done()[-1] is Observe
    assert scene.robot.cut_short


@pytest.mark.parametrize(("away_m", "fails"), [(5000.0, True), (-5000.0, True), (20.0, False)])
def test_a_pose_far_off_the_map_ends_the_task_before_the_map_is_enlarged(
    away_m: float, fails: bool
) -> None:
    scene = Scene()
    scene.robot.act(Turn(0.3))
    pose = scene.peers.world.pose()
    scene.peers.world._pose = replace(pose, x_m=pose.x_m + away_m, y_m=pose.y_m + away_m)
    scene.robot._state = None  # the pose jumps after the keyframe
    if not fails:
        scene.robot.ground()
        return
    with pytest.raises(TaskFailed, match=r"localisation is \d{4} m off the map") as failure:
        scene.robot.ground()
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert "see what its pose comes from" in failure.value.message


@pytest.mark.parametrize("beating", [True, False])
def test_a_resumed_action_promises_heartbeats_only_if_they_are_sent(beating: bool) -> None:
    """The bridge, which had not begun it, would halt it after a silence."""
    peers = Peers(hub := MemoryHub(), flat())
    bus = MemoryBus(hub)
    line = RobotConnection(bus, IMPATIENT, threading.Event(), lambda _: None)
    promised, heard = list[bool](), threading.Event()
    bus.subscribe(PLANNER_HEARTBEAT, lambda beat: heard.set() if beat.action_id == "t-1" else None)

    def act(request: pb.ActionRequest) -> pb.ActionResult:
        promised.append(request.beats)
        assert not beating or heard.wait(10), "the bridge halts it"
        return pb.ActionResult(action_id=request.action_id, succeeded=True)

    peers.bus.serve(ACT, act)
    turn = pb.Action(turn=pb.Action.Turn(angle_rad=0.3))
    entry = Entry(request=pb.ActionRequest(action_id="t-1", action=turn, beats=True))
    journal = Journal(create_autospec(Store, instance=True), "task", entry)
    heart = HeartbeatSender(bus, PLANNER_HEARTBEAT) if beating else None
    patient = Settings(ack_timeout_s=0.1, away_s=0.1, action_timeout_s=20)
    assert last_action(line, patient, journal, heart=heart).succeeded
    assert promised == [beating]


def test_a_pause_does_not_count_towards_the_time_limit_of_the_last_action(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The task is paused while it is being resumed, until its lease has run out."""
    peers, clock = Peers(hub := MemoryHub(), flat()), [0.0]
    monkeypatch.setattr(run_control.time, "monotonic", lambda: clock[0])
    late = Settings(away_s=20.0)
    line = RobotConnection(MemoryBus(hub), late, threading.Event(), lambda _: None)
    asked: list[pb.ActionRequest] = []

    def act(request: pb.ActionRequest) -> pb.ActionResult:
        asked.append(request)
        if len(asked) == 1:
            clock[0] += 1000.0
            raise Conflict("the lease ran out after 10 s; ask for a new one")
        return pb.ActionResult(action_id=request.action_id, succeeded=True)

    peers.bus.serve(ACT, act)
    turn = pb.ActionRequest(action_id="t-1", action=pb.Action(turn=pb.Action.Turn(angle_rad=0.3)))
    entry = Entry(request=turn)
    journal = Journal(create_autospec(Store, instance=True), "task", entry)
    assert last_action(line, late, journal, held_s=lambda: clock[0]).succeeded
    asked.clear()
    with pytest.raises(TaskFailed, match="ran out"):
        last_action(line, late, journal)


@pytest.mark.parametrize(
    ("until", "done"), [(Observe, [Observe]), (Turn, [Observe, Turn]), (None, [Observe, Turn])]
)
def test_a_lost_map_begins_anew_with_an_image_or_with_the_next_move(
    until: type[Action] | None, done: list[type]
) -> None:
    """While the robot shows what it holds, the maps leave its images out until it moves."""
    scene = Scene()
    scene.robot.act(Show(0.0))

    def snapshot(request: pb.SnapshotRequest) -> pb.MapSnapshot:
        again = until is not None and scene.done()[-1] is until
        return scene.peers._snapshot(request) if again else pb.MapSnapshot()

    scene.peers.bus.serve(SNAPSHOT, snapshot)
    before = len(scene.done())
    if until is None:
        with pytest.raises(TaskFailed, match="map2d has no map") as failure:
            scene.robot.ground()
        assert failure.value.cause is Cause.SYSTEM_ERROR
    else:
        assert scene.robot.ground().top_m.size
    assert scene.done()[before:] == done
