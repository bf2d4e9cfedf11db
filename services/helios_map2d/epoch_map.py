"""2D map of one world epoch: fusion of frames and observations, and publication of versions."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Iterable, Mapping, Sequence

from helios_core.errors import Conflict, InvalidInput
from helios_core.geometry import yaw_of
from helios_core.types import Frame, FrameId, Observation, SearchContext

from helios_map2d.camera_view import View, check_depth, check_pose
from helios_map2d.frame_order import REMEMBERED_FRAMES, FrameOrder
from helios_map2d.grid import EMPTY, Box, Tile
from helios_map2d.layer_stack import LayerStack
from helios_map2d.layers.grid_growth import check_plausible_move
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.value_layers import Cone
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.snapshots.snapshot import MapSnapshot
from helios_map2d.snapshots.tile_publisher import PublishedTiles
from helios_map2d.snapshots.tiles import GroundTile, ValueTile
from helios_map2d.snapshots.trajectory import Trajectory
from helios_map2d.view_memory.detected_names import sighted
from helios_map2d.view_memory.stored_views import (
    SeenView,
    ViewMemory,
    moved_view,
    small_picture,
)


class EpochMap:
    """2D map layers of one world epoch, on a grid centred on the first pose.

    Not thread-safe: the owner calls it under one lock. `published` is an immutable version that
    other threads may read without the lock.
    """

    def __init__(
        self,
        rules: MapRules,
        centre_m: tuple[float, float],
        footprint_radius_m: float,
        first_version: int = 0,
    ) -> None:
        self.rules = rules
        self.map_id = uuid.uuid4().hex
        self.stack = LayerStack(rules, centre_m, footprint_radius_m)
        self.memory = ViewMemory(rules.most_views)
        self.order = FrameOrder()
        self.context_id = ""
        self._prompts: frozenset[str] | None = None  # of the search; None: a map from a file
        self.frame_id: FrameId | None = None
        self.stamp_ns = 0
        self.robot_pose: tuple[float, float, float] | None = None  # from the newest frame
        self._reported_pose: tuple[float, float, float] | None = None  # used without a frame
        self.trajectory = Trajectory(rules.trajectory_step_m)
        self.version = first_version + 1
        self.tiles = PublishedTiles()
        self._observations_seen: deque[tuple[str, FrameId]] = deque(maxlen=REMEMBERED_FRAMES)
        self.published = self.publish()

    def integrate_frame(self, frame: Frame, *, holding: bool = False) -> bool:
        """Fuse a posed depth image into occupancy, explored area and frontiers.

        Returns False, and changes nothing, if the map already contains this frame. A keyframe may
        arrive late; a stream frame older than the newest frame raises Conflict, because its content
        is out of date. Raises InvalidInput, and changes nothing, for a pose that is not rigid,
        sizes that disagree, or a place to which the map cannot grow. Pixels that are NaN, infinite,
        zero or negative count as not measured. `holding`: True if the robot holds an object.
        """
        if self.order.has(frame.id.seq):
            return False
        view, (x_m, y_m, yaw_rad) = self._prepared(frame)
        newest = self.order.record(frame.id.seq)
        if not frame.keyframe and not newest:
            raise Conflict(
                f"stream frame {frame.id.seq} is older than frame {self.order.newest}, which is in "
                "the map: send frames in order, or as keyframes"
            )
        changed = self.stack.fuse(view, (x_m, y_m), holding=holding)
        self.order.take(frame.id.seq)
        if newest:
            self.frame_id, self.stamp_ns = frame.id, frame.stamp_ns
            self.robot_pose = (x_m, y_m, yaw_rad)
            self.trajectory.follow(x_m, y_m)
        self.version += 1
        for place, shown, heights in changed:
            self.tiles.retile(
                place,
                self.stack.occupancy,
                self.stack.search,
                self.version,
                shown=shown,
                heights=heights,
            )
        self.published = self.publish()
        return True

    def integrate_values(self, observation: Observation) -> bool:
        """Fuse an observation's layer scores into the value layers of the current search.

        Also stores the view, if it has an image embedding or a located detection. Returns False if
        the map already contains this observation. Raises Conflict if it belongs to another search
        context, and InvalidInput as `integrate_frame` does, for a score that is not finite, or for
        a layer that the search does not have.
        """
        self.check_search(observation)
        self._check_layers(observation)
        frame = observation.frame
        key = (observation.context_id, frame.id)
        if key in self._observations_seen:
            return False
        view, _ = self._prepared(frame)
        cone = self.stack.cone(view)
        changed = self.stack.values.integrate(cone, observation.layer_scores)
        self.version += 1
        self._publish_values(observation.layer_scores, changed)
        named = tuple(sighted(observation, self.rules.min_depth_m, self.rules.max_depth_m))
        if self.rules.most_views > 0 and (observation.image_embedding is not None or named):
            self.memory.add(SeenView(frame.id, frame.stamp_ns, cone, observation.image_embedding,
                                     small_picture(frame.color), named))  # fmt: skip
        self._observations_seen.append(key)
        self.published = self.publish(ground_changed=False)
        return True

    def _check_layers(self, observation: Observation) -> None:
        """Raise InvalidInput for a layer that is none of the search: each takes a whole grid."""
        if self._prompts is None:
            return
        known = self.stack.values.layers.keys() | self._prompts
        if others := sorted(set(observation.layer_scores) - known):
            raise InvalidInput(
                f"the observation has scores of {len(others)} layers that this search does not "
                f"have, such as {others[0][:40]!r}; send those of the context's prompts"
            )

    def set_layer(self, name: str, scored: Sequence[tuple[Cone, float]]) -> None:
        """Rebuild a value layer from views and their scores, in the given order.

        Raises InvalidInput, and changes nothing, if the map cannot grow to the extent of a view.
        """
        values = self.stack.values
        for cone, _ in scored:
            self.stack.make_room(cone.box(self.rules.cell_m))
        values.layers.pop(name, None)
        self.stack.frontiers.forget_values()
        changed = EMPTY
        for cone, score in scored:
            changed = changed.union(values.integrate(cone, {name: score}))
        values.touch(name)
        self.version += 1
        self.tiles.empty_layer(name)
        self._publish_values([name], changed)
        self.published = self.publish(ground_changed=False)

    def reset_search(self, context: SearchContext) -> bool:
        """Begin a search: clear the explored area and all values, but keep the occupancy.

        Returns False if this context is already the current one.
        """
        self._prompts = frozenset(context.prompts)
        if context.id == self.context_id:
            return False
        self.context_id = context.id
        stack = self.stack
        searched = stack.search.box
        stack.search.reset()
        stack.frontiers.reset()
        stack.values.reset(tuple(context.prompts))
        self.version += 1
        self.tiles.reset_layers(context.prompts)
        self.tiles.retile_known(searched, stack.occupancy, stack.search, self.version)
        self.published = self.publish()
        return True

    def publish_above(self, version: int) -> None:
        """Publish again, with a version above `version`."""
        self.version = max(self.version, version) + 1
        self.published = self.publish()

    def adopt_frame_order(
        self, other: EpochMap | None, reported_pose: tuple[float, float, float] | None
    ) -> None:
        """Continue the frame order and robot pose of another map; without one, reset both.

        reported_pose: pose that the robot reports (x, y in m, yaw in rad), if known.
        """
        self.frame_id, self.stamp_ns, self.robot_pose = None, 0, None
        self._reported_pose = reported_pose
        self.trajectory.part()
        self.order = FrameOrder()
        if other is not None:
            self.frame_id, self.stamp_ns = other.frame_id, other.stamp_ns
            self.robot_pose, self.order = other.robot_pose, other.order

    def restore(
        self,
        tiles: Mapping[Tile, GroundTile],
        layers: Mapping[str, Mapping[Tile, ValueTile]],
    ) -> None:
        """Fill an empty map with tiles of ground and values."""
        self.stack.restore(tiles, layers)
        self.tiles.take(tiles, layers)

    def add_stored(self, stored: EpochMap, T_here_there: Transform2) -> None:
        """Add another map whose place in this frame is known: its cells where this map knows
        nothing, and its past views. Raises InvalidInput, and changes nothing, if the map would be
        too large."""
        changed = self.stack.fill_unknown(stored.stack, T_here_there)
        self.version += 1
        for place, shown, heights in changed:
            self.tiles.retile(
                place,
                self.stack.occupancy,
                self.stack.search,
                self.version,
                shown=shown,
                heights=heights,
            )
        for view in stored.memory.snapshot():
            self.memory.add(moved_view(view, T_here_there))
        self.published = self.publish()

    def publish(self, *, ground_changed: bool = True) -> MapSnapshot:
        """Present version of the map. ground_changed: False if only value layers have changed."""
        robot_m = self._robot_m()
        return MapSnapshot(
            map_id=self.map_id,
            version=self.version,
            frame_id=self.frame_id,
            stamp_ns=self.stamp_ns,
            context_id=self.context_id,
            grid=self.stack.known_grid(robot_m),
            ground=self.tiles.ground,
            layers=self.tiles.layers,
            frontiers=self.stack.find_frontiers(robot_m, ground_changed=ground_changed),
            robot_pose=self.robot_pose or self._reported_pose,
            trajectory_m=self.trajectory.points_m,
            next_frontier_id=self.stack.frontiers.next_id,
            trajectory_starts=self.trajectory.starts,
        )

    def check(self, frame: Frame) -> None:
        """Raise InvalidInput for a frame that cannot be fused."""
        self._prepared(frame)

    def check_search(self, observation: Observation) -> None:
        """Raise Conflict for an observation of another search than the current one."""
        if observation.context_id != self.context_id:
            raise Conflict(
                f"the observation belongs to search context {observation.context_id!r}, the map is "
                f"at {self.context_id!r}: observe again under the present context"
            )

    def _prepared(self, frame: Frame) -> tuple[View, tuple[float, float, float]]:
        """Check a frame and grow the grid for it.

        Returns its view and the robot's x, y (m), yaw (rad).
        """
        T_world_base = check_pose(frame.T_world_base, "T_world_base")
        depth_m = check_depth(frame.depth_m, frame.camera)
        x_m, y_m = T_world_base[:2, 3].tolist()
        reach = self.stack.reach_of(frame)
        camera_x, camera_y = reach.T_world_cam[:2, 3].tolist()
        last_m = None if self.robot_pose is None else self.robot_pose[:2]
        check_plausible_move((x_m, y_m), (camera_x, camera_y), last_m, self.rules.most_leap_m)
        self.stack.make_room_for(reach, (x_m, y_m))
        view = self.stack.view_of(depth_m, frame.camera, reach)
        return view, (x_m, y_m, float(yaw_of(T_world_base)))

    def _publish_values(self, names: Iterable[str], changed: Box) -> None:
        """Renew the tiles of some layers within a box of world cells."""
        self.stack.values_changed(changed)
        self.tiles.retile_values(names, self.stack.values, changed, self.version)

    def _robot_m(self) -> tuple[float, float]:
        """Position of the robot (world x, y); the middle of the map if it is not known."""
        pose = self.robot_pose or self._reported_pose
        if pose is not None:
            return pose[:2]
        grid = self.stack.grid
        return grid.centre_of(grid.rows // 2, grid.columns // 2)
