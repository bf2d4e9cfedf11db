"""Entry point `python -m helios_recorder`: loads the settings and runs the service."""

from __future__ import annotations

import sys

from helios_core.service_process import run_service

from helios_recorder.service import RecorderService
from helios_recorder.settings import Settings

if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(
        run_service(
            "recorder", settings, lambda bus, health: RecorderService(bus, settings, health)
        )
    )
