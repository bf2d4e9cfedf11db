"""`python -m helios_detector`: settings, session, run."""

from __future__ import annotations

import logging
import os
import sys

from helios_core.service import run_service

from helios_detector.fleet import HOME, Fleet
from helios_detector.hosted import Hosted
from helios_detector.settings import Settings

if __name__ == "__main__":
    settings = Settings.load()
    if settings.robots:
        settings = settings.model_copy(update={"robot": HOME})
    host = Fleet if settings.robots else Hosted
    status = run_service("detector", settings, lambda bus, health: host(bus, health, settings))
    # Everything is closed. Taking torch apart would keep the process for seconds of work.
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
