"""The gateway as a service: a listening socket, a web server in a thread, the bus behind it."""

from __future__ import annotations

import errno
import logging
import socket
import threading

import uvicorn
from helios_core.bus import Bus
from helios_core.errors import Unavailable
from helios_core.health import Health

from helios_gateway.app import create_app
from helios_gateway.live import Live
from helios_gateway.settings import Settings

log = logging.getLogger(__name__)

GRACE_S = 1  # for answers under way when it is told to stop


def bind(host: str, port: int) -> socket.socket:
    """A bound socket, not yet listening. Raises Unavailable where the port cannot be had."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        out = socket.socket(family, kind, protocol)
    except OSError as error:
        raise Unavailable(f"cannot listen on {host}: {error.strerror}; see --host") from error
    try:
        out.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        out.bind(address)
    except OSError as error:
        out.close()
        raise _cannot_listen(error, host, port) from error
    return out


def _cannot_listen(error: OSError, host: str, port: int) -> Unavailable:
    if error.errno == errno.EADDRINUSE:
        return Unavailable(f"port {port} on {host} is in use; choose another with --port")
    return Unavailable(
        f"cannot listen on port {port} of {host}: {error.strerror}; see --host and --port"
    )


class Gateway:
    """A running gateway; `close` ends it."""

    def __init__(
        self, bus: Bus, health: Health, settings: Settings, listener: socket.socket
    ) -> None:
        host, port = listener.getsockname()[:2]
        try:
            listener.listen(128)  # two processes may bind one port; only one may listen
        except OSError as error:
            raise _cannot_listen(error, host, port) from error
        self.live = Live(bus, settings)
        config = uvicorn.Config(
            create_app(bus, self.live, settings),
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=GRACE_S,
        )
        self._server = uvicorn.Server(config)
        self._health = health
        self._thread = threading.Thread(
            target=self._serve, args=(listener,), name="http", daemon=True
        )
        self.live.start()
        self._thread.start()
        address = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
        log.info("dashboard at %s", address)
        health.ready(address)

    def close(self) -> None:
        self.live.close()  # first: an open event stream would hold the server up
        self._server.should_exit = True
        self._thread.join(GRACE_S + 0.5)

    def _serve(self, listener: socket.socket) -> None:
        try:
            self._server.run(sockets=[listener])
        except BaseException as error:
            log.exception("the web server ended")
            self._health.degraded(f"the web server ended: {error!r}; restart the gateway")
