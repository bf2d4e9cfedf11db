"""`python -m helios_detector`: settings, session, run."""

from __future__ import annotations

import sys

from helios_core.service import run_service

from helios_detector.hosted import Hosted
from helios_detector.settings import Settings

if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(run_service("detector", settings, lambda bus, health: Hosted(bus, health, settings)))
