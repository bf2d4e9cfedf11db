"""Output of the 2D map to ROS: occupancy, costs, trajectory, and a picture and a grid per layer.

Once the map is gone, as after a reset, each topic gets a message without content. Nav2 refuses a
grid without cells, so that grid has one unknown cell.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.map_snapshot import MapView, decode_snapshot
from helios_core.viewing.newest_map import blank_map, is_empty, newest_snapshot

from helios_ros2 import map_arrays, ros_messages

GRID, PATH, IMAGE = "nav_msgs/msg/OccupancyGrid", "nav_msgs/msg/Path", "sensor_msgs/msg/Image"
HASH_DIGITS = 8  # of a layer's topic whose name is not the layer's
EMPTY_REPLIES = 2  # in a row; a restarted map2d has no map until it has read its file


class MapOutput:
    """Publishers of the newest 2D map: see the module. Not thread-safe."""

    def __init__(
        self,
        publisher: Callable[[str, str], Any],
        send: Callable[[Any, Any], None],
        now_ns: Callable[[], int],
    ) -> None:
        """publisher: of a type and a topic. send: passes a publisher a message."""
        self._publisher, self._send, self._now_ns = publisher, send, now_ns
        self._map = publisher(GRID, "~/map")
        self._costmap = publisher(GRID, "~/costmap")
        self._trajectory = publisher(PATH, "~/trajectory")
        self._values: dict[str, tuple[Any, Any]] = {}  # layer -> publishers of picture and grid
        self._layers: frozenset[str] = frozenset()  # published with content
        self._version, self._map_id = 0, ""
        self._published_with = 0.0, ""  # radius and frame of the published maps
        self._blank: MapView | None = None  # takes the place of the published map once it is gone
        self._empty_replies = 0

    def update(
        self,
        ask: Callable[[pb.SnapshotRequest], pb.MapSnapshot | None],
        radius_m: float,
        frame: str,
    ) -> None:
        """Publish the map if it is another than the published one.

        ask: calls map2d; None: no answer. radius_m: of the robot, for the costs. Raises
        InvalidInput for a map with impossible content.
        """
        if self._published_with != (radius_m, frame):
            self._version, self._published_with = 0, (radius_m, frame)
        snapshot = newest_snapshot(ask, self._version, self._map_id)
        if snapshot is None:
            return
        if snapshot.unchanged or not is_empty(snapshot):
            self._empty_replies = 0
        if snapshot.unchanged:
            return
        if is_empty(snapshot):
            self._empty_replies += 1
            if self._empty_replies < EMPTY_REPLIES:
                return
            if self._blank is not None:
                self._publish(self._blank, frame)
            self._blank = None
        else:
            view = decode_snapshot(snapshot)
            self._publish(view, frame)
            self._blank = blank_map(view)
        self._version, self._map_id = snapshot.version, snapshot.map_id

    def _publish(self, view: MapView, frame: str) -> None:
        ns = self._now_ns()
        self._send(self._map, ros_messages.grid(view, view.occupancy, ns, frame))
        costs = map_arrays.costs(view, self._published_with[0])
        self._send(self._costmap, ros_messages.grid(view, costs, ns, frame))
        trail = ((float(x), float(y)) for x, y in view.trajectory_m)
        self._send(self._trajectory, ros_messages.path(trail, ns, frame))
        for name, value in view.values.items():
            self._publish_value(view, name, value, ns, frame)
        for name in sorted(self._layers - view.values.keys()):
            self._publish_value(view, name, np.zeros(view.shape, np.float32), ns, frame)
        self._layers = frozenset(view.values)

    def _publish_value(self, view: MapView, name: str, value: Any, ns: int, frame: str) -> None:
        if name not in self._values:
            topic = f"~/value/{topic_name(name)}"
            self._values[name] = (
                self._publisher(IMAGE, topic),
                self._publisher(GRID, f"{topic}/grid"),
            )
        picture, grid = self._values[name]
        rgb = map_arrays.value_picture(view, value, name)
        self._send(picture, ros_messages.picture(rgb, ns, frame))
        cells = map_arrays.value_cells(value)
        self._send(grid, ros_messages.grid(view, cells, ns, frame))


def topic_name(text: str) -> str:
    """Part of a ROS topic's name for any text; a text that is no such name gets a hash at its end,
    since others may have the same letters and digits."""
    out = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") or "layer"
    out = out if out[0].isalpha() else f"_{out}"
    if out == text:
        return out
    return f"{out}_{hashlib.sha256(text.encode(errors='surrogatepass')).hexdigest()[:HASH_DIGITS]}"
