"""Robots that one gateway serves, each with its bus and its current state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from helios_core.bus import Bus

from helios_gateway.bus_listener import RobotMonitor

API_ROOT = "/v1"  # root of the first robot's addresses
ROBOT_ROOT = "/v1/robots/{robot}"  # root of the named robot's addresses


@dataclass(frozen=True)
class RobotEndpoint:
    """One robot: its bus, and the state that the gateway keeps of it."""

    bus: Bus
    monitor: RobotMonitor


@dataclass(frozen=True)
class RobotRegistry:
    """Robots by name; the first one is the default."""

    robots: Mapping[str, RobotEndpoint]

    def not_ready_reasons(self) -> list[str]:
        """Reasons why a robot cannot do a task now, for every robot; empty if all can."""
        several = len(self.robots) > 1
        return [
            f"{name}: {reason}" if several else reason
            for name, served in self.robots.items()
            for reason in served.monitor.not_ready_reasons()
        ]

    def close(self) -> None:
        for served in self.robots.values():
            served.monitor.close()
