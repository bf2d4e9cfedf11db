"""The map of one world epoch: folds frames and observations in, publishes immutable versions."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from helios_core.errors import Conflict
from helios_core.geometry import yaw_of
from helios_core.types import Frame, FrameId, Observation, SearchContext
from numpy.typing import NDArray

from helios_map2d.explored import SearchArea
from helios_map2d.frontiers import Frontier, FrontierFinder, FrontierRules
from helios_map2d.grid import Box, GridSpec
from helios_map2d.occupancy import OCCUPIED, UNKNOWN, OccupancyLayer, OccupancyRules
from helios_map2d.snapshot import MapSnapshot
from helios_map2d.value import ValueLayers, ValueRules
from helios_map2d.view import View, check_pose, require_inside, view_of

MOST_TRAJECTORY_POINTS = 20_000
REMEMBERED_FRAMES = 4096


@dataclass(frozen=True)
class MapRules:
    """Every rule of the maps. Depth outside (min, max) is no evidence; lengths in metres."""

    cell_m: float = 0.025
    size_cells: int = 2000
    min_depth_m: float = 0.10
    max_depth_m: float = 5.0
    occupancy: OccupancyRules = field(default_factory=OccupancyRules)
    values: ValueRules = field(default_factory=ValueRules)
    frontiers: FrontierRules = field(default_factory=FrontierRules)
    trajectory_step_m: float = 0.05


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
        self.grid = GridSpec.centred_on(*centre_m, rules.cell_m, rules.size_cells)
        self.footprint_radius_m = footprint_radius_m
        self.occupancy = OccupancyLayer(self.grid, rules.occupancy)
        self.search = SearchArea(self.grid)
        self.values = ValueLayers(self.grid, rules.values)
        self.frontiers = FrontierFinder(self.grid, rules.frontiers)
        self.context_id = ""
        self.frame_id: FrameId | None = None
        self.stamp_ns = 0
        self.robot_pose: tuple[float, float, float] | None = None
        self.trajectory: list[tuple[float, float]] = []
        self._box = Box(0, 0, 0, 0)
        self._version = first_version
        self._frames_seen: deque[int] = deque(maxlen=REMEMBERED_FRAMES)
        self._observations_seen: deque[tuple[str, int]] = deque(maxlen=REMEMBERED_FRAMES)
        self.published = self._publish()

    def integrate_frame(self, frame: Frame) -> bool:
        """Fold a posed depth image into occupancy, explored area and frontiers.

        Returns False when this very frame is in the map already (nothing changes). A keyframe may
        come late; a stream frame older than the newest is refused with Conflict, since what it saw
        is out of date. Raises InvalidInput, and changes nothing, for a pose that is not rigid,
        sizes that disagree, or a robot outside the map. Pixels that are NaN, infinite, zero or
        negative count as not measured.
        """
        if frame.id.seq in self._frames_seen:
            return False
        if not frame.keyframe and self.frame_id and frame.id.seq < self.frame_id.seq:
            raise Conflict(
                f"stream frame {frame.id.seq} is older than frame {self.frame_id.seq}, which is in "
                "the map: send frames in order, or as keyframes"
            )
        view, (x_m, y_m, yaw_rad) = self._laid_out(frame)
        seen = self.occupancy.integrate(view, (x_m, y_m), self.footprint_radius_m)
        self.search.add(seen, view.window)
        self._box = view.window.union(self._box)
        if self.footprint_radius_m > 0:
            disc = self.occupancy.clear_disc(x_m, y_m, self.footprint_radius_m)
            self._box = disc.union(self._box)
            near_m = self.rules.frontiers.blind_radius_m
            self.search.add_near_robot(self.occupancy.occupancy, x_m, y_m, near_m)
        self._frames_seen.append(frame.id.seq)
        if self.frame_id is None or frame.id.seq > self.frame_id.seq:
            self.frame_id = frame.id
            self.stamp_ns = frame.stamp_ns
            self.robot_pose = (x_m, y_m, yaw_rad)
            self._follow(x_m, y_m)
        self.published = self._publish()
        return True

    def integrate_values(self, observation: Observation) -> bool:
        """Fold an observation's layer scores into the value layers of the present search.

        Returns False when this observation is in the map already. Raises Conflict when it belongs
        to another search context, InvalidInput as `integrate_frame` does or for a score that is
        not finite.
        """
        if observation.context_id != self.context_id:
            raise Conflict(
                f"the observation belongs to search context {observation.context_id!r}, the map is "
                f"at {self.context_id!r}: observe again under the present context"
            )
        key = (observation.context_id, observation.frame.id.seq)
        if key in self._observations_seen:
            return False
        view, _ = self._laid_out(observation.frame)
        window = self.values.integrate(view, observation.layer_scores)
        self._box = window.union(self._box)
        self._observations_seen.append(key)
        self.published = self._publish(ground_changed=False)
        return True

    def reset_search(self, context: SearchContext) -> bool:
        """Begin a search: forget what was searched and every value; keep the occupancy.

        Returns False when this context is the present one already.
        """
        if context.id == self.context_id:
            return False
        self.context_id = context.id
        self.search.reset()
        self.values.reset(tuple(context.prompts))
        self.published = self._publish()
        return True

    def go_on_from(self, version: int) -> None:
        """Publish again with a version above this one."""
        self._version = max(self._version, version)
        self.published = self._publish()

    def snapshot(self) -> MapSnapshot:
        """The newest published version."""
        return self.published

    def _laid_out(self, frame: Frame) -> tuple[View, tuple[float, float, float]]:
        T_world_base = check_pose(frame.T_world_base, "T_world_base")
        x_m, y_m = float(T_world_base[0, 3]), float(T_world_base[1, 3])
        require_inside(self.grid, x_m, y_m, "the robot")
        rules = self.rules
        view = view_of(frame.depth_m, frame.camera, frame.T_world_cam, self.grid,
                       rules.min_depth_m, rules.max_depth_m)  # fmt: skip
        return view, (x_m, y_m, float(yaw_of(T_world_base)))

    def _follow(self, x_m: float, y_m: float) -> None:
        last = self.trajectory[-1] if self.trajectory else None
        step_m = self.rules.trajectory_step_m
        if last is None or np.hypot(x_m - last[0], y_m - last[1]) >= step_m:
            self.trajectory.append((x_m, y_m))
        if len(self.trajectory) > MOST_TRAJECTORY_POINTS:
            self.trajectory = self.trajectory[::2]

    def _publish(self, *, ground_changed: bool = True) -> MapSnapshot:
        """The next version. ground_changed: whether anything but the value layers has."""
        self._version += 1
        layers = self.values.layers
        values = {name: layer.value for name, layer in layers.items()}
        found = self._find_frontiers(values) if ground_changed else self.frontiers.revalued(values)
        box = self._known_box()
        at = box.slices
        occupancy = frozen(self.occupancy.occupancy[at])
        occupied = occupancy == OCCUPIED
        return MapSnapshot(
            version=self._version,
            frame_id=self.frame_id,
            stamp_ns=self.stamp_ns,
            context_id=self.context_id,
            grid=self.grid.crop(box),
            whole_grid=self.grid,
            occupancy=occupancy,
            explored=frozen(self.occupancy.explored[at]),
            explored_for_search=frozen(self.search.explored[at]),
            z_low_m=frozen(np.where(occupied, self.occupancy.z_low_m[at], np.float32(0))),
            z_high_m=frozen(np.where(occupied, self.occupancy.z_high_m[at], np.float32(0))),
            values=MappingProxyType({n: frozen(layer.value[at]) for n, layer in layers.items()}),
            confidences=MappingProxyType(
                {n: frozen(layer.confidence[at]) for n, layer in layers.items()}
            ),
            frontiers=found,
            robot_pose=self.robot_pose,
            trajectory_m=frozen(np.array(self.trajectory, np.float64).reshape(-1, 2)),
        )

    def _find_frontiers(self, values: Mapping[str, NDArray[np.float32]]) -> tuple[Frontier, ...]:
        middle = self.grid.centre_of(self.grid.rows // 2, self.grid.columns // 2)
        return self.frontiers.find(
            self.occupancy.occupancy,
            self.search.explored,
            self.search.box,
            self.robot_pose[:2] if self.robot_pose else middle,
            values,
        )

    def _known_box(self) -> Box:
        """The smallest box with everything that is known; one cell when nothing is."""
        at = self._box.slices
        known = self.occupancy.occupancy[at] != UNKNOWN
        known |= self.search.explored[at] != 0
        for layer in self.values.layers.values():
            known |= layer.confidence[at] > 0
        rows = np.flatnonzero(known.any(axis=1))
        columns = np.flatnonzero(known.any(axis=0))
        if not len(rows):
            row, column = self.grid.rows // 2, self.grid.columns // 2
            return Box(row, row + 1, column, column + 1)
        return Box(
            self._box.row_lo + int(rows[0]), self._box.row_lo + int(rows[-1]) + 1,
            self._box.column_lo + int(columns[0]), self._box.column_lo + int(columns[-1]) + 1,
        )  # fmt: skip


def frozen(array: NDArray) -> NDArray:
    """A contiguous copy that cannot be written."""
    copy = np.array(array, order="C")
    copy.flags.writeable = False
    return copy
