"""What the bridge's health tells from its states, faults and set-up."""

from __future__ import annotations

from typing import Any

import pytest
from helios_bridge.bridge_health import BridgeHealth
from helios_core.health import Health


def test_a_bridge_that_starts_is_not_told_as_ready() -> None:
    health = Health()
    bridge = BridgeHealth(health)
    bridge.setup("the camera is upside down")
    assert health.state == ("starting", "starting")
    bridge.driver_fails("describe", "no robot answers")
    assert health.state == ("degraded", "no robot answers")
    bridge.driver_works("describe")
    assert health.state == ("waiting", "starting")
    bridge.ready("waits for frames")
    assert health.state == ("ready", "waits for frames; the camera is upside down")


def test_a_bridge_that_ends_stays_so() -> None:
    health = Health()
    health.stopping()
    bridge = BridgeHealth(health)
    bridge.setup("")
    bridge.waiting("for a frame")
    assert health.state[0] == "stopping"


def test_an_unknown_state_is_refused() -> None:
    health, state = Health(), "asleep"
    unknown: Any = state
    with pytest.raises(ValueError, match="cannot be 'asleep'; say one of starting, waiting, ready"):
        BridgeHealth(health).no_image(unknown, "it is night")
    assert health.state[0] == "starting"
