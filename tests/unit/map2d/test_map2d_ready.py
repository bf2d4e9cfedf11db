"""Who sees the maps ready may send."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from helios_core.bus import Registration
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, ROBOT_DESCRIPTION, Topic
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings


def test_the_maps_are_ready_only_when_they_listen() -> None:
    """A replay sends its first keyframe, once and never again, as soon as all say ready."""
    health = Health()
    heard: dict[str, str] = {}

    class Watched(MemoryBus):
        def subscribe(self, topic: Topic[Any], handler: Callable[[Any], None]) -> Registration:
            heard[topic.name] = health.state[0]
            return super().subscribe(topic, handler)

    Map2DService(Watched(MemoryHub()), Settings.load([]), health)
    assert health.state[0] == "ready"
    for topic in (CONTEXT, ROBOT_DESCRIPTION, KEYFRAME, OBSERVATION):
        assert heard[topic.name] == "starting", topic.name
