"""A bounded number of places, for sockets that each hold something open."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import AbstractContextManager

from helios_core.errors import Unavailable


class ConnectionSlots:
    """So many at the same time, and no more. Used on one event loop."""

    def __init__(self, most: int, what: str) -> None:
        """what: who takes the places, such as "sockets for frames"."""
        self._most, self._what, self._held = most, what, 0

    def taken(self) -> AbstractContextManager[None]:
        """A place, held until the context ends. Raises Unavailable where none is left."""
        if self._held >= self._most:
            raise Unavailable(
                f"{self._held} {self._what} are open and no more are taken; close one"
            )
        self._held += 1

        @contextlib.contextmanager
        def hold() -> Iterator[None]:
            try:
                yield
            finally:
                self._held -= 1

        return hold()
