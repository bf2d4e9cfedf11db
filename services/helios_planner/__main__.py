"""Entry point of `python -m helios_planner`: loads the settings and runs the service."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.service_process import Service, run_service

from helios_planner.service import PlannerService
from helios_planner.settings import Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    return Service("planner", settings, lambda bus, health: PlannerService(bus, settings, health))


if __name__ == "__main__":
    sys.exit(run_service(service()))
