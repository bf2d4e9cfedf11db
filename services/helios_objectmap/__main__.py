"""Entry point `python -m helios_objectmap`: loads the settings and runs the service."""

from __future__ import annotations

import sys
import threading

from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.service_process import run_service

from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings


def build(bus: Bus, health: Health) -> ObjectMapService:
    """Service that reports ready once its kernels are compiled, in a thread so that it can stop."""
    service = ObjectMapService(bus, settings, health)
    health.waiting("compiling its kernels; takes a minute at the first start")
    threading.Thread(target=service.warm_up, name="warm up", daemon=True).start()
    return service


if __name__ == "__main__":
    settings = ObjectMapSettings.load()
    sys.exit(run_service("objectmap", settings, build))
