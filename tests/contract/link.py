"""A TCP link between a client and its router that a test can block."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress


class Link:
    """Relays both ways. While it is held, nothing arrives from the router."""

    def __init__(self, router: str) -> None:
        host, _, port = router.removeprefix("tcp/").rpartition(":")
        self._router = (host, int(port))
        self._open = threading.Event()
        self._open.set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets = [self._listener]
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def hold(self) -> None:
        self._open.clear()

    def let_go(self) -> None:
        self._open.set()

    def close(self) -> None:
        self._open.set()
        for one in self._sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with suppress(OSError):  # closed
            while True:
                client, _ = self._listener.accept()
                router = socket.create_connection(self._router)
                self._sockets += [client, router]
                for source, sink, held in ((client, router, False), (router, client, True)):
                    job = threading.Thread(
                        target=self._relay, args=(source, sink, held), daemon=True
                    )
                    job.start()

    def _relay(self, source: socket.socket, sink: socket.socket, held: bool) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                if held:
                    self._open.wait()
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
