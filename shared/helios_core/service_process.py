"""Life cycle of a service process: connect, announce, run, report, stop cleanly on SIGTERM.

    def build(bus: Bus, health: Health) -> Closeable: ...
    sys.exit(run_service("map2d", Settings.load(), build))

The process waits for its router without a time limit and logs that. It ends within two seconds of
SIGTERM, SIGINT or SIGHUP, or of the end of its parent process.
"""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from typing import Protocol

from helios_core import log_format, span_recording
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.settings import ServiceSettings
from helios_core.signal_handling import on_signals
from helios_core.topics import settings_method, status_topic

log = logging.getLogger(__name__)

STATUS_PERIOD_S = 1.0
STOP_WITHIN_S = 2.0
ALARM_AFTER_S = 10.0  # the interpreter may take seconds to end on a busy machine


class Closeable(Protocol):
    """Running service, as `build` returns it."""

    def close(self) -> None: ...


def ending_signals() -> tuple[int, ...]:
    """Signals that end a process: SIGTERM, SIGINT, and SIGHUP (sent when a terminal session
    closes), except for a process started with `nohup`."""
    hangup = getattr(signal, "SIGHUP", None)  # missing on some systems
    if hangup is None or signal.getsignal(hangup) is signal.SIG_IGN:
        return (signal.SIGTERM, signal.SIGINT)
    return (signal.SIGTERM, signal.SIGINT, hangup)


def stop_on_signals(stopped: threading.Event) -> None:
    """Set `stopped` on `ending_signals`, and when the parent process ends.

    The process exits two seconds later at the latest, also during a long start or if a library
    hangs while it closes. If no Python thread can run, even after `main` has returned, SIGALRM ends
    the process after ALARM_AFTER_S.
    """
    on_signals(ending_signals(), stopped.set)
    parent = os.getppid()

    def watch_parent() -> None:
        while not stopped.wait(0.5):
            if os.getppid() != parent:
                stopped.set()

    def leave() -> None:
        stopped.wait()
        signal.setitimer(signal.ITIMER_REAL, ALARM_AFTER_S)  # SIGALRM ends the process
        time.sleep(STOP_WITHIN_S)
        log.error("did not stop within %.1f s; leaving", STOP_WITHIN_S)
        os._exit(1)

    threading.Thread(target=watch_parent, name="watch parent", daemon=True).start()
    threading.Thread(target=leave, name="leave", daemon=True).start()


def until_warm(
    health: Health, warm_up: Callable[[], None], ending: threading.Event, again_s: float = 10.0
) -> bool:
    """Compile a service's kernels. Returns True if that succeeded before `ending` was set.

    After a failure (damaged cache, missing compiler) the health is degraded, and it retries every
    `again_s`.
    """
    while not ending.is_set():
        try:
            warm_up()
            return True
        except Exception as error:  # libraries raise any type
            log.exception("the kernels could not be compiled")
            health.degraded(
                f"its kernels cannot be compiled ({type(error).__name__}: {str(error)[:200]}); "
                f"tried again every {again_s:g} s; the log has the rest"
            )
        ending.wait(again_s)
    return False


def run_service(
    name: str, settings: ServiceSettings, build: Callable[[Bus, Health], Closeable]
) -> int:
    """Run a service until a signal stops it. Returns the exit status.

    `build` may raise HeliosError, whose text goes to standard error. The status is then 2 for
    InvalidInput (wrong settings, which a restart does not fix), else 1.
    """
    log_format.configure(name, settings.robot, settings.log_level, settings.log_format)
    stopped = threading.Event()
    stop_on_signals(stopped)
    try:
        spans = span_recording.start(name, settings.robot, settings.tracing)
    except InvalidInput as error:
        print(f"helios-{name}: {error.message}", file=sys.stderr)
        return 2
    try:
        return _run(name, settings, build, stopped)
    finally:
        if spans is not None:
            spans.close()


def _run(
    name: str,
    settings: ServiceSettings,
    build: Callable[[Bus, Health], Closeable],
    stopped: threading.Event,
) -> int:
    """Connect, run and report until `stopped`; see `run_service`."""
    health = Health()
    try:
        bus = _connect(name, settings, stopped)
    except InvalidInput as error:  # the certificates
        print(f"helios-{name}: {error.message}", file=sys.stderr)
        return 2
    if bus is None:
        return 0
    settings_json = json.dumps(settings.described())
    instance = f"{os.getpid()}-{uuid.uuid4().hex[:6]}"
    over = threading.Event()
    reporter = threading.Thread(
        target=_report, args=(bus, name, instance, health, over), name="report", daemon=True
    )
    service: Closeable | None = None
    try:
        bus.serve(settings_method(name), lambda _: pb.SettingsReply(json=settings_json))
        span_recording.serve(bus, name)
        bus.announce(name, instance)
        reporter.start()
        service = build(bus, health)
        stopped.wait()
        health.stopping()
        return 0
    except HeliosError as error:
        print(f"helios-{name}: {error.message}", file=sys.stderr)
        health.failed(error.message)
        return 2 if isinstance(error, InvalidInput) else 1
    except Exception as error:
        health.failed(f"a fault ended it ({type(error).__name__}: {str(error)[:200]}); see its log")
        raise
    finally:
        stopped.set()
        try:
            if service is not None:
                service.close()
        finally:
            over.set()
            health.changed.set()
            if reporter.is_alive():
                reporter.join(1.0)  # wait for the last report
            bus.close()


def _connect(name: str, settings: ServiceSettings, stopped: threading.Event) -> Bus | None:
    """Bus of the service; None if it is stopped before. Raises InvalidInput."""
    from helios_core.zenoh_bus import ZenohBus  # local import: tests of services need no Zenoh

    link, said = settings.router_link(name), False
    while not stopped.is_set():
        try:
            return ZenohBus(link, settings.robot)
        except Unavailable as error:
            if not said:
                log.warning("waiting for the router: %s", error.message)
                said = True
            stopped.wait(0.3)
    return None


def publish_status(
    bus: Bus,
    service: str,
    instance: str,
    published: tuple[str, str],
    metrics: Mapping[str, float],
    uptime_s: float = 0.0,
) -> None:
    """Publish the status of a service; published: (state, reason). A failure is only logged, since
    the next status repeats the content."""
    status = pb.ServiceStatus(
        service=service, instance=instance, state=published[0], reason=published[1],
        pid=os.getpid(), uptime_s=uptime_s, metrics=metrics,
    )  # fmt: skip
    try:
        bus.publish(status_topic(service), status)
    except HeliosError as error:
        log.warning("%s: could not report: %s", bus.robot, error.message)


def _report(bus: Bus, name: str, instance: str, health: Health, over: threading.Event) -> None:
    """Publish the status at every change, every second, and once at the end."""
    began, logged, last = time.monotonic(), ("", ""), False
    while not last:
        health.changed.clear()
        last = over.is_set()  # after `clear`, so that the wait below cannot miss the end
        state, reason = published = health.state
        if published != logged:
            log.info("%s%s", state, f": {reason}" if reason and reason != state else "")
            logged = published
        publish_status(bus, name, instance, published, health.metrics(), time.monotonic() - began)
        if not last:
            health.changed.wait(STATUS_PERIOD_S)
