"""Which frame is the newest, when frames come late, twice, or from a stranger."""

from __future__ import annotations

from collections import deque

REMEMBERED_FRAMES = 4096
STRANGER_AFTER = 3  # frames in a row that say otherwise


class FrameOrder:
    """Follows the numbers of the frames of one epoch.

    The highest number is the newest. When `STRANGER_AFTER` frames in a row are older than it but
    rise among themselves, it was no frame of this robot, and the last of them is the newest.
    """

    def __init__(self, newest: int | None = None) -> None:
        self.newest = newest
        self._seen: deque[int] = deque(maxlen=REMEMBERED_FRAMES)
        self._older: list[int] = []

    def has(self, seq: int) -> bool:
        """Whether this very frame was taken."""
        return seq in self._seen

    def is_newest(self, seq: int) -> bool:
        """Note a frame that is not taken yet; whether it is the newest now."""
        if self.newest is None or seq > self.newest:
            self.newest = seq
            self._older.clear()
            return True
        if self._older and seq == self._older[-1]:
            return False
        if self._older and seq < self._older[-1]:
            self._older.clear()
        self._older.append(seq)
        if len(self._older) < STRANGER_AFTER:
            return False
        self.newest = seq
        self._older.clear()
        return True

    def take(self, seq: int) -> None:
        """Remember a frame as taken."""
        self._seen.append(seq)
