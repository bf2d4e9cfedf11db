"""Tracking of robot starts, where one map may hold frames of several of them."""

from __future__ import annotations

from collections import deque

from helios_core.errors import Conflict
from helios_core.types import FrameId

MOST_REMEMBERED = 256


class RobotStarts:
    """Known starts of the robot, by boot id, in order of arrival."""

    def __init__(self) -> None:
        self.present = ""  # start whose frames are accepted; "" before the first
        self._robots = ""  # start that the robot itself reports
        self._known: deque[str] = deque(maxlen=MOST_REMEMBERED)

    def knows(self, boot_id: str) -> bool:
        """True if any message of this start has arrived."""
        return boot_id in self._known

    def note_robot(self, boot_id: str) -> bool:
        """Record the start that the robot itself reports. Returns True if another was present."""
        self._robots = boot_id
        return self.begin(boot_id)

    def check(self, id: FrameId) -> None:
        """Raise Conflict for a frame of an earlier start, since its pose is out of date."""
        if id.robot_boot_id not in (self.present, self._robots) and self.knows(id.robot_boot_id):
            raise Conflict(
                f"frame {id} is of an earlier start of the robot ({id.robot_boot_id!r}, now "
                f"{self.present!r}), which is over; send frames of the present one"
            )

    def begin(self, boot_id: str) -> bool:
        """Make this start the present one. Returns True if another was present before."""
        if not self.knows(boot_id):
            self._known.append(boot_id)
        before, self.present = self.present, boot_id
        return before not in ("", boot_id)
