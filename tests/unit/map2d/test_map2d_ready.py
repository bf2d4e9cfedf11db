"""The 2D map service is ready only when it can receive; one that cannot start says why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import helios_map2d.__main__ as main
import pytest
from helios_core.bus import Registration
from helios_core.codec import description_to_proto
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, ROBOT_DESCRIPTION, Topic
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings
from map2d_rig import ROBOT

from tests.support import wait_until


def test_the_service_is_ready_only_after_it_has_subscribed() -> None:
    """A replay sends its first keyframe, and only once, as soon as all services are ready."""
    health = Health()
    heard: dict[str, str] = {}

    class Watched(MemoryBus):
        def subscribe(self, topic: Topic[Any], handler: Callable[[Any], None]) -> Registration:
            heard[topic.name] = health.state[0]
            return super().subscribe(topic, handler)

        def subscribe_in_place(
            self, topic: Topic[Any], handler: Callable[[Any], None]
        ) -> Registration:
            heard[topic.name] = health.state[0]
            return super().subscribe_in_place(topic, handler)

    Map2DService(Watched(MemoryHub()), Settings.load([]), health)
    assert health.state[0] == "ready"
    for topic in (CONTEXT, ROBOT_DESCRIPTION, KEYFRAME, OBSERVATION):
        assert heard[topic.name] == "starting", topic.name


def test_a_refused_robot_description_is_reported_after_a_restart_too() -> None:
    hub, health = MemoryHub(), Health()
    bridge = MemoryBus(hub)
    bridge.publish(ROBOT_DESCRIPTION, description_to_proto(replace(ROBOT, max_depth_m=0.0)))
    Map2DService(MemoryBus(hub), Settings.load([]), health)
    assert health.state[0] == "degraded"
    assert "max_depth_m 0" in health.state[1]
    bridge.publish(ROBOT_DESCRIPTION, description_to_proto(ROBOT))
    assert health.state[0] == "ready"


def test_a_service_that_cannot_start_ends_its_process_and_reports_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Broken(MemoryBus):
        def subscribe(self, topic: Topic[Any], handler: Callable[[Any], None]) -> Registration:
            raise RuntimeError("the bus is gone")

    ended: list[int] = []
    monkeypatch.setattr(main.os, "_exit", ended.append)
    monkeypatch.setattr(main, "warm_up", lambda: None)
    health = Health()
    hosted = main.MapHost(Broken(MemoryHub()), health, Settings.load([]))
    wait_until(lambda: ended == [1], 60, "the process is told to end")
    assert health.state[0] == "degraded"
    assert "could not be started (RuntimeError: the bus is gone)" in health.state[1]
    hosted.close()


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--band-lo-m", "2.0"], "give a band_hi_m above band_lo_m"),
        (["--band-lo-m", "0.05"], "band_lo_m"),
        (["--min-depth-m", "6"], "give a max_depth_m above min_depth_m"),
        (["--most-cells", "1000"], "give a most_cells of at least size_cells"),
        (["--keep-period-s", "inf"], "keep_period_s"),
    ],
)
def test_settings_under_which_nothing_is_mapped_or_saved_are_refused(
    flags: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        Settings.load(flags)
    assert said in capsys.readouterr().err


def test_the_remedy_for_a_leap_is_a_setting() -> None:
    settings = Settings.load(["--most-leap-m", "80"])
    assert settings.rules(5.0, 0.3).most_leap_m == 80
