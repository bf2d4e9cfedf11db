"""The stream of events: numbered, resumable, bounded, closed with the gateway."""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections.abc import AsyncGenerator

import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.topics import TASK
from helios_gateway.api_map_models import MapChange
from helios_gateway.api_models import HealthAnswer, RobotPose
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.event_hub import KEEPALIVE, EventHub, as_sse

from tests.gateway_backend import Backend


def parsed(raw: bytes) -> tuple[str, str, dict]:
    """(id, type, data) of one event as sent."""
    fields = dict(line.split(": ", 1) for line in raw.decode().strip().split("\n"))
    return fields["id"], fields["event"], json.loads(fields["data"])


async def take(stream: AsyncGenerator[bytes], count: int) -> list[tuple[str, str, dict]]:
    return [parsed(await anext(stream)) for _ in range(count)]


async def open_stream(hub: EventHub, last_id: str | None = None) -> AsyncGenerator[bytes]:
    stream = as_sse(hub.watch(last_id))
    assert await anext(stream) == b"retry: 1000\n\n"
    return stream


def change(n: int) -> MapChange:
    return MapChange(map2d=n, objects=0)


def test_a_resumed_stream_sends_missed_events_exactly_once() -> None:
    hub = EventHub(backlog=100, max_viewers=5, keepalive_s=5)

    async def run() -> None:
        stream = await open_stream(hub)
        for n in range(3):
            hub.publish("map", change(n))
        seen = await take(stream, 2)
        again = await open_stream(hub, seen[-1][0])
        hub.publish("map", change(3))
        assert [data["map2d"] for _, _, data in await take(again, 2)] == [2, 3]

    asyncio.run(run())


def test_a_new_stream_begins_with_the_newest_event_of_each_state() -> None:
    hub = EventHub(backlog=100, max_viewers=9, keepalive_s=5)
    for n in range(4):
        hub.publish("map", change(n), "map")
    hub.publish("alive", HealthAnswer())
    hub.publish("map", change(9), "other map")

    async def run() -> None:
        for last_id in (None, "", "nonsense", "gone-1", "-", "x-99999999999999999999999"):
            stream = await open_stream(hub, last_id)
            assert [data["map2d"] for _, _, data in await take(stream, 2)] == [3, 9]

    asyncio.run(run())


def test_an_expired_event_id_gets_the_current_states() -> None:
    hub = EventHub(backlog=2, max_viewers=5, keepalive_s=5)
    hub.publish("map", change(0), "map")

    async def run() -> None:
        [(first, _, _)] = await take(await open_stream(hub), 1)
        for n in range(1, 6):
            hub.publish("map", change(n), "map")
        [(_, _, data)] = await take(await open_stream(hub, first), 1)
        assert data["map2d"] == 5

    asyncio.run(run())


def test_events_from_many_threads_arrive_in_the_order_of_their_numbers() -> None:
    hub = EventHub(backlog=1000, max_viewers=5, keepalive_s=5)

    async def run() -> None:
        stream = await open_stream(hub)
        threads = [
            threading.Thread(target=lambda: [hub.publish("map", change(n)) for n in range(50)])
            for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        numbers = [int(id.rpartition("-")[2]) for id, _, _ in await take(stream, 200)]
        assert numbers == sorted(set(numbers))
        for thread in threads:
            thread.join()

    asyncio.run(run())


def test_the_stream_of_a_viewer_that_does_not_read_is_ended() -> None:
    hub = EventHub(backlog=5, max_viewers=5, keepalive_s=5)

    async def run() -> None:
        stream = await open_stream(hub)
        for n in range(100):
            hub.publish("map", change(n))
        await asyncio.sleep(0)
        assert len([raw async for raw in stream]) <= 11
        assert hub.viewers == 0

    asyncio.run(run())


def test_a_silent_stream_sends_keepalives_and_the_number_of_viewers_is_limited() -> None:
    hub = EventHub(backlog=5, max_viewers=1, keepalive_s=0.01)

    async def run() -> None:
        stream = as_sse(hub.watch(None))
        await anext(stream)
        assert await anext(stream) == KEEPALIVE
        with pytest.raises(Unavailable, match="max-viewers"):
            hub.watch(None)
        await stream.aclose()
        assert hub.viewers == 0

    asyncio.run(run())


def test_streams_that_have_not_begun_count_and_free_their_places_when_they_end() -> None:
    hub = EventHub(backlog=5, max_viewers=2, keepalive_s=5)

    async def run() -> None:
        waiting = [hub.watch(None), hub.watch(None)]
        with pytest.raises(Unavailable, match="2 event streams are open"):
            hub.watch(None)
        await waiting.pop().aclose()  # its viewer has left before the first event
        stream = await open_stream(hub)
        with pytest.raises(Unavailable):
            hub.watch(None)
        waiting.clear()  # nobody has closed it
        other = await open_stream(hub)
        with pytest.raises(Unavailable):
            hub.watch(None)
        for begun in (stream, other):
            await begun.aclose()
        waiting = [hub.watch(None), hub.watch(None)]
        assert hub.viewers == 0

    asyncio.run(run())


def test_closing_ends_open_streams_and_refuses_new_ones() -> None:
    hub = EventHub(backlog=5, max_viewers=5, keepalive_s=60)

    async def run() -> None:
        stream = await open_stream(hub)
        hub.close()
        assert [raw async for raw in stream] == []
        with pytest.raises(Unavailable):
            hub.watch(None)

    asyncio.run(run())


def test_non_finite_numbers_become_null() -> None:
    hub = EventHub(backlog=5, max_viewers=5, keepalive_s=5)
    hub.publish("robot", RobotPose(x_m=math.nan, y_m=math.inf, yaw_rad=1.0), "robot")

    async def run() -> None:
        [(_, _, data)] = await take(await open_stream(hub), 1)
        assert data == {"x_m": None, "y_m": None, "yaw_rad": 1.0}

    asyncio.run(run())


def types_since(live: RobotMonitor, past: int) -> list[str]:
    return [event.type for event in live.events._past][past:]


def test_tasks_decisions_and_plans_are_reported_at_once(
    live: RobotMonitor, backend: Backend
) -> None:
    live.tick()
    past = len(live.events._past)
    backend.bus.publish(TASK, pb.Task(id="t1", state="running", kind="move", phase="pick"))
    backend.decide()
    backend.publish_plan()
    assert types_since(live, past) == ["task", "decision", "plan"]


def test_the_pose_is_reported_once_per_tick_and_a_stop_at_once(
    live: RobotMonitor, backend: Backend
) -> None:
    live.tick()
    past = len(live.events._past)
    for step in range(20):
        backend.pose = (1.0 + step / 10, 2.0, 0.0)
        backend.publish_robot()
    assert types_since(live, past) == []
    live.tick()
    live.tick()
    assert types_since(live, past) == ["robot"]
    backend.stopped = True
    backend.publish_robot()
    assert types_since(live, past) == ["robot", "robot", "ready", "fault"]


def test_a_change_of_a_service_state_is_reported_once(live: RobotMonitor, backend: Backend) -> None:
    live.tick()
    past = len(live.events._past)
    backend.report("detector", 4102, "waiting", "waits for a model")
    live.tick()
    live.tick()
    assert types_since(live, past) == ["service", "ready"]
