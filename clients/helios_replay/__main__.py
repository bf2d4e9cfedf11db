"""Entry point of `python -m helios_replay`: the detector of a recording."""

from __future__ import annotations

import sys

from helios_core.service_process import run_service

from helios_replay.recorded_detector import RecordedDetector
from helios_replay.settings import Settings

if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(
        run_service(
            "detector", settings, lambda bus, health: RecordedDetector(bus, settings.source, health)
        )
    )
