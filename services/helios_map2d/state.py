"""The map of one world epoch: folds frames and observations in, publishes immutable versions."""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from helios_core.errors import Conflict
from helios_core.geometry import yaw_of
from helios_core.types import Frame, FrameId, Observation, SearchContext
from numpy.typing import NDArray

from helios_map2d import change_kernels, fuse_kernels
from helios_map2d.explored import SearchArea
from helios_map2d.exploring import ByDepth, Exploring
from helios_map2d.frontiers import Frontier, FrontierFinder, FrontierRules
from helios_map2d.grid import EMPTY, TILE, Box, GridSpec, Tile
from helios_map2d.ground import OpenGround
from helios_map2d.memory import SeenView, ViewMemory, small_picture
from helios_map2d.occupancy import UNKNOWN, OccupancyLayer, OccupancyRules
from helios_map2d.order import REMEMBERED_FRAMES, FrameOrder
from helios_map2d.published_tiles import PublishedTiles
from helios_map2d.reveal import ByCone
from helios_map2d.room import grown_for, refuse_a_leap
from helios_map2d.sighted import sighted
from helios_map2d.snapshot import MapSnapshot
from helios_map2d.tiles import GroundTile, ValueTile
from helios_map2d.trajectory import Trajectory
from helios_map2d.value import Cone, ValueLayers, ValueRules
from helios_map2d.view import check_depth, check_pose, reach_of, view_of


@dataclass(frozen=True)
class MapRules:
    """Every rule of the maps. Depth outside (min, max) is no evidence; lengths in metres.

    A map begins with `size_cells` a side and grows up to `most_cells`; a frame more than
    `most_leap_m` from the last one is not believed. While something is held,
    nothing within `held_reach_m` of the robot's body becomes an obstacle.
    """

    cell_m: float = 0.025
    size_cells: int = 2000
    most_cells: int = 16000
    min_depth_m: float = 0.10
    max_depth_m: float = 5.0
    most_leap_m: float = 50.0
    held_reach_m: float = 0.30
    occupancy: OccupancyRules = field(default_factory=OccupancyRules)
    values: ValueRules = field(default_factory=ValueRules)
    frontiers: FrontierRules = field(default_factory=FrontierRules)
    trajectory_step_m: float = 0.05
    most_views: int = 512
    explored_by_cone: bool = False  # VLFM's explored area, see `reveal`


