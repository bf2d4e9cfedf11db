"""One answer for all who ask the same thing at about the same time."""

from __future__ import annotations

import copy
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from helios_core.errors import HeliosError

T = TypeVar("T")


@dataclass
class _Entry(Generic[T]):
    making: threading.Lock = field(default_factory=threading.Lock)
    made: tuple[Hashable, float, T] | None = None  # of what state, when, what
    failed: tuple[float, HeliosError] | None = None  # when, with what; None: the newest was made


class RequestCoalescer(Generic[T]):
    """Keeps the newest answer per key. Thread-safe; one thread makes, the others wait for it.

    A failure is shared by those who waited for it and no longer: who asks later tries again.
    """

    def __init__(
        self, max_age_s: float, max_keys: int = 16, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._max_age_s = max_age_s
        self._max_keys = max_keys
        self._clock = clock
        self._lock = threading.Lock()
        self._entries: OrderedDict[Hashable, _Entry[T]] = OrderedDict()

    def get(self, key: Hashable, state: Hashable, make: Callable[[], T]) -> T:
        """The answer for `key`, made anew when `state` is another or the answer is too old.

        Raises what `make` raises.
        """
        asked_s = self._clock()
        with self._lock:
            entry = self._entries.setdefault(key, _Entry())
            self._entries.move_to_end(key)
            while len(self._entries) > self._max_keys:
                self._entries.popitem(last=False)
        with entry.making:
            if entry.made is not None:
                of, at_s, value = entry.made
                if of == state and self._clock() - at_s < self._max_age_s:
                    return value
            if entry.failed is not None:
                at_s, error = entry.failed
                if asked_s <= at_s:
                    raise copy.copy(error)  # each with the traceback of its own thread
            began_s = self._clock()
            try:
                value = make()
            except HeliosError as error:
                entry.failed = (self._clock(), copy.copy(error))
                raise
            entry.made, entry.failed = (state, began_s, value), None
            return value
