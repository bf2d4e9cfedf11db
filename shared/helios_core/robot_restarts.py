"""Which start of a robot is the present one, of those whose frames one map may hold."""

from __future__ import annotations

from collections import deque

from helios_core.errors import Conflict
from helios_core.types import FrameId

MOST_REMEMBERED = 256


class RobotStarts:
    """Starts of the robot, by boot id, in the order of their coming."""

    def __init__(self) -> None:
        self.present = ""  # whose frames are taken; "" before there is one
        self._robots = ""  # the one that the robot itself says it is in
        self._known: deque[str] = deque(maxlen=MOST_REMEMBERED)

    def knows(self, boot_id: str) -> bool:
        """Whether anything came from this start yet."""
        return boot_id in self._known

    def note_robot(self, boot_id: str) -> bool:
        """The robot itself says which start it is in; whether that is another one."""
        self._robots = boot_id
        return self.begin(boot_id)

    def check(self, id: FrameId) -> None:
        """Raises Conflict for a frame of an earlier start: the robot does not stand there now."""
        if id.robot_boot_id not in (self.present, self._robots) and self.knows(id.robot_boot_id):
            raise Conflict(
                f"frame {id} is of an earlier start of the robot ({id.robot_boot_id!r}, now "
                f"{self.present!r}), which is over; send frames of the present one"
            )

    def begin(self, boot_id: str) -> bool:
        """From now on this start is the present one; whether another one was."""
        if not self.knows(boot_id):
            self._known.append(boot_id)
        before, self.present = self.present, boot_id
        return before not in ("", boot_id)
