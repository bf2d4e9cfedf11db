"""Entry point `python -m helios_gateway`: load settings and keys, bind the socket, run."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput
from helios_core.service_process import Service, run_service

from helios_gateway.api_keys import ApiKeys
from helios_gateway.service import Gateway, bind, check_open
from helios_gateway.settings import Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Settings.load(argv)
    try:  # before waiting for the router: a port in use and missing keys fail at once
        listener = bind(settings.host, settings.port)
        keys = ApiKeys(settings.keys)
        check_open(listener.getsockname()[0], settings, keys)
    except HeliosError as error:
        print(f"helios-gateway: {error.message}", file=sys.stderr)
        sys.exit(2 if isinstance(error, InvalidInput) else 1)

    def another_bus(robot: str) -> Bus:
        from helios_core.zenoh_bus import ZenohBus

        return ZenohBus(settings.router_link("gateway"), robot)

    return Service(
        "gateway",
        settings,
        lambda bus, health: Gateway(bus, health, settings, listener, keys, another_bus),
    )


if __name__ == "__main__":
    sys.exit(run_service(service()))
