"""Entry point of the 2D map service: `python -m helios_map2d`."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.service_process import Service, run_service, until_warm

from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings
from helios_map2d.warm_up import warm_up

log = logging.getLogger(__name__)


class MapHost:
    """Host that compiles the kernels in a thread and then starts the service.

    `close` does not wait for the compilation. If the service cannot start, the process ends: its
    supervisor starts another one.
    """

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        self._bus, self._health, self._settings = bus, health, settings
        self._ending = threading.Event()
        self._service: Map2DService | None = None
        # Invalid settings end the process here, not only when the robot's description arrives.
        settings.rules(robot_max_depth_m=settings.max_depth_m, robot_radius_m=0.3)
        health.waiting("compiling its kernels; takes a minute at the first start")
        threading.Thread(target=self._start, name="warm up", daemon=True).start()

    def close(self) -> None:
        self._ending.set()
        if self._service is not None:
            self._service.close()

    def _start(self) -> None:
        try:
            if until_warm(self._health, warm_up, self._ending) and not self._ending.is_set():
                self._service = Map2DService(self._bus, self._settings, self._health)
        except Exception as error:
            if self._ending.is_set():
                return
            said = f"the maps could not be started ({type(error).__name__}: {str(error)[:200]})"
            self._health.failed(f"{said}; see the log of map2d")
            log.critical("%s, and map2d ends with them", said, exc_info=error)
            logging.shutdown()
            os._exit(1)


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    return Service("map2d", settings, lambda bus, health: MapHost(bus, health, settings))


if __name__ == "__main__":
    sys.exit(run_service(service()))
