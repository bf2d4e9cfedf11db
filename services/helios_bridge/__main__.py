"""Entry point `python -m helios_bridge`: loads the settings and runs the service."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.errors import DeadlineExceeded, HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.service_process import Service, run_service

from helios_bridge.driver_executor import DriverExecutor
from helios_bridge.driver_loading import load_driver
from helios_bridge.service import END_WITHIN_S, STOP_AGAIN_S, BridgeService, close_driver
from helios_bridge.settings import Settings
from helios_bridge.stop_service import StopService

log = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.3  # between two attempts to create the service; it doubles after each fault
LONGEST_PAUSE_S = 30.0


class RobotHost:
    """Host of the bridge service, which it creates as soon as the robot is reachable. The stop is
    served from the start, and repeated until the robot confirms it."""

    def __init__(
        self, bus: Bus, health: Health, settings: Settings, executor: DriverExecutor
    ) -> None:
        self._ending = threading.Event()
        self._executor = executor
        self._service: BridgeService | None = None
        self._driver = load_driver(settings, bus)  # wrong settings end the process here
        self._stops = StopService(bus, self._driver, settings, health, executor)
        executor.start("connect", lambda: self._connect(bus, settings, health))

    def _connect(self, bus: Bus, settings: Settings, health: Health) -> None:
        """Create the service, again and again until the robot answers as it should. Only invalid
        input ends the attempts: it would stay."""
        pause_s = FIRST_PAUSE_S
        while not self._ending.is_set():
            again = f"the bridge tries again in {pause_s:g} s"
            self._stops.robot_stop.repeat()
            try:
                service = BridgeService(bus, self._driver, settings, health, stops=self._stops)
            except InvalidInput as error:
                health.degraded(error.message)
                return
            except Unavailable as error:  # the robot may be starting: the pause stays short
                health.waiting(f"the robot cannot be reached: {error.message}")
                self._pause(FIRST_PAUSE_S)
                continue
            except DeadlineExceeded as error:
                health.waiting(f"the robot answers too late: {error.message}; {again}")
            except HeliosError as error:
                health.degraded(f"{error.message}; {again}")
            except Exception as error:  # an internal error
                log.exception("the bridge could not be created")
                health.degraded(f"the bridge failed ({type(error).__name__}: {error}); {again}")
            else:
                self._service = service
                if not self._ending.is_set():
                    service.start()
                return
            self._pause(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    def _pause(self, seconds: float) -> None:
        """Wait; meanwhile repeat a stop that the robot has not confirmed."""
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0:
            if self._ending.wait(min(left_s, STOP_AGAIN_S)):
                return
            self._stops.robot_stop.repeat()

    def close(self) -> None:
        self._ending.set()
        if self._service is None:  # `connect` may be creating it
            self._executor.wait(END_WITHIN_S)
        if self._service is not None:
            self._service.close()
        else:
            close_driver(self._driver, self._executor)
        if hanging := self._executor.wait(0.0):
            log.error("abandoned, because they do not return: %s", ", ".join(hanging))


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
