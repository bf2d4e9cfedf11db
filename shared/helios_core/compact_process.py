"""Several services in one process: `python -m helios_core.compact_process SERVICES`.

SERVICES is a list of command lines in JSON: `[["helios_map2d", "--router", …], …]`. Each service
keeps its settings, its bus session with its own certificate, its status and its methods, so nobody
on the bus sees a difference. They share an interpreter and the libraries. If one ends, all end, and
the supervisor starts the process again.
"""

from __future__ import annotations

import importlib
import json
import logging
import os
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from helios_core import log_format, span_recording
from helios_core.errors import InvalidInput
from helios_core.service_process import Service, run_until
from helios_core.signal_handling import stop_on_signals

log = logging.getLogger(__name__)

PACKAGE = "helios_"
PROCESS = "services"  # name of this process in traces


class ServiceName(logging.Filter):
    """Adds the service of a record: by its logger, as in `helios_map2d.service`, or that of its
    thread."""

    def filter(self, record: logging.LogRecord) -> bool:
        package = record.name.partition(".")[0]
        is_service = package.startswith(PACKAGE) and package != "helios_core"
        record.service = package.removeprefix(PACKAGE) if is_service else record.threadName
        return True


def main(command_lines: Sequence[Sequence[str]]) -> int:
    """Run the services until a signal, or until one of them ends. Returns the exit status."""
    stopped = threading.Event()
    stop_on_signals(stopped)
    services = [_loaded(module, argv) for module, *argv in command_lines]
    shared = services[0].settings  # the supervisor gives all the same robot, log form and tracing
    log_format.configure(ServiceName(), shared.robot, "INFO", shared.log_format)
    try:
        spans = span_recording.start(PROCESS, shared.robot, shared.tracing)
    except InvalidInput as error:
        print(f"helios: {error.message}", file=sys.stderr)
        return 2
    for service, (module, *_) in zip(services, command_lines, strict=True):
        logging.getLogger(module).setLevel(service.settings.log_level.upper())
    with ThreadPoolExecutor(len(services)) as pool:
        ends = [pool.submit(_run, service, stopped) for service in services]
    if spans is not None:
        spans.close()
    return _status(ends)


def _loaded(module: str, argv: Sequence[str]) -> Service:
    """Service of a module. Exits with its status if the settings are wrong."""
    return importlib.import_module(f"{module}.__main__").service(argv)


def _run(service: Service, stopped: threading.Event) -> int:
    threading.current_thread().name = service.name
    return run_until(service, stopped)


def _status(ends: Sequence[Future[int]]) -> int:
    """Status of the first service that failed, else 0."""
    for end in ends:
        if error := end.exception():
            log.critical("a service ended by a fault, and all with it", exc_info=error)
            return 1
        if status := end.result():
            return status
    return 0


if __name__ == "__main__":
    status = main(json.loads(sys.argv[1]))
    # Everything is closed. A thread that hangs in a driver or a library must not hold the process.
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
