"""An action whose sender is silent ends; one whose sender beats, or never promised to, does not."""

from __future__ import annotations

import threading

from helios_core import proto as pb
from helios_core.heartbeat import HALTED, HeartbeatMonitor, HeartbeatSender
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import PLANNER_HEARTBEAT

from tests.support import wait_until


class Watch:
    """A monitor whose clock the test moves."""

    def __init__(self, silence_s: float = 0.7) -> None:
        hub = MemoryHub()
        self.sender, self.now_s, self.halts = MemoryBus(hub), 100.0, list[str]()
        self.monitor = HeartbeatMonitor(
            MemoryBus(hub), PLANNER_HEARTBEAT, silence_s, self.halts.append, lambda: self.now_s
        )

    def beat(self, action_id: str) -> None:
        self.sender.publish(PLANNER_HEARTBEAT, pb.Heartbeat(action_id=action_id))


def test_silence_ends_the_action() -> None:
    watch = Watch()
    with watch.monitor.watching("a", beats=True):
        watch.now_s += 0.8
        wait_until(lambda: watch.halts, 60, "it is halted")
    assert HALTED in watch.halts[0]


def test_heartbeats_of_this_action_keep_it_running_and_those_of_another_do_not() -> None:
    watch = Watch()
    seen = threading.Event()
    with watch.monitor.watching("a", beats=True):
        for _ in range(5):
            watch.now_s += 0.6
            watch.beat("a")
            seen.wait(0.1)  # some checks of the watch
        assert watch.halts == []
        watch.now_s += 0.6
        watch.beat("b")
        watch.now_s += 0.2
        wait_until(lambda: watch.halts, 60, "it is halted")


def test_a_sender_that_promised_no_heartbeats_is_never_halted() -> None:
    for beats, watch in ((False, Watch()), (True, Watch(0.0))):
        with watch.monitor.watching("a", beats=beats):
            watch.now_s += 100
            threading.Event().wait(0.1)
        assert watch.halts == []


def test_the_watch_ends_with_its_action() -> None:
    watch = Watch()
    with watch.monitor.watching("a", beats=True):
        pass
    watch.now_s += 100
    threading.Event().wait(0.1)
    assert watch.halts == []


def test_a_heart_beats_until_the_action_has_ended() -> None:
    hub, heard = MemoryHub(), list[str]()
    MemoryBus(hub).subscribe(PLANNER_HEARTBEAT, lambda beat: heard.append(beat.action_id))
    with HeartbeatSender(MemoryBus(hub), PLANNER_HEARTBEAT).beating("a"):
        wait_until(lambda: len(heard) >= 3, 60, "it beats")
    assert set(heard) == {"a"}
