"""Life cycle of a service process: connect, announce, run, report, stop cleanly on SIGTERM.

    def service() -> Service:
        return Service("map2d", Settings.load(), build)

    def build(bus: Bus, health: Health) -> Closeable: ...

    if __name__ == "__main__":
        sys.exit(run_service(service()))

The process waits for its router without a time limit and logs that. It ends within two seconds of
SIGTERM, SIGINT or SIGHUP, or of the end of its parent process.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from helios_core import log_format, span_recording
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.settings import ServiceSettings
from helios_core.signal_handling import stop_on_signals
from helios_core.topics import settings_method, status_topic

log = logging.getLogger(__name__)

STATUS_PERIOD_S = 1.0


class Closeable(Protocol):
    """Running service, as `build` returns it."""

    def close(self) -> None: ...


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


@dataclass(frozen=True)
class Service:
    """What a service needs to run: its name, its settings and its constructor.

    `build` may raise HeliosError, whose text goes to standard error. The exit status is then 2 for
    InvalidInput (wrong settings, which a restart does not fix), else 1.
    """

    name: str
    settings: ServiceSettings
    build: Callable[[Bus, Health], Closeable]


def run_service(service: Service) -> int:
    """Run a service until a signal stops it. Returns the exit status."""
    s = service.settings
    log_format.configure(service.name, s.robot, s.log_level, s.log_format)
    stopped = threading.Event()
    stop_on_signals(stopped)
    try:
        spans = span_recording.start(service.name, s.robot, s.tracing)
    except InvalidInput as error:
        print(f"helios-{service.name}: {error.message}", file=sys.stderr)
        return 2
    try:
        return run_until(service, stopped)
    finally:
        if spans is not None:
            spans.close()


def run_until(service: Service, stopped: threading.Event) -> int:
    """Run a service in this thread until `stopped` is set. Returns its exit status, or raises what
    ended it; sets `stopped` in any case."""
    try:
        bus = _connect(service.name, service.settings, stopped)
        return 0 if bus is None else _run_on(bus, service, stopped)
    except InvalidInput as error:  # the endpoint, or the certificates
        print(f"helios-{service.name}: {error.message}", file=sys.stderr)
        return 2
    finally:
        stopped.set()


def _run_on(bus: Bus, service: Service, stopped: threading.Event) -> int:
    name, settings, health = service.name, service.settings, Health()
    settings_json = json.dumps(settings.described())
    instance = f"{os.getpid()}-{uuid.uuid4().hex[:6]}"
    over = threading.Event()
    reporter = threading.Thread(
        target=_report, args=(bus, name, instance, health, over), name="report", daemon=True
    )
    running: Closeable | None = None
    try:
        bus.serve(settings_method(name), lambda _: pb.SettingsReply(json=settings_json))
        span_recording.serve(bus, name)
        bus.announce(name, instance)
        reporter.start()
        running = service.build(bus, health)
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
        try:
            if running is not None:
                running.close()
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
        service=service,
        instance=instance,
        state=published[0],
        reason=published[1],
        pid=os.getpid(),
        uptime_s=uptime_s,
        metrics=metrics,
    )
    try:
        bus.publish(status_topic(service), status)
    except HeliosError as error:
        log.warning("%s: could not report: %s", bus.robot, error.message)


def _report(bus: Bus, name: str, instance: str, health: Health, over: threading.Event) -> None:
    """Publish the status at every change, every second, and once at the end."""
    began, logged, last = time.monotonic(), ("", ""), False
    log = logging.getLogger(f"helios_{name}")  # names the service where several share a process
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
