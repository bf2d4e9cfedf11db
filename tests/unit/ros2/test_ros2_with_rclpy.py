"""What only real rclpy shows: messages on the wire, a goal that outlives its client, the end."""

from __future__ import annotations

import json
from typing import Any

import pytest
from helios_core.signal_handling import STOP_WITHIN_S

from tests.ros2_processes import fake_robot, free_domain, in_ros, needs_interfaces, needs_ros2

pytestmark = needs_ros2
MESSAGES = {
    "MarkerArray", "OccupancyGrid", "Image", "Path", "PointCloud2", "DiagnosticArray",
    "TransformStamped",
}  # fmt: skip


def check(name: str, domain: int | None = None) -> Any:
    """Answer of a check of `tests.ros2_checks`."""
    done = in_ros(domain or free_domain(), "tests.ros2_checks", name)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_every_message_has_fields_of_the_right_type_and_the_colours_arrive() -> None:
    said = check("messages")
    assert set(said["names"]) >= MESSAGES
    made, read = said["colors"]
    assert len(made) == 17  # one that deletes the others, and two for each object
    assert any(1.0 in color[:3] for color in made[1:])
    for before, after in zip(made, read, strict=True):
        assert after == pytest.approx(before, abs=1e-6)


@pytest.mark.long
@needs_interfaces("nav2_msgs")
def test_a_goal_that_outlives_its_client_has_ended_when_the_next_driver_has_started() -> None:
    domain = free_domain()
    with fake_robot(domain, "--still", "--nav2"):
        said = check("earlier_goal", domain)
    assert said["accepted"]
    assert said["turned_after_the_start"] < 0.01


def test_the_output_ends_in_time_while_a_map_does_not_answer() -> None:
    assert check("end")["seconds"] < STOP_WITHIN_S
