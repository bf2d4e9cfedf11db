"""One object map per world: the current one, and the parked ones of former worlds."""

from __future__ import annotations

from helios_core.errors import Conflict
from helios_core.parked_maps import ParkedMaps
from helios_core.robot_restarts import RobotStarts
from helios_core.types import Frame, FrameId, WorldId

from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings


class EpochMaps:
    """Current and parked maps. A frame of a new world parks the current map and starts a new one.

    A robot that restarts with the same origin stays in the same world, and its map continues. A
    frame of the world that the robot itself reports is never refused. If a frame of another source
    parked the map of that world, such a frame restores it.
    """

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self._starts = RobotStarts()
        self.world: WorldId | None = None
        self.robot_world: WorldId | None = None  # world that the robot itself reports
        self.current = ObjectMap(settings)
        self.newest: FrameId | None = None  # newest frame in the current map
        self.from_disk = False  # True until the first frame after the current map was read
        self._parked: ParkedMaps[ObjectMap] = ParkedMaps()

    def map_for(self, frame: Frame) -> ObjectMap:
        """Map of a frame. Raises Conflict for a former world or a former start of the robot."""
        id, world = frame.id, frame.world
        new_start = bool(world.origin_id) and not self._starts.knows(id.robot_boot_id)
        if world == self.world:
            if world.origin_id:
                self._starts.check(id)
            self.from_disk = False
        elif world == self.robot_world or (new_start and self._parked.is_over(world)):
            parked = self._parked.take_back(world)
            self._go_to(world, ObjectMap(self._settings) if parked is None else parked)
        else:
            self._check_not_over(id, world)
            self._go_to(world, ObjectMap(self._settings))
        self._starts.begin(id.robot_boot_id)
        return self.current

    def set_robot_world(self, world: WorldId, boot_id: str) -> bool:
        """Note the robot's world. Returns True if this replaces the current map.

        A map that was read from disk and is of another world is parked at once.
        """
        self.robot_world = world
        if self._starts.note_robot(boot_id) and world == self.world:
            self.newest = None
        if not self.from_disk or world == self.world:
            return False
        self._go_to(world, ObjectMap(self._settings))
        return True

    @property
    def confirmed(self) -> WorldId | None:
        """World that the robot or a frame has reported; None before."""
        return self.robot_world or (None if self.from_disk else self.world)

    def use_anywhere(self) -> None:
        """Forget the world of a map that was read from disk, if no frame has come since.

        The current map then belongs to the world of the next frame.
        """
        if self.from_disk:
            self.world, self.newest, self.from_disk = None, None, False

    def restored(self, world: WorldId | None, newest: FrameId | None) -> None:
        """Note that the current map, with its world, comes from the file of an earlier process."""
        self.world, self.newest = world, newest
        self.from_disk = world is not None
        if newest is not None:
            self._starts.begin(newest.robot_boot_id)

    def forget(self) -> None:
        """Delete the current map and the parked ones; the worlds and starts stay known."""
        self.current.reset()
        self._parked.clear()
        self.from_disk, self.newest = False, None

    def _check_not_over(self, id: FrameId, world: WorldId) -> None:
        same_start = self.world is not None and id.robot_boot_id == self._starts.present
        older = same_start and self.world is not None and world.world_epoch < self.world.world_epoch
        if older or self._parked.is_over(world):
            raise Conflict(
                f"frame {id} is of {world}, which is over (now {self.world}): its map was put "
                "aside; send frames of the present world"
            )

    def _go_to(self, world: WorldId, fresh: ObjectMap) -> None:
        """Park the current map, if it has a world, and continue with another one."""
        if self.world is not None:
            self._parked.park(self.world, self.current)
            self.current = fresh
        self.from_disk, self.newest = False, None
        self.world = world
