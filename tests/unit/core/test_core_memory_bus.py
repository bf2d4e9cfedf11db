"""Rules of the in-memory bus beyond those of every bus (`tests/contract/test_bus.py`)."""

from __future__ import annotations

import threading

import pytest
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, FRAME, GET_TASK, KEYFRAME


class Watched(list):
    """A list that records for each removal whether its thread held the lock."""

    def __init__(self, lock: Lock) -> None:
        super().__init__()
        self._lock, self.held = lock, []

    def remove(self, value: object) -> None:
        self.held.append(self._lock.holder == threading.get_ident())
        super().remove(value)


class Lock:
    """A lock that records which thread holds it."""

    def __init__(self) -> None:
        self._lock, self.holder = threading.RLock(), 0

    def __enter__(self) -> None:
        self._lock.acquire()
        self.holder = threading.get_ident()

    def __exit__(self, *_: object) -> None:
        self.holder = 0
        self._lock.release()


def test_subscribers_and_watchers_are_removed_under_the_lock() -> None:
    """Otherwise a removal could make another thread skip a subscriber."""
    lock = Lock()
    subscribers, watchers = Watched(lock), Watched(lock)
    hub = MemoryHub(lock=lock, subscribers=subscribers, watchers=watchers)  # pyright: ignore
    bus = MemoryBus(hub)
    bus.subscribe(CONTEXT, lambda _: None).close()
    bus.watch(lambda *_: None).close()
    assert (subscribers.held, watchers.held) == ([True], [True])
    assert (subscribers, watchers) == ([], [])


def test_messages_reach_subscribers_in_the_order_of_subscription() -> None:
    bus, heard = MemoryBus(MemoryHub()), []
    first, *_ = [bus.subscribe(CONTEXT, lambda _, i=i: heard.append(i)) for i in range(4)]
    bus.publish(CONTEXT, pb.SearchContext())
    first.close()
    bus.subscribe(CONTEXT, lambda _: heard.append(4)).close()
    heard.clear()
    bus.publish(CONTEXT, pb.SearchContext())
    assert heard == [1, 2, 3]


def test_closing_a_replaced_server_does_not_remove_its_successor() -> None:
    bus = MemoryBus(MemoryHub())
    old = bus.serve(GET_TASK, lambda _: pb.Task(id="old"))
    bus.serve(GET_TASK, lambda _: pb.Task(id="new"))
    old.close()
    assert bus.call(GET_TASK, pb.TaskRequest(), 5).id == "new"


def test_messages_of_uncopied_topics_reach_subscribers_as_they_are() -> None:
    bus, heard = MemoryBus(MemoryHub(uncopied=frozenset({KEYFRAME}))), []
    for topic in (KEYFRAME, FRAME):
        for _ in range(2):
            bus.subscribe(topic, heard.append)
    sent = pb.Frame(id=pb.FrameId(seq=3))
    bus.publish(KEYFRAME, sent)
    assert [message is sent for message in heard] == [True, True]
    heard.clear()
    bus.publish(FRAME, sent)
    assert heard == [sent, sent]
    assert not any(message is sent for message in heard)


def test_a_liveliness_handler_that_raises_harms_neither_the_service_nor_other_watchers(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bus, seen = MemoryBus(MemoryHub()), []

    def broken(service: str, instance: str, alive: bool) -> None:
        raise ZeroDivisionError(f"{service} is {alive}")

    bus.watch(broken)
    bus.watch(lambda *entry: seen.append(entry))
    planner = bus.announce("planner", "1")
    bus.watch(broken)
    planner.close()
    assert seen == [("planner", "1", True), ("planner", "1", False)]
    assert caplog.text.count("the liveliness handler failed") == 4
    assert "planner is False" in caplog.text
