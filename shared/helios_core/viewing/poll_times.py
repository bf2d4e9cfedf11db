"""Times at which maps are polled: each map has its own. No clock, and not thread-safe."""

from __future__ import annotations

import math
from collections.abc import Mapping

LONGEST_PAUSE_S = 30.0  # between requests to a map that does not reply


class PollTimes:
    """Due times of the maps with news. A map that does not reply is polled less and less often."""

    def __init__(self, periods_s: Mapping[str, float]) -> None:
        """periods_s: map -> least time between two of its polls. Each may be polled at once."""
        self._periods_s = dict(periods_s)
        self._pauses_s = dict(periods_s)
        self._due_s = dict.fromkeys(periods_s, -math.inf)
        self._news: set[str] = set()

    def note_news(self, name: str) -> None:
        """Note that a map has changed, so that it is to be polled."""
        self._news.add(name)

    def next(self) -> tuple[str, float] | None:
        """Map with news that is due first, and its due time (s); None without news."""
        due = min(((self._due_s[name], name) for name in self._news), default=None)
        return None if due is None else (due[1], due[0])

    def begin(self, name: str) -> None:
        """Note that a map is polled now; later news make it due again."""
        self._news.discard(name)

    def end(self, name: str, replied: bool, now_s: float) -> None:
        """Note the end of a map's poll."""
        period_s = self._periods_s[name]
        longest_s = max(period_s, LONGEST_PAUSE_S)
        self._pauses_s[name] = period_s if replied else min(2 * self._pauses_s[name], longest_s)
        self._due_s[name] = now_s + self._pauses_s[name]
