"""Entry point `python -m helios_objectmap`: loads the settings and runs the service."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.service_process import Service, run_service

from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = ObjectMapSettings.load(argv)
    return Service("objectmap", settings, lambda bus, health: build(bus, health, settings))


def build(bus: Bus, health: Health, settings: ObjectMapSettings) -> ObjectMapService:
    """Service that reports ready once its kernels are compiled, in a thread so that it can stop."""
    running = ObjectMapService(bus, settings, health)
    health.waiting("compiling its kernels; takes a minute at the first start")
    threading.Thread(target=running.warm_up, name="warm up", daemon=True).start()
    return running


if __name__ == "__main__":
    sys.exit(run_service(service()))
