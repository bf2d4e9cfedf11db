"""Tests that the messages and the page of keys suffice for a robot and a client in any language."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.bare_robot.processes import bare_driver, bare_robot, generate_messages
from tests.e2e.own_robot_up import own_robot_up
from tests.support import wait_until


def test_a_robot_and_a_client_with_only_the_messages_drive_and_map(tmp_path: Path) -> None:
    messages = tmp_path / "messages"
    messages.mkdir()
    generate_messages(messages)
    with own_robot_up(tmp_path, "bus", needed=("map2d",)) as up:
        assert "cannot be reached" in up.services()["bridge"]["reason"]
        with bare_robot(messages, up.router):
            wait_until(lambda: up.are_ready("bridge"), 60, "the bridge has found the robot")
            said = bare_driver(messages, up.router)
    assert said["imports_of_helios"] == []
    assert said["drive"]["succeeded"]
    assert said["drive"]["moved_m"] == pytest.approx(0.5, abs=0.02)
    assert said["x_m"] == pytest.approx(0.5, abs=0.02)
    assert said["turned_rad"] == pytest.approx(0.4, abs=0.02)
    assert said["done_once"]
    assert said["heard"]
    assert said["accepted"]
    assert said["image"] == [80, 60]
    assert said["refused"] == "ERROR_KIND_CONFLICT"
