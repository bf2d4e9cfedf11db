"""Entry point of the world process: `python -m helios_sim --seed 0 --preset demo-v1`."""

from __future__ import annotations

import sys

from helios_core.service_process import run_service

from helios_sim.service import HostedWorld
from helios_sim.settings import Settings

if __name__ == "__main__":
    settings = Settings.load()
    sys.exit(run_service("world", settings, lambda bus, health: HostedWorld(bus, health, settings)))
