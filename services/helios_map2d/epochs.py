"""Maps by world: the present map, and the parked maps of earlier worlds."""

from __future__ import annotations

from dataclasses import dataclass

from helios_core.errors import Conflict
from helios_core.parked_maps import MOST_PARKED, ParkedMaps
from helios_core.robot_restarts import RobotStarts
from helios_core.types import Frame, Observation, SearchContext, WorldId

from helios_map2d.camera_view import check_pose
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.parameters import MapRules


@dataclass(frozen=True, eq=False)
class Sought:
    """Stored map whose place in the present frame is sought, and its world."""

    map: EpochMap
    world: WorldId


class EpochMaps:
    """The present map and the parked maps of earlier worlds.

    A frame of a new world (after a reboot of the robot or a jump of its localisation) parks the
    present map and starts an empty one with the same search context. A robot that restarts with the
    same origin stays in the same world, and its map continues. Frames of a parked or earlier world
    are refused, except for the world that the robot itself reports (`robot_world`): then another
    robot's frame had parked that map, and the map is restored. At most `most_parked` maps are
    stored.
    """

    def __init__(
        self,
        rules: MapRules,
        footprint_radius_m: float,
        most_parked: int = MOST_PARKED,
        first_version: int = 0,
    ) -> None:
        self.rules = rules
        self.footprint_radius_m = footprint_radius_m
        self.current: EpochMap | None = None
        self.world: WorldId | None = None
        self._context: SearchContext | None = None
        self._parked: ParkedMaps[EpochMap] = ParkedMaps(most_parked)
        self._first_version = first_version
        self.robot_world: WorldId | None = None  # world that the robot itself reports
        self._starts = RobotStarts()
        self._robot_pose: tuple[float, float, float] | None = None  # x, y (m), yaw (rad) there

    @property
    def version(self) -> int:
        """Map version; it rises with every change, also across epochs."""
        return self.current.published.version if self.current else self._first_version

    def map_for(self, frame: Frame, observation: Observation | None = None) -> EpochMap:
        """Map that a frame, or an observation of it, belongs to; a new map for a new world.

        Raises Conflict for a world or a start of the robot that is over, and for an observation of
        another search. Raises InvalidInput for a frame that cannot start a map. A refused frame
        parks no map.
        """
        key, boot_id = frame.world, frame.id.robot_boot_id
        if self.current is not None and key == self.world:
            if key.origin_id:
                self._starts.check(frame.id)
            self._go_on_in(boot_id)
            return self.current
        new_start = bool(key.origin_id) and not self._starts.knows(boot_id)
        kept = key == self.robot_world or self.current is None or new_start
        if kept and (again := self._brought_back(key, boot_id)) is not None:
            return again
        older = self.world is not None and (
            boot_id == self._starts.present and key.world_epoch < self.world.world_epoch
        )
        if self._parked.is_over(key) or (older and key != self.robot_world):
            raise Conflict(
                f"frame {frame.id.seq} is of {key}, which is over: its map was put aside"
            )
        base = check_pose(frame.T_world_base, "T_world_base")
        fresh = EpochMap(
            self.rules, (base[0, 3], base[1, 3]), self.footprint_radius_m, self.version
        )
        fresh.check(frame)
        if self._context is not None:
            fresh.reset_search(self._context)
        if observation is not None:
            fresh.check_search(observation)
        if self.current is not None and self.world is not None:
            self._parked.park(self.world, self.current)
        self.current, self.world = fresh, key
        self._starts.begin(boot_id)
        return fresh

    def set_robot_world(
        self,
        key: WorldId,
        boot_id: str = "",
        pose: tuple[float, float, float] | None = None,
    ) -> None:
        """Record the world that the robot reports, and its pose there (x, y in m, yaw in rad).

        If there is no present map but a stored map of that world, the stored map continues.
        boot_id: start of the robot, if the origin names the world.
        """
        self.robot_world, self._robot_pose = key, pose
        boot_id = boot_id or key.robot_boot_id
        if self.current is None:
            self._brought_back(key, boot_id)
        elif key == self.world:
            self._go_on_in(boot_id)
        self._starts.note_robot(boot_id)

    def is_of_another_world(self, state: EpochMap) -> bool:
        """True if a map is parked and the robot reports another world than the map's."""
        of = self._parked.world_of(state) or self.robot_world
        return self.robot_world is not None and of != self.robot_world

    def keep(self, key: WorldId, state: EpochMap) -> None:
        """Park a map, in place of one of the same world.

        It becomes the present map if there is none and the robot is in that world. Later versions
        are higher than this map's.
        """
        self._parked.put(key, state)
        self._first_version = max(self._first_version, state.version)
        if self.current is None and key == self.robot_world:
            self._brought_back(key, self._starts.present)

    def replace(self, state: EpochMap) -> None:
        """Replace the present map, in its world. Raises Conflict if no world is known."""
        key = self.world or self.robot_world
        if key is None:
            raise Conflict("no robot has said where it is; start its bridge, then load the map")
        foreign = state.frame_id is None or (
            state.frame_id.robot_boot_id != self._starts.present
            or state.frame_id.world_epoch != key.world_epoch
        )
        if foreign or self.current is not None:
            state.adopt_frame_order(self.current, self._reported_pose(key))
        state.publish_above(self.version)
        if self._context is not None:
            state.reset_search(self._context)
        self.current, self.world = state, key

    def _go_on_in(self, boot_id: str) -> None:
        """Continue the present map with a start of the robot.

        After a restart the robot may stand elsewhere, and its frame numbers restart.
        """
        if self._starts.begin(boot_id) and self.current is not None:
            self.current.adopt_frame_order(
                None, self._robot_pose if self.robot_world == self.world else None
            )
            self.current.publish_above(self.version)

    def _brought_back(self, key: WorldId, boot_id: str) -> EpochMap | None:
        """Make the parked map of a world the present one and return it; None if there is none."""
        back = self._parked.take_back(key)
        if back is None:
            return None
        if self.current is not None and self.world is not None:
            self._parked.park(self.world, self.current)
        if back.frame_id is not None:
            self._starts.begin(back.frame_id.robot_boot_id)
        if back.frame_id is None or back.frame_id.robot_boot_id != boot_id:
            back.adopt_frame_order(None, self._reported_pose(key))
        back.publish_above(self.version)
        if self._context is not None:
            back.reset_search(self._context)
        self.current, self.world = back, key
        self._starts.begin(boot_id)
        return back

    def _reported_pose(self, key: WorldId) -> tuple[float, float, float] | None:
        """Pose that the robot reports in a world; None if it reports another world."""
        return self._robot_pose if key == self.robot_world else None

    def reset_search(self, context: SearchContext) -> bool:
        """Begin a search in the present and later maps. Returns True if that resets the map."""
        self._context = context
        return self.current is not None and self.current.reset_search(context)
