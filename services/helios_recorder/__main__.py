"""Entry point `python -m helios_recorder`: loads the settings and runs the service."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.service_process import Service, run_service

from helios_recorder.service import RecorderService
from helios_recorder.settings import Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    return Service("recorder", settings, lambda bus, health: RecorderService(bus, settings, health))


if __name__ == "__main__":
    sys.exit(run_service(service()))
