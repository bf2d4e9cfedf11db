"""`helios up`: all services of one machine as child processes, kept running until stopped."""

from __future__ import annotations

import contextlib
import errno
import os
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from helios_core.errors import Conflict, InvalidInput
from helios_core.signal_handling import ending_signals, on_signals
from rich.markup import escape

from helios_client.supervision import router_watch, state_file
from helios_client.supervision.bus_link import BusLink
from helios_client.supervision.child_process import ProcessExit
from helios_client.supervision.forked_process import ForkServer
from helios_client.supervision.router_watch import RouterWatch
from helios_client.supervision.service_specs import LOOPBACK, StackOptions, port_bind_error
from helios_client.supervision.service_table import (
    WITHOUT_STATUS,
    ServiceRow,
    ServiceTable,
    as_json,
    is_ready,
    service_of,
)
from helios_client.supervision.supervisor import ProcessInfo, ProcessState, Supervisor
from helios_client.supervision.unknown_variables import unread_variables_message
from helios_client.terminal_output import Screen as TextScreen
from helios_client.usage_errors import UsageError, check_folder

CHECK_PERIOD_S = 0.05
WRITE_PERIOD_S = 2.0
SAY_WAITING_AFTER_S = 20.0
SAY_DEGRADED_S = 10.0


class Screen(TextScreen):
    """Console that outlives its reader, as in `helios up | tee log`."""

    def on_broken_pipe(self) -> None:
        """Print nothing from now on. Rich would also end the program."""
        with contextlib.suppress(SystemExit):
            super().on_broken_pipe()


def up(stack: StackOptions, screen: Screen, server: ForkServer | None = None) -> None:
    """Run the stack until SIGINT, SIGTERM or SIGHUP.

    server: forks the services; None: each starts with an interpreter of its own.
    Raises HeliosError, with nothing left running, for a port or state directory in use and for
    wrong flags.
    """
    assert stack.port is not None
    here = {name for spec in stack.processes() for name in spec.services}
    if "gateway" in here:
        check_port(stack.port, "--port")
    if "router" in here:
        check_port(stack.router_port, "--router-port", stack.router_host)
    if {"gateway", "router"} <= here and stack.port == stack.router_port:
        raise UsageError(
            f"--port and --router-port are both {stack.port}; choose another port for one of them"
        )
    stack = replace(stack, state_dir=stack.state_dir.resolve())
    try:
        stack.log_dir.mkdir(parents=True, exist_ok=True)
        held = state_file.lock(stack.state_dir)
    except state_file.StateDirLocked:
        raise Conflict(
            f"another `helios up` uses {stack.state_dir}; stop it, or choose another with --state"
        ) from None
    except OSError as error:
        raise InvalidInput(
            f"the state folder {stack.state_dir} cannot be used ({error.filename}: "
            f"{error.strerror}); choose another with --state"
        ) from error
    with held:
        if stack.record is not None and "recorder" in map(service_of, here):
            check_folder(stack.record)
        stopping = threading.Event()
        on_signals(ending_signals(), stopping.set)
        _Run(stack, screen, server).run(stopping)


def check_port(port: int, flag: str, host: str = LOOPBACK) -> None:
    """Raise Conflict if nothing can listen on the port of this address. `flag`: the option that
    sets another port."""
    error = port_bind_error(port, host)
    if error is None:
        return
    where = f"port {port}" if host == LOOPBACK else f"port {port} at {host}"
    if error.errno == errno.EADDRINUSE:
        raise Conflict(
            f"{where} is in use; stop the process that uses it, or choose another with {flag}"
        )
    if error.errno in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT):
        raise Conflict(
            f"this machine has no address {host} ({error.strerror}); choose another with "
            "--router-host"
        )
    low = " (ports below 1024 are reserved for the system)" if error.errno == errno.EACCES else ""
    raise Conflict(
        f"no process can listen on {where}: {error.strerror}{low}; choose another with {flag}"
    )


