"""Tasks whose peers are away, silent or not started: they wait, report for which, and give up."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import NoReturn

from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import SNAPSHOT, TASK, VOCABULARY
from helios_planner.service import PlannerService
from helios_planner.settings import Settings
from planner_bus import Start, ended, submit, task

from tests.support import wait_until


def test_stop_now_pauses_a_task_and_clearing_the_stop_resumes_the_task(start: Start) -> None:
    _, bus, peers = start()
    peers.stopped = True
    id = submit(bus, "go to the counter").id
    wait_until(lambda: task(bus, id).state == "paused", 60, "it pauses")
    assert "a person" in task(bus, id).message
    assert peers.world.steps == 0
    peers.stopped = False
    assert ended(bus, id).state == "succeeded"


def test_a_robot_that_begins_a_new_world_in_mid_task_is_a_system_error(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    id = submit(bus).id
    wait_until(peers.acting.is_set, 60, "it acts")
    peers.gate.set()
    wait_until(lambda: peers.world.steps > 3, 60, "it acts on")
    peers.boot = "another boot"
    done = ended(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "localisation jumped" in done.message


def test_a_map_that_stays_silent_fails_the_task_and_is_named(start: Start) -> None:
    _, bus, peers = start()
    peers.silent.add("objects")
    reported: list[str] = []
    bus.subscribe(TASK, lambda task: reported.append(task.message))
    done = ended(bus, submit(bus).id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "objectmap" in done.message
    assert any(m.startswith("waits for objectmap") for m in reported)


def test_a_task_reports_what_it_waits_for_and_then_its_former_message(start: Start) -> None:
    _, bus, peers = start()
    away = [2]

    def snapshot(request: pb.SnapshotRequest) -> pb.MapSnapshot:
        if peers.world.steps > 5 and away[0]:
            away[0] -= 1
            raise Unavailable("it starts again")
        return peers._snapshot(request)

    peers.bus.serve(SNAPSHOT, snapshot)
    reported: list[str] = []
    bus.subscribe(TASK, lambda task: reported.append(task.message))
    assert ended(bus, submit(bus, "go to the counter").id).state == "succeeded"
    k = reported.index("waits for the map2d: it starts again")
    assert reported.count(reported[k]) == 1
    assert reported[k + 1] == reported[k - 1]


def test_a_queued_task_reports_that_no_robot_is_described_yet(tmp_path: Path) -> None:
    hub = MemoryHub()
    service = PlannerService(MemoryBus(hub), Settings(state_dir=tmp_path), Health())
    reported = submit(MemoryBus(hub)).message
    service.close()
    assert reported == "waits for its turn; the bridge has not described the robot yet"


def test_a_task_reports_that_it_waits_for_a_detector_without_a_model(start: Start) -> None:
    _, bus, peers = start()

    def away(_: pb.Empty) -> NoReturn:
        raise Unavailable("the model file nano.onnx does not exist; give another")

    reported: list[str] = []
    bus.subscribe(TASK, lambda task: reported.append(task.message))
    peers.bus.serve(VOCABULARY, away)
    failed = ended(bus, submit(bus).id)
    why = "the model file nano.onnx does not exist; give another"
    assert reported.count(f"waits for the detector: {why}") == 1
    assert "nano.onnx" in failed.message


def test_a_detector_that_stays_silent_is_named_by_an_agent_that_trusts_it(start: Start) -> None:
    _, bus, peers = start()
    peers.silent.add("detections")
    done = ended(bus, submit(bus, agent="trusting").id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "detector" in done.message


def test_a_map2d_that_was_started_again_without_a_map_is_given_a_keyframe(start: Start) -> None:
    _, bus, peers = start()
    peers.blank_maps = 1
    assert ended(bus, submit(bus, "go to the counter").id).state == "succeeded"
    assert peers.blank_maps == 0


def test_a_map2d_that_never_has_a_map_is_named(start: Start) -> None:
    _, bus, peers = start()
    peers.blank_maps = 1000
    done = ended(bus, submit(bus, "go to the counter").id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "map2d has no map" in done.message


def test_a_new_map_with_the_version_of_the_former_one_is_taken_up(start: Start) -> None:
    """Versions begin anew when map2d starts again without its state folder."""
    _, bus, peers = start()
    requests: list[int] = []

    def snapshot(request: pb.SnapshotRequest) -> pb.MapSnapshot:
        requests.append(request.if_newer)
        map_id = "former" if len(requests) == 1 else "new"
        if request.if_newer == 7:
            return pb.MapSnapshot(version=7, map_id=map_id, unchanged=True)
        reply = peers._snapshot(request)
        reply.version, reply.map_id = 7, map_id
        return reply

    peers.bus.serve(SNAPSHOT, snapshot)
    assert ended(bus, submit(bus, "go to the counter").id).state == "succeeded"
    assert requests[:3] == [0, 7, 0]
    assert set(requests[3:]) == {7}
