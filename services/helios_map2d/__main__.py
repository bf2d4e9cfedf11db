"""`python -m helios_map2d`: settings, session, run."""

from __future__ import annotations

import sys
import threading

from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.service import run_service, until_warm

from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings
from helios_map2d.warm_up import warm_up


class Hosted:
    """The maps, from the moment their kernels are compiled; a stop need not wait for that."""

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        self._ending = threading.Event()
        self._service: Map2DService | None = None
        settings.rules(robot_max_depth_m=settings.max_depth_m, robot_radius_m=0.3)

        def prepare() -> None:
            if until_warm(health, warm_up, self._ending) and not self._ending.is_set():
                self._service = Map2DService(bus, settings, health)

        health.waiting("compiling its kernels; a minute at the first start")
        threading.Thread(target=prepare, name="warm up", daemon=True).start()

    def close(self) -> None:
        self._ending.set()
        if self._service is not None:
            self._service.close()


if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(run_service("map2d", settings, lambda bus, health: Hosted(bus, health, settings)))
