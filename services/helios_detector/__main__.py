"""Entry point of `python -m helios_detector`."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.bus_access import FLEET_BUS
from helios_core.health import Health
from helios_core.service_process import Closeable, Service, run_service

from helios_detector.detector_fleet import Fleet
from helios_detector.model_loading import check_plugins
from helios_detector.robot_detector import RobotDetector
from helios_detector.settings import Settings


def host(bus: Bus, health: Health, settings: Settings) -> Closeable:
    """Start the detector for one or several robots.

    Raises InvalidInput for a plug-in that cannot be imported, since a retry cannot help.
    """
    check_plugins(settings.detector, settings.scorer)
    return (Fleet if settings.robots else RobotDetector)(bus, health, settings)


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    if settings.robots:
        settings = settings.model_copy(update={"robot": FLEET_BUS})
    return Service("detector", settings, lambda bus, health: host(bus, health, settings))


if __name__ == "__main__":
    status = run_service(service())
    # Everything is closed. `os._exit` skips torch's teardown, which takes seconds.
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
