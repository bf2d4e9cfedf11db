"""Gateway service: a listening socket, a web server in a thread, and the buses of its robots."""

from __future__ import annotations

import errno
import ipaddress
import logging
import os
import socket
import threading
from collections.abc import Callable

import uvicorn
from helios_core.bus import Bus
from helios_core.errors import InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.topics import status_topic

from helios_gateway.api_keys import ApiKeys
from helios_gateway.audit_log import AuditLog
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.fleet.dispatcher import Dispatcher
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app

log = logging.getLogger(__name__)

WEBSOCKET_QUEUE = 3  # messages read ahead; one frame takes 3
GATEWAY = "gateway"
GRACE_S = 1  # for open responses at shutdown


def bind(host: str, port: int) -> socket.socket:
    """Bound TCP socket that does not listen yet. Raises Unavailable if the port cannot be bound."""
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


def check_open(host: str, settings: Settings, keys: ApiKeys) -> None:
    """Check that a host beyond loopback is protected by API keys. Raises InvalidInput if not."""
    if keys.required or settings.without_keys or ipaddress.ip_address(host).is_loopback:
        return
    raise InvalidInput(
        f"{host} can be reached from other machines, so API keys are needed: make one with helios "
        "key, and name the file with --keys"
    )


class Gateway:
    """Running gateway; `close` stops it."""

    def __init__(
        self,
        bus: Bus,
        health: Health,
        settings: Settings,
        listener: socket.socket,
        keys: ApiKeys,
        another_bus: Callable[[str], Bus],
    ) -> None:
        """keys: those that `check_open` accepts for the listener. another_bus: returns the bus of a
        further robot, by name.

        Raises Unavailable (port, router), InvalidInput (record of changes).
        """
        host, port = listener.getsockname()[:2]
        try:
            listener.listen(128)  # two processes may bind one port; only one may listen
        except OSError as error:
            raise _cannot_listen(error, host, port) from error
        self._audit = None if settings.audit is None else AuditLog(settings.audit)
        queue = FleetQueue(settings.fleet_queue)
        buses = {settings.robot: bus}
        buses |= {name: another_bus(name) for name in settings.other_robots}
        self._others = [one for one in buses.values() if one is not bus]
        self.robots = RobotRegistry(
            {name: RobotEndpoint(one, RobotMonitor(one, settings)) for name, one in buses.items()}
        )
        self._show_own_health(bus)
        self._fleet = Dispatcher(self.robots, queue, settings.call_timeout_s)
        config = uvicorn.Config(
            create_app(self.robots, settings, keys, self._audit, self._fleet),
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            proxy_headers=bool(settings.trusted_proxies),
            forwarded_allow_ips=list(settings.trusted_proxies),
            timeout_graceful_shutdown=GRACE_S,
            limit_concurrency=settings.max_connections,
            ws_max_size=settings.frame_limit_bytes,  # per message
            ws_max_queue=WEBSOCKET_QUEUE,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(
            target=self._serve, args=(listener,), name="http", daemon=True
        )
        for served in self.robots.robots.values():
            served.monitor.start()
        self._fleet.start()
        self._thread.start()
        address = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
        log.info("dashboard at %s", address)
        if queue.fault:
            health.degraded(queue.fault)
        else:
            health.ready(queue.said or address)

    def _show_own_health(self, bus: Bus) -> None:
        """Show for every robot the health that this process reports on the first robot's bus."""
        others = [s.monitor.services for s in self.robots.robots.values() if s.bus is not bus]
        for services in others:
            bus.subscribe(status_topic(GATEWAY), services.listener(GATEWAY))

        def on_alive(service: str, instance: str, alive: bool) -> None:
            for services in others if service == GATEWAY else ():
                services.on_alive(service, instance, alive)

        bus.watch(on_alive)

    def close(self) -> None:
        self.robots.close()  # first: open event streams delay the shutdown
        self._server.should_exit = True
        self._thread.join(GRACE_S + 0.5)
        self._fleet.close()
        if self._audit is not None:
            self._audit.close()
        for bus in self._others:
            bus.close()

    def _serve(self, listener: socket.socket) -> None:
        """Run the web server until `close`.

        If the server ends on its own, end the process: its supervisor starts another one.
        """
        why: BaseException | None = None
        try:
            self._server.run(sockets=[listener])
        except BaseException as error:
            why = error
        if not self._server.should_exit:
            log.critical("the web server ended, and the gateway with it", exc_info=why)
            logging.shutdown()
            os._exit(1)
