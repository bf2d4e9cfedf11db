"""Entry point of `python -m helios_replay`: the detector of a recording."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.service_process import Service, run_service

from helios_replay.recorded_detector import RecordedDetector
from helios_replay.settings import Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    return Service(
        "detector", settings, lambda bus, health: RecordedDetector(bus, settings.source, health)
    )


if __name__ == "__main__":
    sys.exit(run_service(service()))
