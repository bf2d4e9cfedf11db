"""Who sees the maps ready may send; maps that cannot start say so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import helios_map2d.__main__ as main
import pytest
from helios_core.bus import Registration
from helios_core.codec import description_to_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, ROBOT_DESCRIPTION, Topic
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings
from map2d_rig import ROBOT

from tests.support import wait_until


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


def test_a_description_that_is_refused_is_said_after_a_restart_too() -> None:
    hub, health = MemoryHub(), Health()
    bridge = MemoryBus(hub)
    bridge.publish(ROBOT_DESCRIPTION, description_to_proto(replace(ROBOT, max_depth_m=0.0)))
    Map2DService(MemoryBus(hub), Settings.load([]), health)
    assert health.state[0] == "degraded"
    assert "max_depth_m 0" in health.state[1]
    bridge.publish(ROBOT_DESCRIPTION, description_to_proto(ROBOT))
    assert health.state[0] == "ready"


def test_maps_that_cannot_be_started_say_why(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(MemoryBus):
        def subscribe(self, topic: Topic[Any], handler: Callable[[Any], None]) -> Registration:
            raise RuntimeError("the bus is gone")

    monkeypatch.setattr(main, "warm_up", lambda: None)
    health = Health()
    hosted = main.MapHost(Broken(MemoryHub()), health, Settings.load([]))
    wait_until(lambda: health.state[0] == "degraded", 10, "the trouble is told of")
    assert "could not be started (RuntimeError: the bus is gone)" in health.state[1]
    hosted.close()


def test_settings_that_no_map_can_have_are_refused_before_any_robot_comes() -> None:
    settings = Settings.load(["--band-lo-m", "2.0"])
    with pytest.raises(InvalidInput, match="raise its top"):
        main.MapHost(MemoryBus(MemoryHub()), Health(), settings)
