"""The robots that one gateway serves: each with a bus and what is known from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends
from helios_core.bus import Bus
from starlette.requests import HTTPConnection

from helios_gateway.bus_listener import BusListener
from helios_gateway.error_responses import NotFound


@dataclass(frozen=True)
class Served:
    """One robot."""

    bus: Bus
    live: BusListener


@dataclass(frozen=True)
class RobotRegistry:
    """By name, the first one is meant where none is named."""

    robots: Mapping[str, Served]

    @property
    def first(self) -> Served:
        return next(iter(self.robots.values()))

    def named(self, name: str) -> Served:
        """Raises NotFound."""
        if name not in self.robots:
            known = ", ".join(self.robots)
            raise NotFound(f"there is no robot {name[:80]!r} here; there are: {known}")
        return self.robots[name]

    def reasons(self) -> list[str]:
        """Why a task could not start now, on any of them."""
        several = len(self.robots) > 1
        return [
            f"{name}: {reason}" if several else reason
            for name, served in self.robots.items()
            for reason in served.live.reasons()
        ]

    def close(self) -> None:
        for served in self.robots.values():
            served.live.close()


async def _served(connection: HTTPConnection) -> Served:
    fleet: RobotRegistry = connection.app.state.fleet
    name = connection.path_params.get("robot")
    return fleet.first if name is None else fleet.named(name)


At = Annotated[Served, Depends(_served)]  # the robot that a request is about
