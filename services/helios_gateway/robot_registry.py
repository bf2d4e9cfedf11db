"""The robots that one gateway serves: each with a bus and what is known from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from helios_core.bus import Bus

from helios_gateway.bus_listener import BusListener

API_ROOT = "/v1"  # below it is the first robot
ROBOT_ROOT = "/v1/robots/{robot}"  # below it is the robot of this name


@dataclass(frozen=True)
class Served:
    """One robot: its bus, and what the gateway keeps of it."""

    bus: Bus
    live: BusListener


@dataclass(frozen=True)
class RobotRegistry:
    """Robots by name; the first one is the default."""

    robots: Mapping[str, Served]

    def reasons(self) -> list[str]:
        """Why a task could not start now, for every robot; empty when it could on all."""
        several = len(self.robots) > 1
        return [
            f"{name}: {reason}" if several else reason
            for name, served in self.robots.items()
            for reason in served.live.reasons()
        ]

    def close(self) -> None:
        for served in self.robots.values():
            served.live.close()
