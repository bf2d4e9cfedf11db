"""A TCP relay between two ports that a test can cut; a cut relay drops every byte."""

from __future__ import annotations

import contextlib
import socket
import threading


class Wire:
    """Listens on `port` of the loopback and relays to `target`."""

    def __init__(self, target: int) -> None:
        self._target = target
        self._whole = threading.Event()
        self._whole.set()
        self._sockets: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        threading.Thread(target=self._accept, name="wire", daemon=True).start()

    def cut(self) -> None:
        """Drop all bytes without closing a connection, as when a radio link fades."""
        self._whole.clear()

    def mend(self) -> None:
        """Close the old connections, whose dropped bytes are lost, and relay new ones."""
        self._close_all()
        self._whole.set()

    def close(self) -> None:
        self._whole.set()
        self._server.close()
        self._close_all()

    def _close_all(self) -> None:
        while self._sockets:
            with contextlib.suppress(OSError):
                self._sockets.pop().close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
            except OSError:  # closed
                return
            try:
                far = socket.create_connection(("127.0.0.1", self._target), timeout=5)
            except OSError:  # no server now; the next connection may succeed
                near.close()
                continue
            far.settimeout(None)
            self._sockets += [near, far]
            for a, b in ((near, far), (far, near)):
                threading.Thread(target=self._pass_on, args=(a, b), daemon=True).start()

    def _pass_on(self, a: socket.socket, b: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := a.recv(65536):
                if self._whole.is_set():
                    b.sendall(data)
        for end in (a, b):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
