"""Limit on the concurrent sockets of one kind."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import AbstractContextManager

from helios_core.errors import Unavailable


class ConnectionSlots:
    """Counter of open sockets with a limit. For one event loop."""

    def __init__(self, most: int, what: str) -> None:
        """most: the limit. what: name of the sockets for errors, such as "sockets for frames"."""
        self._most, self._what, self._held = most, what, 0

    def taken(self) -> AbstractContextManager[None]:
        """Take a slot, held until the context ends. Raises Unavailable if all are taken."""
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
