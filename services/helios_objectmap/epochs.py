"""One map per world epoch: the present one and the parked ones of worlds that are over."""

from __future__ import annotations

from collections import deque

from helios_core.errors import Conflict
from helios_core.types import FrameId

from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings

Epoch = tuple[str, int]  # robot boot id, world epoch

MOST_PARKED = 2
MOST_REMEMBERED = 256


class EpochMaps:
    """A frame of a new epoch parks the present map and starts a fresh one.

    A frame of the epoch that the robot itself says it is in is never refused: it brings its map
    back, if a stranger's frame parked it.
    """

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self._over: deque[Epoch] = deque(maxlen=MOST_REMEMBERED)
        self.epoch: Epoch | None = None
        self.robot_epoch: Epoch | None = None  # the one that the robot itself is in
        self.current = ObjectMap(settings)
        self.newest: FrameId | None = None  # the newest frame in the present map
        self.from_disk = False  # no frame has come since the present map was read
        self.parked: deque[tuple[Epoch, ObjectMap]] = deque(maxlen=MOST_PARKED)

    def map_for(self, id: FrameId) -> ObjectMap:
        """The map a frame belongs to. Raises Conflict for an epoch that is over."""
        if id.epoch == self.epoch:
            self.from_disk = False
            return self.current
        if id.epoch == self.robot_epoch:
            return self._bring_back(id.epoch)
        same_boot = self.epoch is not None and id.robot_boot_id == self.epoch[0]
        if id.epoch in self._over or (
            same_boot and self.epoch is not None and id.world_epoch < self.epoch[1]
        ):
            raise Conflict(
                f"frame {id} is of world epoch {id.world_epoch}, which is over (now "
                f"{self.epoch}): its map is parked; send frames of the present epoch"
            )
        self._go_to(id.epoch, ObjectMap(self._settings))
        return self.current

    def robot_is_in(self, epoch: Epoch) -> bool:
        """Note it. A map that was read from disk and is of another epoch makes room at once.

        Returns whether the present map is another one now.
        """
        self.robot_epoch = epoch
        if not self.from_disk or epoch == self.epoch:
            return False
        self._go_to(epoch, ObjectMap(self._settings))
        return True

    def _bring_back(self, epoch: Epoch) -> ObjectMap:
        back = next((m for e, m in self.parked if e == epoch), None)
        if back is not None:
            kept = [(e, m) for e, m in self.parked if e != epoch]
            self.parked.clear()
            self.parked.extend(kept)
        if epoch in self._over:
            self._over.remove(epoch)
        self._go_to(epoch, back or ObjectMap(self._settings))
        return self.current

    def _go_to(self, epoch: Epoch, fresh: ObjectMap) -> None:
        """Park the present map, if it is of an epoch, and go on with another."""
        if self.epoch is not None:
            self._over.append(self.epoch)
            self.parked.append((self.epoch, self.current))
            self.current = fresh
        self.from_disk, self.newest = False, None
        self.epoch = epoch
