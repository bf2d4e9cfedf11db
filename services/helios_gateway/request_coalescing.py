"""Coalescing of requests: equal requests at about the same time share one result."""

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
    made: tuple[Hashable, float, T] | None = None  # state, time, value
    failed: tuple[float, HeliosError] | None = None  # time, error; None: the last attempt succeeded


class RequestCoalescer(Generic[T]):
    """Newest result per key. Thread-safe; one thread computes it, the others wait for it.

    A failure goes to all threads that waited for it. A later request tries again.
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
        """Result for `key`, computed anew if `state` differs or the result is too old.

        Raises the errors of `make`.
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
                    raise copy.copy(error)  # a copy, so that each thread has its own traceback
            began_s = self._clock()
            try:
                value = make()
            except HeliosError as error:
                entry.failed = (self._clock(), copy.copy(error))
                raise
            entry.made, entry.failed = (state, began_s, value), None
            return value
