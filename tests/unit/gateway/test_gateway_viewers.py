"""Many viewers: each version is encoded once, and a viewer that does not read delays no other."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from helios_gateway.api_map_models import MapChange
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.cached_responses import Encoded
from helios_gateway.event_hub import EventHub, as_sse

from tests.gateway_backend import Backend

VIEWERS = 200


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """The number of encodings by media type."""
    counts: Counter[str] = Counter()
    made: Callable[..., Encoded] = Encoded.of

    def counted(content: bytes, media_type: str, **about: str) -> Encoded:
        counts[media_type] += 1
        return made(content, media_type, **about)

    monkeypatch.setattr(Encoded, "of", counted)
    return counts


def test_each_version_of_each_response_is_encoded_once(
    live: RobotMonitor, backend: Backend, encoded: Counter[str]
) -> None:
    def look(_: int) -> set[str]:
        maps = live.maps
        views = [
            live.camera.jpeg(raw=False),
            maps.cells("pick"),
            maps.picture("occupancy", 900),
            maps.npz(None),
            maps.info_json(),
            maps.frontiers_json(),
            maps.objects_json(None, None),
        ]
        return {view.tag for view in views}

    once = {"image/jpeg": 1, "image/png": 2, "application/octet-stream": 1, "application/json": 3}
    for version in (1, 2):
        backend.publish_observation(backend.publish_frame())
        backend.change_map()
        backend.change_objects()
        with ThreadPoolExecutor(16) as viewers:
            tags = list(viewers.map(look, range(VIEWERS)))
        assert all(seen == tags[0] for seen in tags)
        assert encoded == {kind: version * count for kind, count in once.items()}
        assert backend.calls.count("snapshot") == version


def test_an_event_is_encoded_once_and_a_viewer_that_does_not_read_delays_no_other() -> None:
    hub = EventHub(backlog=10, max_viewers=VIEWERS + 1, keepalive_s=60)

    async def run() -> None:
        streams = [as_sse(hub.watch()) for _ in range(VIEWERS)]
        deaf = as_sse(hub.watch())
        for stream in (*streams, deaf):
            await anext(stream)
        for number in range(50):
            hub.publish("map", MapChange(map2d=number, objects=0))
            seen = [await anext(stream) for stream in streams]
            assert all(data is seen[0] for data in seen)  # the same object, not an equal copy
        assert len([data async for data in deaf]) <= 21  # cut off at twice the backlog
        assert hub.viewers == VIEWERS

    asyncio.run(run())