class MapState:
    """The 2D maps of one world epoch, centred on the first pose that it is given.

    Not thread-safe: its owner calls it under one lock. `published` is an immutable version that
    anyone may read without the lock.
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
        self.footprint_radius_m = footprint_radius_m
        self.grid = GridSpec.centred_on(*centre_m, rules.cell_m, rules.size_cells)
        self.occupancy = OccupancyLayer(self.grid, rules.occupancy)
        self.search = SearchArea(self.grid)
        self.values = ValueLayers(self.grid, rules.values)
        self.ground = OpenGround(self.grid, rules.frontiers.robot_radius_m / rules.cell_m)
        self.frontiers = FrontierFinder(self.grid, rules.frontiers)
        self.memory = ViewMemory(rules.most_views)
        self.order = FrameOrder()
        self.context_id = ""
        self.frame_id: FrameId | None = None
        self.stamp_ns = 0
        self.robot_pose: tuple[float, float, float] | None = None
        self.trajectory = Trajectory(rules.trajectory_step_m)
        self.known = EMPTY  # world cells that hold all that is known
        self.version = first_version + 1
        self.tiles = PublishedTiles()
        self._exploring: Exploring = (
            ByCone(rules.frontiers.robot_radius_m, rules.cell_m)
            if rules.explored_by_cone
            else ByDepth()
        )
        self._found: tuple[Frontier, ...] = ()
        self._observations_seen: deque[tuple[str, int]] = deque(maxlen=REMEMBERED_FRAMES)
        self.published = self.publish()

    def integrate_frame(self, frame: Frame, *, holding: bool = False) -> bool:
        """Fold a posed depth image into occupancy, explored area and frontiers.

        Returns False when this very frame is in the map already (nothing changes). A keyframe may
        come late; a stream frame older than the newest is refused with Conflict, since what it saw
        is out of date. Raises InvalidInput, and changes nothing, for a pose that is not rigid,
        sizes that disagree, or a place to which the map cannot grow. Pixels that are NaN, infinite,
        zero or negative count as not measured. `holding`: the robot has something in its hand.
        """
        if self.order.has(frame.id.seq):
            return False
        x_m, y_m, yaw_rad = self._prepared(frame)
        newest = self.order.is_newest(frame.id.seq)
        if not frame.keyframe and not newest:
            raise Conflict(
                f"stream frame {frame.id.seq} is older than frame {self.order.newest}, which is in "
                "the map: send frames in order, or as keyframes"
            )
        rules = self.rules
        view = view_of(frame.depth_m, frame.camera, frame.T_world_cam, self.grid,
                       rules.min_depth_m, rules.max_depth_m)  # fmt: skip
        row, column = self.grid.cell_of(x_m, y_m)
        near_m = self._near_m
        around = Box(row, row + 1, column, column + 1).grown(int(near_m / rules.cell_m) + 2)
        box = self.grid.to_local(self.grid.to_world(view.window.union(around)).tiled)
        at = box.slices
        before, searched = self.occupancy.occupancy[at].copy(), self.search.explored[at].copy()
        body_m = self.footprint_radius_m
        if body_m > 0 and holding:
            body_m += rules.held_reach_m
        came_of_it = np.zeros((box.rows, box.columns), np.uint8)
        seen = self.occupancy.integrate(view, (x_m, y_m), body_m)
        came_of_it[view.window.moved(-box.row_lo, -box.column_lo).slices] = seen
        self._exploring.mark(view, self.occupancy, came_of_it, box)
        self.search.add(came_of_it, box)
        if self.footprint_radius_m > 0:
            disc = self.occupancy.clear_disc(x_m, y_m, self.footprint_radius_m)
            came_of_it[disc.moved(-box.row_lo, -box.column_lo).slices] |= np.uint8(
                fuse_kernels.MEMORY
            )
            self.search.add_near_robot(
                self.occupancy.occupancy, x_m, y_m, rules.frontiers.blind_radius_m
            )
        self.ground.update(self.occupancy.occupancy, before, box)
        self._exploring.tidy(self.occupancy, self.search, (row, column), box)
        self.order.take(frame.id.seq)
        if newest:
            self.frame_id, self.stamp_ns = frame.id, frame.stamp_ns
            self.robot_pose = (x_m, y_m, yaw_rad)
            self.trajectory.follow(x_m, y_m)
        self._settle(box, before, searched, came_of_it)
        self.published = self.publish()
        return True

    def integrate_values(self, observation: Observation) -> bool:
        """Fold an observation's layer scores into the value layers of the present search, and
        keep its view where the scorer embeds images, or the detector names something.

        Returns False when this observation is in the map already. Raises Conflict when it belongs
        to another search context, InvalidInput as `integrate_frame` does or for a score that is
        not finite.
        """
        if observation.context_id != self.context_id:
            raise Conflict(
                f"the observation belongs to search context {observation.context_id!r}, the map is "
                f"at {self.context_id!r}: observe again under the present context"
            )
        frame = observation.frame
        key = (observation.context_id, frame.id.seq)
        if key in self._observations_seen:
            return False
        self._prepared(frame)
        rules = self.rules
        view = view_of(frame.depth_m, frame.camera, frame.T_world_cam, self.grid,
                       rules.min_depth_m, rules.max_depth_m)  # fmt: skip
        cone = self._exploring.cone(view)
        changed = self.values.integrate(cone, observation.layer_scores)
        self.version += 1
        self._publish_values(observation.layer_scores, changed)
        named = tuple(sighted(observation, rules.min_depth_m, rules.max_depth_m))
        if rules.most_views > 0 and (observation.image_embedding is not None or named):
            self.memory.add(SeenView(frame.id, frame.stamp_ns, cone, observation.image_embedding,
                                     small_picture(frame.color), named))  # fmt: skip
        self._observations_seen.append(key)
        self.published = self.publish(ground_changed=False)
        return True

    def set_layer(self, name: str, scored: Iterable[tuple[Cone, float]]) -> None:
        """Make a value layer anew of views and their scores, in the order given."""
        self.values.layers.pop(name, None)
        self.frontiers.forget_values()
        changed = EMPTY
        for cone, score in scored:
            self._make_room(cone.box(self.rules.cell_m))
            changed = changed.union(self.values.integrate(cone, {name: score}))
        self.values.touch(name)
        self.version += 1
        self.tiles.empty_layer(name)
        self._publish_values([name], changed)
        self.published = self.publish(ground_changed=False)

    def reset_search(self, context: SearchContext) -> bool:
        """Begin a search: forget what was searched and every value; keep the occupancy.

        Returns False when this context is the present one already.
        """
        if context.id == self.context_id:
            return False
        self.context_id = context.id
        searched = self.search.box
        self.search.reset()
        self.frontiers.reset()
        self.values.reset(tuple(context.prompts))
        self.version += 1
        self.tiles.reset_layers(context.prompts)
        self.tiles.retile_known(searched, self.occupancy, self.search, self.version)
        self.published = self.publish()
        return True

    def go_on_from(self, version: int) -> None:
        """Publish again with a version above this one."""
        self.version = max(self.version, version) + 1
        self.published = self.publish()

    def continue_as(self, other: MapState | None) -> None:
        """Belong to the epoch and the place of another map, or of none yet: frames go on there."""
        self.frame_id, self.stamp_ns, self.robot_pose = None, 0, None
        self.order = FrameOrder()
        if other is not None:
            self.frame_id, self.stamp_ns = other.frame_id, other.stamp_ns
            self.robot_pose, self.order = other.robot_pose, other.order

    def snapshot(self) -> MapSnapshot:
        """The newest published version."""
        return self.published

    def restore(
        self,
        tiles: Mapping[Tile, GroundTile],
        layers: Mapping[str, Mapping[Tile, ValueTile]],
    ) -> None:
        """Take tiles of ground and values for what is known, in place of nothing."""
        for place in {*tiles, *(place for values in layers.values() for place in values)}:
            self._make_room(Box.of_tile(place))
        layer, everything = self.occupancy, EMPTY
        for place, tile in tiles.items():
            box = self.grid.to_local(Box.of_tile(place))
            at = box.slices
            layer.occupancy[at], layer.evidence[at] = tile.occupancy, tile.evidence
            layer.floor_seen[at] = tile.floor_seen
            layer.z_low_m[at], layer.z_high_m[at] = tile.z_low_m, tile.z_high_m
            self.search.add(tile.searched, box)
            everything = everything.union(box)
        self.tiles.take(tiles, layers)
        if not everything.empty:
            nothing = np.full((everything.rows, everything.columns), UNKNOWN, np.int8)
            self.ground.update(layer.occupancy, nothing, everything)
            self.frontiers.update(layer.occupancy, self.search.explored, tiles)
            self._note_known(everything)
        for name, values in layers.items():
            self.values.restore(name, values.values())
        self.frontiers.forget_values()
        self.known = self.known.union(self.values.box)

    def publish(self, *, ground_changed: bool = True) -> MapSnapshot:
        """The present version. ground_changed: whether anything but the value layers has."""
        values = {name: layer.value for name, layer in self.values.layers.items()}
        self._found = (
            self.frontiers.find(self.occupancy.occupancy, self.ground, self._robot_xy(), values)
            if ground_changed
            else self.frontiers.revalued(values)
        )
        known = self.known
        if known.empty:
            row, column = self.grid.cell_of(*self._robot_xy())
            known = self.grid.to_world(Box(row, row + 1, column, column + 1))
        return MapSnapshot(
            map_id=self.map_id,
            version=self.version,
            frame_id=self.frame_id,
            stamp_ns=self.stamp_ns,
            context_id=self.context_id,
            grid=GridSpec.over(known, self.grid.cell_m),
            ground=self.tiles.ground,
            layers=self.tiles.layers,
            frontiers=self._found,
            robot_pose=self.robot_pose,
            trajectory_m=self.trajectory.points_m,
            next_frontier_id=self.frontiers.next_id,
        )

    def _prepared(self, frame: Frame) -> tuple[float, float, float]:
        """Check a frame and make room for it; the robot's x, y (m) and yaw (rad)."""
        T_world_base = check_pose(frame.T_world_base, "T_world_base")
        check_depth(frame.depth_m, frame.camera)
        cell_m = self.rules.cell_m
        x_m, y_m = float(T_world_base[0, 3]), float(T_world_base[1, 3])
        camera_x, camera_y = (float(v) for v in check_pose(frame.T_world_cam, "T_world_cam")[:2, 3])
        last_m = None if self.robot_pose is None else self.robot_pose[:2]
        refuse_a_leap((x_m, y_m), (camera_x, camera_y), last_m, self.rules.most_leap_m)
        reach = reach_of(frame.camera, frame.T_world_cam, cell_m, self.rules.max_depth_m)
        near_m = self._near_m
        row, column = int(y_m // cell_m), int(x_m // cell_m)
        around = Box(row, row + 1, column, column + 1).grown(int(near_m / cell_m) + 2)
        self._make_room(reach.union(around))
        return x_m, y_m, float(yaw_of(T_world_base))

    @property
    def _near_m(self) -> float:
        """How far from the robot a frame may change what it does not see."""
        near_m = max(self.footprint_radius_m, self.rules.frontiers.blind_radius_m)
        return max(near_m, self._exploring.reach_m(self.rules.max_depth_m))

    def _make_room(self, needed: Box) -> None:
        """Grow the grid where it does not hold a box of world cells with a margin.

        Raises InvalidInput when it would be larger than the rules allow.
        """
        margin = max(TILE, self.ground.reach + 2)
        grid = grown_for(self.grid, needed, margin, self.rules.most_cells)
        if grid is self.grid:
            return
        self.occupancy.grow(grid, self.known)
        self.ground.grow(grid, self.known)
        self.search.grow(grid)
        self.values.grow(grid)
        self.frontiers.grow(grid)
        self.grid = grid

    def _settle(
        self,
        box: Box,
        before: NDArray[np.int8],
        searched: NDArray[np.uint8],
        came_of_it: NDArray[np.uint8],
    ) -> None:
        """Follow up on a change within `box`, of whole tiles on the grid."""
        at = box.slices
        rows, columns = box.rows // TILE, box.columns // TILE
        shown, kept = np.zeros((2, rows, columns), np.uint8)
        border = np.zeros((rows + 2, columns + 2), np.uint8)
        change_kernels.note_changes(
            before, self.occupancy.occupancy[at], searched, self.search.explored[at], came_of_it,
            shown, kept, border, TILE,
        )  # fmt: skip
        world = self.grid.to_world(box)
        row, column = world.row_lo // TILE, world.column_lo // TILE
        edges = [(int(r) + row - 1, int(c) + column - 1) for r, c in np.argwhere(border)]
        self.frontiers.update(self.occupancy.occupancy, self.search.explored, edges)
        self.version += 1
        for r, c in np.argwhere(kept):
            place = (int(r) + row, int(c) + column)
            self.tiles.retile(place, self.occupancy, self.search, self.version,
                              shown=bool(shown[r, c]))  # fmt: skip
        self._note_known(box)

    def _note_known(self, box: Box) -> None:
        if self.known.holds(self.grid.to_world(box)):
            return
        at = box.slices
        extent = change_kernels.known_extent(self.occupancy.occupancy[at], self.search.explored[at])
        found = Box(*(int(v) for v in extent))
        if not found.empty:
            found = found.moved(box.row_lo, box.column_lo)
            self.known = self.known.union(self.grid.to_world(found))

    def _publish_values(self, names: Iterable[str], changed: Box) -> None:
        """New tiles of the layers within a box of world cells."""
        self.known = self.known.union(changed)
        self.tiles.retile_values(names, self.values, changed, self.version)
        self.frontiers.values_changed(names, changed)

    def _robot_xy(self) -> tuple[float, float]:
        if self.robot_pose is not None:
            return self.robot_pose[:2]
        return self.grid.centre_of(self.grid.rows // 2, self.grid.columns // 2)
