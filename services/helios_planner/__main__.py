"""Entry point of `python -m helios_planner`: loads the settings and runs the service."""

from __future__ import annotations

import sys

from helios_core.service_process import run_service

from helios_planner.service import PlannerService
from helios_planner.settings import Settings

if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(
        run_service("planner", settings, lambda bus, health: PlannerService(bus, settings, health))
    )
