"""What a bus has declared and not taken back yet."""

from __future__ import annotations

from collections.abc import Callable


class Registrations:
    """Each is taken back once and then held no longer, from whatever thread, also from inside its
    own handler. No lock: taking an entry out of a dict is one step."""

    def __init__(self) -> None:
        self._undos: dict[_Registration, Callable[[], None]] = {}

    def __len__(self) -> int:
        return len(self._undos)

    def keep(self, undo: Callable[[], None]) -> _Registration:
        """What calls `undo` when it is closed."""
        out = _Registration(self._undos)
        self._undos[out] = undo
        return out

    def close(self) -> None:
        """Take all of them back, the last one first."""
        for registration in reversed(list(self._undos)):
            registration.close()


class _Registration:
    def __init__(self, undos: dict[_Registration, Callable[[], None]]) -> None:
        self._undos = undos

    def close(self) -> None:
        undo = self._undos.pop(self, None)  # of several that close it, one gets it
        if undo:
            undo()
