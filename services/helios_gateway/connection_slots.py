"""A limit on how many sockets of one kind are open at the same time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import AbstractContextManager

from helios_core.errors import Unavailable


class ConnectionSlots:
    """Counts open sockets up to a limit. For one event loop."""

    def __init__(self, most: int, what: str) -> None:
        """most: the limit. what: the sockets in words, such as "sockets for frames"."""
        self._most, self._what, self._held = most, what, 0

    def taken(self) -> AbstractContextManager[None]:
        """A slot, held until the context ends. Raises Unavailable where all are taken."""
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
