"""Set of the open registrations of a bus."""

from __future__ import annotations

from collections.abc import Callable


class Registrations:
    """Open registrations, each undone exactly once, from any thread, also from inside its handler.

    It needs no lock, because removing an entry from a dict is atomic.
    """

    def __init__(self) -> None:
        self._undos: dict[_Registration, Callable[[], None]] = {}

    def __len__(self) -> int:
        return len(self._undos)

    def keep(self, undo: Callable[[], None]) -> _Registration:
        """Registration that calls `undo` when it is closed."""
        out = _Registration(self._undos)
        self._undos[out] = undo
        return out

    def close(self) -> None:
        """Close all registrations, the newest first."""
        for registration in reversed(list(self._undos)):
            registration.close()


class _Registration:
    def __init__(self, undos: dict[_Registration, Callable[[], None]]) -> None:
        self._undos = undos

    def close(self) -> None:
        undo = self._undos.pop(self, None)  # only one of several callers gets it
        if undo:
            undo()
