"""TCP relay between a service and the router, which can cut, delay and throttle the link.

TCP hides loss and reordering from both ends: they see only that data comes late. The relay makes
them late in the same way. A lost segment holds the stream for `RESEND_S`, the smallest time in
which Linux sends a segment again; a segment that was overtaken holds it for one more delay.
"""

from __future__ import annotations

import queue
import random
import socket
import struct
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

CHUNK = 1 << 16  # bytes
SEGMENT = 1448  # bytes of one TCP segment on Ethernet
RESEND_S = 0.2
QUEUED = 64  # chunks in flight per direction
CONNECT_S = 1.0
RESET = struct.pack("ii", 1, 0)  # linger for no time: the socket closes with a reset


@dataclass(frozen=True)
class LinkQuality:
    """State of a link, in both directions."""

    delay_s: float = 0.0
    jitter_s: float = 0.0  # greatest addition to the delay
    loss: float = 0.0  # share of lost segments
    reorder: float = 0.0  # share of overtaken segments

    def lateness_s(self, size: int, random_: random.Random) -> float:
        """Time that a chunk of `size` bytes takes."""
        late_s = self.delay_s + self.jitter_s * random_.random()
        if self.loss or self.reorder:
            for _ in range(max(1, size // SEGMENT)):
                late_s += RESEND_S * (random_.random() < self.loss)
                late_s += self.delay_s * (random_.random() < self.reorder)
        return late_s


class Relay:
    """Link to a router, on a port of its own. Thread-safe."""

    def __init__(self, router: tuple[str, int], seed: int = 0) -> None:
        """router: its host and port."""
        self._router, self._seed = router, seed
        self._quality = LinkQuality()
        self._cut, self._closed = threading.Event(), threading.Event()
        self._flowing = threading.Event()
        self._flowing.set()
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        threading.Thread(target=self._accept, name=f"relay {self.port}", daemon=True).start()

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self.port}"

    def cut(self) -> None:
        """Reset all connections and refuse new ones until `restore`."""
        self._cut.set()
        self._reset()

    def hold(self) -> None:
        """Pass nothing on until `restore`, as when a cable is pulled out."""
        self._flowing.clear()

    def slow(self, quality: LinkQuality) -> None:
        """Make the link slow until `restore`."""
        self._quality = quality

    def restore(self) -> None:
        self._quality = LinkQuality()
        self._cut.clear()
        self._flowing.set()

    def close(self) -> None:
        self._closed.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.restore()
        self._reset()

    def _reset(self) -> None:
        with self._lock:
            sockets, self._sockets = self._sockets, set()
        for one in sockets:
            with suppress(OSError):
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        number = 0
        while not self._closed.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            if self._cut.is_set():
                client.close()
                continue
            try:
                router = socket.create_connection(self._router, CONNECT_S)
            except OSError:  # the router is down: the client tries again
                client.close()
                continue
            router.settimeout(None)
            for one in (client, router):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._sockets |= {client, router}
            for source, sink in ((client, router), (router, client)):
                number += 1
                _Direction(self, source, sink, random.Random(self._seed * 1000 + number)).start()


class _Direction:
    """One direction of one connection: a thread that reads, and one that writes when it is due."""

    def __init__(
        self, relay: Relay, source: socket.socket, sink: socket.socket, random_: random.Random
    ) -> None:
        self._relay, self._source, self._sink, self._random = relay, source, sink, random_
        self._chunks: queue.Queue[tuple[float, bytes]] = queue.Queue(QUEUED)

    def start(self) -> None:
        for work in (self._read, self._write):
            threading.Thread(target=work, name="relay direction", daemon=True).start()

    def _read(self) -> None:
        due_s = 0.0
        with suppress(OSError):
            while data := self._source.recv(CHUNK):
                late_s = self._relay._quality.lateness_s(len(data), self._random)
                due_s = max(due_s, time.monotonic() + late_s)  # in order
                self._chunks.put((due_s, data))
        self._chunks.put((0.0, b""))

    def _write(self) -> None:
        data = b"-"
        with suppress(OSError):
            while True:
                due_s, data = self._chunks.get()
                if not data:
                    self._sink.shutdown(socket.SHUT_WR)
                    return
                if (early_s := due_s - time.monotonic()) > 0:
                    time.sleep(early_s)
                self._relay._flowing.wait()
                self._sink.sendall(data)
        with suppress(OSError):
            self._source.shutdown(socket.SHUT_RD)
        while data:  # until the reader has ended, so that it never blocks
            data = self._chunks.get()[1]
