"""Entry point `python -m helios_bridge`: loads the settings and runs the service."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.errors import HeliosError, Unavailable
from helios_core.health import Health
from helios_core.service_process import Service, run_service

from helios_bridge.driver_executor import DriverExecutor
from helios_bridge.driver_loading import load_driver
from helios_bridge.service import END_WITHIN_S, BridgeService
from helios_bridge.settings import Settings

log = logging.getLogger(__name__)


class RobotHost:
    """Host of the bridge service, which it creates as soon as the robot is reachable."""

    def __init__(
        self, bus: Bus, health: Health, settings: Settings, executor: DriverExecutor
    ) -> None:
        self._ending = threading.Event()
        self._executor = executor
        self._service: BridgeService | None = None
        driver = load_driver(settings, bus)  # wrong settings end the process here

        def connect() -> None:
            while not self._ending.is_set():
                try:
                    service = BridgeService(bus, driver, settings, health, executor=executor)
                except Unavailable as error:
                    health.waiting(f"the robot cannot be reached: {error.message}")
                    self._ending.wait(0.3)
                    continue
                except HeliosError as error:  # no retry: the error would stay
                    health.degraded(error.message)
                    return
                except Exception as error:  # an internal error
                    log.exception("the bridge could not be created")
                    health.degraded(f"the bridge failed ({type(error).__name__}: {error})")
                    return
                self._service = service
                if not self._ending.is_set():
                    service.start()
                return

        executor.start("connect", connect)

    def close(self) -> None:
        self._ending.set()
        if self._service is None:  # `connect` may be creating it
            self._executor.wait(END_WITHIN_S)
        if self._service is not None:
            self._service.close()
        if hanging := self._executor.wait(0.0):
            log.error("abandoned, because the driver does not return: %s", ", ".join(hanging))


def service(argv: Sequence[str] | None = None, executor: DriverExecutor | None = None) -> Service:
    settings, jobs = Settings.load(argv), executor or DriverExecutor()
    return Service("bridge", settings, lambda bus, health: RobotHost(bus, health, settings, jobs))


def main() -> int:
    executor = DriverExecutor()
    status = run_service(service(executor=executor))
    if executor.wait(0.0):
        logging.shutdown()
        os._exit(status or 1)
    return status


if __name__ == "__main__":
    sys.exit(main())
