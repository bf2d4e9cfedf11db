"""Payloads of large messages, written once into memory that Zenoh shares between processes.

Zenoh hands such a payload on by reference to each process of this machine, also over the router,
and as bytes to any other. It frees the memory when the last process that holds the payload lets it
go or dies. `orphaned_memory` frees that of killed senders.
"""

from __future__ import annotations

import logging
import threading
from contextlib import suppress

import zenoh
from zenoh import shm

from helios_core.image_messages import ImageMessage
from helios_core.orphaned_memory import MemoryRecord, free_orphans_later, mapped_segments

log = logging.getLogger(__name__)

POOL_BYTES = 12 << 20  # seven frames of 640x480 with depth
LARGEST_SHARE = 2  # a payload above POOL_BYTES / LARGEST_SHARE goes without

WITHOUT = (
    "no shared memory (%s); images go through the network stack, which takes longer: give the "
    "process a /dev/shm of 64 MB or more"
)

Payload = bytes | zenoh.ZBytes


class SharedPayloads:
    """Memory of one session for the payloads that it publishes. Thread-safe."""

    def __init__(self, usable: bool = True) -> None:
        """usable: False if the session shares no memory; all payloads are then bytes."""
        self._lock = threading.Lock()
        self._pool: shm.ShmProvider | None = None
        self._record: MemoryRecord | None = None
        self._usable = usable

    def close(self) -> None:
        """Free the memory once the last subscriber has let go of its payload. Call it after the
        session is closed."""
        with self._lock:
            self._pool, self._usable = None, False
            if self._record is not None:
                self._record.close()
                self._record = None

    def of(self, message: ImageMessage) -> Payload:
        """Payload of a message: in shared memory if there is room, else as bytes."""
        data = message.SerializeToString()
        if len(data) > POOL_BYTES // LARGEST_SHARE:
            return data
        with self._lock:
            pool = self._opened()
            if pool is None:
                return data
            try:
                room = pool.alloc(len(data), policy=shm.GarbageCollect())
            except zenoh.ZError:  # subscribers still hold every payload
                return data
        room[0 : len(data)] = data
        return zenoh.ZBytes(room)

    def _opened(self) -> shm.ShmProvider | None:
        if self._pool is None and self._usable:
            before = mapped_segments()
            try:
                self._pool = shm.ShmProvider.default_backend(POOL_BYTES)
            except zenoh.ZError as error:
                self._usable = False
                log.warning(WITHOUT, error)
                return None
            with suppress(OSError):  # without a record, a kill leaves the memory to subscribers
                self._record = MemoryRecord(mapped_segments() - before)
                free_orphans_later()
        return self._pool