class _Run:
    def __init__(self, stack: StackOptions, screen: Screen, server: ForkServer | None) -> None:
        assert stack.port is not None
        specs = stack.processes()
        self._stack, self._screen = stack, screen
        self._service_table = ServiceTable()
        self._router = RouterWatch(self._service_table)
        self._names = [name for spec in specs for name in spec.services]
        self._elsewhere = stack.elsewhere()
        for name in self._names:
            if name != WITHOUT_STATUS:  # raises InvalidInput before anything starts
                stack.link(service_of(name), name.rpartition("/")[0])
        self._links = {robot: stack.link("supervisor", robot) for robot in stack.robot_names}
        self._supervisor = Supervisor(specs, stack.log_dir, fork_server=server)
        self._state_dirs: list[Path] = [stack.state_dir]
        if (default := state_file.default_state_dir(stack.port)) != stack.state_dir:
            self._state_dirs.append(default)  # where `helios status` looks
        self._was_ready: set[str] = set()
        self._degraded: dict[str, float] = {}  # time of the last report, by service
        self._all_ready = self._ever_ready = False
        self._written: tuple[ServiceRow, ...] = ()
        self._written_s = 0.0
        self._began_s = time.monotonic()

    def run(self, stopping: threading.Event) -> None:
        self._say(f"starting {', '.join(self._names)}")
        self._say(f"logs: {self._stack.log_dir}")
        if sentence := unread_variables_message(os.environ):
            self._say(f"[yellow]{escape(sentence)}[/]")
        self._supervisor.start()
        links = [
            BusLink(link, robot, self._service_table, self._rows_of(robot))
            for robot, link in self._links.items()
        ]
        said_waiting = False
        try:
            while not stopping.wait(CHECK_PERIOD_S):
                ended = self._supervisor.check()
                if self._router.is_stuck(self._supervisor.table()):
                    ended += self._supervisor.replace(WITHOUT_STATUS, router_watch.REASON)
                table = self._supervisor.table()
                for link in links:
                    link.publish(table)
                rows = self._service_table.rows(table, self._elsewhere)
                self._say_endings(ended, table)
                self._say_ready(rows)
                self._say_degraded(rows)
                self._write(rows)
                if not (said_waiting or self._ever_ready) and self._age_s() > SAY_WAITING_AFTER_S:
                    said_waiting = True
                    for row in rows:
                        if row.state != "ready":
                            self._say(f"{row.name} is {row.state}: {row.reason or 'no report yet'}")
        finally:
            self._say("stopping")
            for link in links:
                link.request_close()
            self._supervisor.stop()
            for link in links:
                link.close()
            state_file.remove(self._state_dirs)
            self._say("stopped")

    def _rows_of(self, robot: str) -> dict[str, str]:
        """Rows of a robot's services by service, with those that all robots share."""
        rows = (*self._names, *self._elsewhere)
        return {service_of(r): r for r in rows if r.rpartition("/")[0] in ("", robot)}

    def _say_endings(
        self, ended: Sequence[tuple[str, ProcessExit]], table: Sequence[ProcessInfo]
    ) -> None:
        rows = {info.process: info for info in table}
        for name, ending in ended:
            self._was_ready -= {info.name for info in table if info.process == name}
            self._all_ready = False
            info = rows[name]
            stays_down = info.state is ProcessState.STOPPED
            if stays_down and ending.usage_error and not self._ever_ready:
                raise UsageError(ending.reason)
            if stays_down:
                self._say(
                    f"[red]{name} ended and will not be restarted[/]: {escape(ending.reason)}"
                )
            elif info.state is ProcessState.RUNNING:
                self._say(
                    f"[yellow]{name} ended[/] ({escape(ending.reason)}); restarted as "
                    f"pid {info.pid}, restart {info.restarts}"
                )
            else:
                self._say(f"[yellow]{name} ended[/] ({escape(ending.reason)}); will be restarted")

    def _say_ready(self, rows: Sequence[ServiceRow]) -> None:
        for row in rows:
            if row.state == "ready" and row.name not in self._was_ready:
                self._was_ready.add(row.name)
                self._say(f"[green]{row.name}[/] is ready, pid {row.pid}")
        ready = is_ready(rows)
        if ready and not self._all_ready:
            self._ever_ready = True
            where = f": dashboard at {self._stack.address}" if "gateway" in self._names else ""
            self._say(f"[bold green]ready[/]{where}")
        self._all_ready = ready

    def _say_degraded(self, rows: Sequence[ServiceRow]) -> None:
        """Report degraded services at once, each at most once per `SAY_DEGRADED_S`."""
        for row in rows:
            if row.state != "degraded":
                continue
            if row.name not in self._was_ready and row.name in self._degraded:
                continue  # reported, and not ready since
            self._was_ready.discard(row.name)
            if self._age_s() - self._degraded.get(row.name, -SAY_DEGRADED_S) >= SAY_DEGRADED_S:
                self._degraded[row.name] = self._age_s()
                self._say(f"[yellow]{row.name} is degraded[/]: {escape(row.reason)}")

    def _write(self, rows: tuple[ServiceRow, ...]) -> None:
        now_s = time.monotonic()
        if rows == self._written and now_s - self._written_s < WRITE_PERIOD_S:
            return
        self._written, self._written_s = rows, now_s
        about = {
            "address": self._stack.address,
            "state_dir": str(self._stack.state_dir),
            "router": self._stack.router,
            "robot": self._stack.name,
            "robots": self._stack.robot_names,
            "certs": None if self._stack.certs is None else str(self._stack.certs),
        }
        try:
            state_file.write(self._state_dirs, as_json(rows) | about)
        except OSError as error:  # a full disk must not end the robot's services
            self._say(f"[yellow]the state file cannot be written[/]: {escape(str(error))}")

    def _age_s(self) -> float:
        return time.monotonic() - self._began_s

    def _say(self, text: str) -> None:
        line = f"[dim]{self._age_s():6.1f} s[/]  {text}"
        encoding = self._screen.encoding
        line = line.encode(encoding, "replace").decode(encoding)  # a path may not fit the encoding
        with contextlib.suppress(OSError):  # such as a full disk, which must not stop the robot
            self._screen.print(line, highlight=False, soft_wrap=True)
