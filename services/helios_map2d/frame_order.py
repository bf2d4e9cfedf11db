"""Selection of the newest frame, where frames may arrive late, twice, or from another robot."""

from __future__ import annotations

from collections import deque

REMEMBERED_FRAMES = 4096
OLDER_FRAMES_UNTIL_RESET = 3  # number of consecutive older frames that discredit the newest one


class FrameOrder:
    """Tracker of the frame numbers of one epoch.

    The frame with the highest number is the newest. If `OLDER_FRAMES_UNTIL_RESET` consecutive
    frames have lower but rising numbers, that frame was not from this robot, and the last of them
    becomes the newest.
    """

    def __init__(self, newest: int | None = None) -> None:
        self.newest = newest
        self._seen: deque[int] = deque(maxlen=REMEMBERED_FRAMES)
        self._older: list[int] = []

    def has(self, seq: int) -> bool:
        """True if this frame was fused."""
        return seq in self._seen

    def record(self, seq: int) -> bool:
        """Record a frame before it is fused. Returns True if it is now the newest."""
        if self.newest is None or seq > self.newest:
            self.newest = seq
            self._older.clear()
            return True
        if self._older and seq == self._older[-1]:
            return False
        if self._older and seq < self._older[-1]:
            self._older.clear()
        self._older.append(seq)
        if len(self._older) < OLDER_FRAMES_UNTIL_RESET:
            return False
        self.newest = seq
        self._older.clear()
        return True

    def take(self, seq: int) -> None:
        """Record a frame as fused."""
        self._seen.append(seq)
