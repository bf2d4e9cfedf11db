"""Payloads of large messages, written once into memory that Zenoh shares between processes.

Zenoh hands such a payload on by reference to each process of this machine, also over the router,
and as bytes to any other. It frees the memory when the last process that holds the payload lets it
go or dies.
"""

from __future__ import annotations

import logging
import threading

import zenoh
from zenoh import shm

from helios_core.image_messages import ImageMessage

log = logging.getLogger(__name__)

POOL_BYTES = 12 << 20  # seven frames of 640x480 with depth
LARGEST_SHARE = 2  # a payload above POOL_BYTES / LARGEST_SHARE goes without

Payload = bytes | zenoh.ZBytes


class SharedPayloads:
    """Memory of one session for the payloads that it publishes. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pool: shm.ShmProvider | None = None
        self._broken = False

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
        if self._pool is None and not self._broken:
            try:
                self._pool = shm.ShmProvider.default_backend(POOL_BYTES)
            except zenoh.ZError as error:
                self._broken = True
                log.warning(
                    "no shared memory (%s); images go through the network stack, which takes "
                    "longer: give the process a /dev/shm of 64 MB or more",
                    error,
                )
        return self._pool
