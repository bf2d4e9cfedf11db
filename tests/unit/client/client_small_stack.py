"""Run `helios up` with a real router and services that do nothing.

Usage: `client_small_stack.py PORT DIR PRESET`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from helios_client.supervision.child_process import ProcessSpec
from helios_client.supervision.service_specs import StackOptions, free_port
from helios_client.supervision.up import Screen, up
from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.health import Health
from helios_core.service_process import Service, run_service
from helios_core.settings import ServiceSettings

SLIPS = "detector"  # the service that reports "degraded"
WHY = "the detector mine gave in detect() a mask uint8 (4, 4)"


class IdleService:
    """A service that only reports ready or degraded."""

    def __init__(self, bus: Bus, health: Health, name: str) -> None:
        if name == SLIPS:
            health.degraded(WHY)
        else:
            health.ready()

    def close(self) -> None:
        return


class SmallStack(StackOptions):
    """The router, and services that depend on nothing else."""

    def processes(self) -> tuple[ProcessSpec, ...]:
        router, *_ = super().processes()
        flags = ("--router", self.router)
        bad = ("--no-such-flag",) if self.preset == "wrong" else ()
        return router, *(
            ProcessSpec(name, (sys.executable, __file__, "service", name, *flags, *bad))
            for name in ("map2d", SLIPS if self.preset == SLIPS else "gateway")
        )


def main() -> int:
    if sys.argv[1] == "service":
        name = sys.argv[2]
        settings = ServiceSettings.load(sys.argv[3:])
        build = lambda bus, health: IdleService(bus, health, name)  # noqa: E731
        return run_service(Service(name, settings, build))
    port, folder, preset = int(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    stack = SmallStack("sim", free_port(), folder, port=port, preset=preset)
    try:
        up(stack, Screen(width=200))
    except HeliosError as error:
        print(error.message, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
