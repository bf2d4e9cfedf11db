"""A keyframe that a service lost because it was away is taken again as soon as it is back."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from helios_core import proto as pb
from helios_core.keyframe_acks import KeyframeAcks, MapPart
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Observe, Turn
from helios_core.topics import status_topic
from helios_core.types import FrameId
from helios_planner.robot import client
from helios_planner.robot.service_returns import ServiceReturns
from test_planner_keyframes import Scene

from tests.support import wait_until

FRAME = FrameId("boot", 1, 1)


def status(service: str, instance: str, state: str = "ready") -> pb.ServiceStatus:
    return pb.ServiceStatus(service=service, instance=instance, state=state)


class Returns:
    """Returns of the services, as a planner on a bus sees them."""

    def __init__(self) -> None:
        hub = MemoryHub()
        self.services, self.now_s = MemoryBus(hub), 100.0
        self.seen = ServiceReturns(MemoryBus(hub), lambda: self.now_s)

    def say(self, service: str, instance: str, state: str = "ready") -> None:
        self.services.publish(status_topic(service), status(service, instance, state))


def test_a_new_process_returns_when_it_is_ready_not_when_it_starts() -> None:
    returns = Returns()
    returns.say("detector", "one")
    assert not returns.seen.since(99)  # the first one has lost nothing
    returns.say("detector", "two", "starting")
    assert not returns.seen.since(99)
    returns.say("detector", "two")
    assert returns.seen.since(99)
    assert not returns.seen.since(100)
    returns.now_s = 200.0
    returns.say("detector", "two")  # its status, again
    assert not returns.seen.since(100)


def test_a_service_whose_connection_was_lost_returns_with_its_token() -> None:
    returns = Returns()
    token = returns.services.announce("map2d", "one")
    returns.services.announce("gateway", "one")
    wait_until(lambda: "one" in returns.seen._known, 60, "it is alive")
    assert not returns.seen.since(99)
    token.close()
    returns.services.announce("map2d", "one")
    wait_until(lambda: returns.seen.since(99), 60, "it is back")


def test_the_wait_for_a_lost_keyframe_ends_long_before_its_time() -> None:
    missing: list[str] = []

    def wait() -> None:
        acks = KeyframeAcks()
        missing.extend(acks.wait(FRAME, ["objects"], 3600.0, threading.Event(), lambda: True))

    threading.Thread(target=wait, daemon=True).start()
    wait_until(lambda: missing, 60, "the wait has ended")
    assert missing == ["objects"]


def test_an_answer_on_its_way_still_counts() -> None:
    acks = KeyframeAcks()
    ack = pb.Ack(part="objects", accepted=True)
    ack.id.robot_boot_id, ack.id.world_epoch, ack.id.seq = "boot", 1, 1

    def lost() -> bool:
        acks.add(ack)
        return True

    assert acks.wait(FRAME, ["objects"], 60.0, None, lost) == []


def test_a_task_looks_again_when_the_map_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    worker = ThreadPoolExecutor(1)  # all actions of a task come from one thread
    scene = worker.submit(Scene).result()
    monkeypatch.setattr(client, "ACK_PATIENCE_S", 120.0)  # the test would end before it
    scene.peers.bus.publish(status_topic("objectmap"), status("objectmap", "one"))
    scene.peers.silent = {MapPart.OBJECTS}
    keyframes = scene.listener.on_keyframe.call_count
    acting = worker.submit(scene.robot.act, Turn(0.3))
    wait_until(
        lambda: scene.listener.on_keyframe.call_count > keyframes, 60, "the keyframe is there"
    )
    scene.peers.silent = set()
    scene.peers.bus.publish(status_topic("objectmap"), status("objectmap", "two"))
    acting.result(30)
    assert scene.done()[-2:] == [Turn, Observe]
    worker.submit(scene.robot.end).result(10)
    worker.shutdown()
