"""The 2D map in ROS: its topics follow the map, also when a new one begins or it is gone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.map_snapshot import OCCUPIED
from helios_ros2.map_output import MapOutput

from tests.unit.recorder.recorder_maps import snapshot_of

PICK, PLACE = "~/value/pick", "~/value/place"
GRIDS = ["~/map", "~/costmap", f"{PICK}/grid"]
EMPTY = pb.MapSnapshot()
RADIUS_M = 0.05


class RosMessage:
    """Stands for a ROS message: it has any field."""

    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)

    def __getattr__(self, name: str) -> Any:
        made = [] if name == "poses" else RosMessage()
        setattr(self, name, made)
        return made


class Output:
    """The output of a map2d that answers as a test says, and what it has published."""

    def __init__(self) -> None:
        self.reply: pb.MapSnapshot | None = None
        self.sent: list[tuple[str, Any]] = []  # topic, message
        self.output = MapOutput(
            lambda _kind, topic: topic, lambda topic, m: self.sent.append((topic, m)), lambda: 5
        )

    def update(
        self, reply: pb.MapSnapshot | None, radius_m: float = RADIUS_M, frame: str = "map"
    ) -> dict[str, Any]:
        """Messages that follow a reply, by topic."""
        self.reply = reply
        self.sent.clear()
        self.output.update(self._ask, radius_m, frame)
        said = dict(self.sent)
        assert len(said) == len(self.sent), "a topic got more than one message"
        return said

    def _ask(self, request: pb.SnapshotRequest) -> pb.MapSnapshot | None:
        reply = self.reply
        if reply is not None and request.if_newer and request.if_newer == reply.version:
            return pb.MapSnapshot(version=reply.version, map_id=reply.map_id, unchanged=True)
        return reply


@pytest.fixture(autouse=True)
def _messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helios_ros2.ros_messages.interface", lambda _name: RosMessage)


def a_map(version: int = 1, map_id: str = "a", layers: tuple[str, ...] = ("pick",)) -> Any:
    """A map with an obstacle, and with values."""
    occupancy = np.zeros((4, 6), np.int8)
    occupancy[1, 3] = OCCUPIED
    values = {name: np.full((4, 6), 0.5, np.float32) for name in layers}
    out = snapshot_of(occupancy, version=version, values=values)
    out.map_id = map_id
    return out


def size_of(grid: Any) -> tuple[int, int]:
    return grid.info.height, grid.info.width


def test_a_map_is_published_once_with_its_layers() -> None:
    output = Output()
    said = output.update(a_map())
    assert said.keys() == {"~/map", "~/costmap", "~/trajectory", PICK, f"{PICK}/grid"}
    assert [size_of(said[topic]) for topic in GRIDS] == [(4, 6)] * 3
    assert said["~/map"].data[6 + 3] == OCCUPIED
    assert not output.update(a_map())
    assert output.update(a_map(2))


def test_a_reset_empties_every_topic_of_the_map_once() -> None:
    output = Output()
    output.update(a_map())
    said = output.update(EMPTY) or output.update(EMPTY)
    assert said.keys() == {"~/map", "~/costmap", "~/trajectory", PICK, f"{PICK}/grid"}
    for topic in GRIDS:
        assert size_of(said[topic]) == (1, 1)  # Nav2 refuses a grid without cells
        assert said[topic].data.tolist() == [-1]
    assert said["~/map"].info.resolution == pytest.approx(0.05)
    assert not said["~/trajectory"].poses
    for _ in range(3):
        assert not output.update(EMPTY)
    again = output.update(a_map())
    assert size_of(again["~/map"]) == (4, 6)


def test_a_single_reply_without_a_map_empties_no_topic() -> None:
    """A map2d that has just restarted replies so until it has read its file."""
    output = Output()
    for version in (1, 10_000, 20_000):
        assert output.update(a_map(version))
        assert not output.update(EMPTY)
    assert not output.update(a_map(20_000))  # unchanged
    assert not output.update(EMPTY)


def test_without_a_map_or_an_answer_nothing_is_published() -> None:
    output = Output()
    for reply in (EMPTY, EMPTY, EMPTY, None):
        assert not output.update(reply)
    output.update(a_map())
    for _ in range(3):
        assert not output.update(None)


def test_the_topics_of_a_layer_that_the_map_no_longer_has_are_emptied_once() -> None:
    output = Output()
    output.update(a_map(1, layers=("pick", "place")))
    said = output.update(a_map(2))
    assert set(said[f"{PLACE}/grid"].data) == {-1}
    assert size_of(said[f"{PLACE}/grid"]) == (4, 6)
    assert set(said[f"{PICK}/grid"].data) == {50}
    assert PLACE in said
    assert not output.update(a_map(3)).keys() & {PLACE, f"{PLACE}/grid"}
    said = output.update(a_map(4, layers=("place",)))
    assert set(said[f"{PLACE}/grid"].data) == {50}


def test_a_map_of_another_process_with_the_same_version_is_published() -> None:
    output = Output()
    output.update(a_map(12, "a"))
    assert output.update(a_map(12, "b"))["~/map"].data[6 + 3] == OCCUPIED
    assert not output.update(a_map(12, "b"))


@pytest.mark.parametrize("radius_m", [0.1, 0.4])
def test_another_radius_of_the_robot_changes_the_costs_of_the_same_map(radius_m: float) -> None:
    output = Output()
    before = output.update(a_map())["~/costmap"].data
    after = output.update(a_map(), radius_m)["~/costmap"].data
    assert list(after).count(99) > list(before).count(99)
    assert not output.update(a_map(), radius_m)


def test_another_frame_publishes_the_same_map_again() -> None:
    output = Output()
    assert output.update(a_map())
    assert not output.update(a_map())
    assert output.update(a_map(), frame="odom")["~/map"].header.frame_id == "odom"
