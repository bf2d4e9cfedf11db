"""Entry point `python -m helios_gateway`: load the settings, bind the socket, run the service."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.service_process import Service, run_service

from helios_gateway.service import Gateway, bind
from helios_gateway.settings import Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    try:  # before waiting for the router: a port in use fails at once
        listener = bind(settings.host, settings.port)
    except HeliosError as error:
        print(f"helios-gateway: {error.message}", file=sys.stderr)
        sys.exit(1)

    def another_bus(robot: str) -> Bus:
        from helios_core.zenoh_bus import ZenohBus

        return ZenohBus(settings.router_link("gateway"), robot)

    return Service(
        "gateway",
        settings,
        lambda bus, health: Gateway(bus, health, settings, listener, another_bus),
    )


if __name__ == "__main__":
    sys.exit(run_service(service()))
