"""Which map a frame belongs to: one per world epoch, the earlier ones parked."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from helios_core.errors import Conflict, InvalidInput
from helios_core.types import Frame, FrameId, SearchContext

from helios_map2d.state import MapRules, MapState
from helios_map2d.view import check_pose


@dataclass(frozen=True)
class EpochKey:
    robot_boot_id: str
    world_epoch: int

    @staticmethod
    def of(frame_id: FrameId) -> EpochKey:
        return EpochKey(frame_id.robot_boot_id, frame_id.world_epoch)


class EpochMaps:
    """The present map and the parked ones of earlier world epochs.

    A frame of a new epoch (a reboot of the robot, or a jump of its localisation) parks the present
    map and starts a fresh one under the same search context. Frames of a parked or earlier epoch
    are refused. At most `most_parked` maps are kept.
    """

    def __init__(
        self,
        rules: MapRules,
        footprint_radius_m: float,
        most_parked: int = 2,
        first_version: int = 0,
    ) -> None:
        self.rules = rules
        self.footprint_radius_m = footprint_radius_m
        self.current: MapState | None = None
        self.key: EpochKey | None = None
        self._context: SearchContext | None = None
        self._parked: deque[tuple[EpochKey, MapState]] = deque(maxlen=most_parked)
        self._gone: set[EpochKey] = set()
        self._first_version = first_version

    @property
    def version(self) -> int:
        """Rises with every change, over epochs too."""
        return self.current.published.version if self.current else self._first_version

    @property
    def parked(self) -> Mapping[EpochKey, MapState]:
        return dict(self._parked)

    def state_for(self, frame: Frame) -> MapState:
        """The map that a frame belongs to; starts one when its epoch is new.

        Raises Conflict for an epoch that is over, InvalidInput for a pose that can't start a map.
        """
        key = EpochKey.of(frame.id)
        if self.current is not None and key == self.key:
            return self.current
        older = self.key is not None and (
            key.robot_boot_id == self.key.robot_boot_id and key.world_epoch < self.key.world_epoch
        )
        if key in self._gone or older:
            raise Conflict(
                f"frame {frame.id.seq} is of world epoch {key.world_epoch} of robot boot "
                f"{key.robot_boot_id!r}, which is over: its map is parked"
            )
        base = check_pose(frame.T_world_base, "T_world_base")
        if np.abs(base[:2, 3]).max() > 1e6:
            raise InvalidInput(
                f"the first pose is at {base[:2, 3].tolist()} m: send a pose in the local world"
            )
        fresh = MapState(
            self.rules, (base[0, 3], base[1, 3]), self.footprint_radius_m, self.version
        )
        if self._context is not None:
            fresh.reset_search(self._context)
        if self.current is not None and self.key is not None:
            self._parked.append((self.key, self.current))
            self._gone.add(self.key)
        self.current, self.key = fresh, key
        return fresh

    def reset_search(self, context: SearchContext) -> None:
        """Begin a search in the present map, and in those to come."""
        self._context = context
        if self.current is not None:
            self.current.reset_search(context)
