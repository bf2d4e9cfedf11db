"""Entry point of the world process: `python -m helios_sim --seed 0 --preset demo-v1`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.service_process import Service, run_service

from helios_sim.service import HostedWorld
from helios_sim.settings import Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    return Service("world", settings, lambda bus, health: HostedWorld(bus, health, settings))


if __name__ == "__main__":
    sys.exit(run_service(service()))
