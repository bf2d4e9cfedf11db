"""Settings of the gateway."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated

from helios_core.settings import RobotNames, ServiceSettings, service_config
from pydantic import AfterValidator, Field


def _networks(text: str) -> str:
    for one in _names(text):
        try:
            ipaddress.ip_network(one)
        except ValueError:
            raise ValueError(
                f"{one!r} is no IP address; give addresses or networks, such as 127.0.0.1"
            ) from None
    return text


Networks = Annotated[str, AfterValidator(_networks)]  # comma-separated; may be empty


class Settings(ServiceSettings):
    """Where to listen and how much to take."""

    model_config = service_config("gateway")

    host: str = Field(
        default="127.0.0.1", description="address to listen on; any but loopback requires API keys"
    )
    port: int = Field(
        default=8080, ge=0, le=65535, description="TCP port to listen on; 0: any free port"
    )
    robots: RobotNames = Field(
        default="", description="names of further robots on the same router, separated by commas"
    )
    keys: Path | None = Field(
        default=None,
        description="TOML file of API keys, made with `helios key`; none: no key is required",
    )
    without_keys: bool = Field(
        default=False,
        description="require no key on an address other than loopback: for a container whose port "
        "is published on loopback only",
    )
    audit: Path | None = Field(
        default=None,
        description="file for a record of every change over HTTP, as JSON lines, beside one of the "
        "requests without a key; none: no record",
    )
    faults: Path | None = Field(
        default=None,
        description="folder for the list of faults and the recordings around them; none: both are "
        "lost at the end, and nothing is recorded",
    )
    faults_mb: float = Field(
        default=500,
        gt=0,
        description="size of all recordings of one robot's faults; the oldest are removed, also "
        "where they take more than a quarter of the free disk",
    )
    fleet_queue: Path | None = Field(
        default=None,
        description="SQLite file of the tasks for any robot, which lets them outlive a restart; "
        "none: they are kept in memory",
    )
    origins: str = Field(
        default="",
        description="origins of other sites that may use the API (CORS), separated by commas",
    )
    proxies: Networks = Field(
        default="",
        description="IP addresses of reverse proxies whose X-Forwarded-For and X-Forwarded-Proto "
        "are believed, separated by commas",
    )
    call_timeout_s: float = Field(
        default=5.0, gt=0, description="longest wait for a service's response"
    )
    stop_timeout_s: float = Field(
        default=1.0, gt=0, description="longest wait for a response to a stop"
    )
    tick_s: float = Field(
        default=0.5,
        gt=0,
        description="shortest time between two events about the robot or the maps",
    )
    keepalive_s: float = Field(default=10.0, gt=0, description="longest silence on an event stream")
    silent_after_s: float = Field(
        default=5.0,
        gt=0,
        description="a service is degraded when it has not reported for this long",
    )
    max_viewers: int = Field(
        default=256, ge=1, description="most event streams open at the same time"
    )
    max_requests: int = Field(
        default=128,
        ge=1,
        description="most requests answered at the same time; stops are not counted",
    )
    max_connections: int = Field(
        default=1000,
        ge=1,
        description="most TCP connections open at the same time; beyond, every request returns "
        "503, also a stop",
    )
    requests_per_s: int = Field(
        default=500,
        ge=1,
        description="most requests per second of one client (API key or address); stops are not "
        "counted",
    )
    body_limit_bytes: int = Field(default=65536, ge=1, description="largest request body")
    frame_limit_bytes: int = Field(
        default=16_000_000,
        ge=1,
        description="largest uploaded frame, metadata and images together",
    )
    frame_idle_s: float = Field(
        default=30.0,
        gt=0,
        description="a WebSocket for frames closes after this long without a message",
    )
    map_limit_bytes: int = Field(default=500_000_000, ge=1, description="largest uploaded map file")
    body_timeout_s: float = Field(default=10.0, gt=0, description="longest time to receive a body")

    teleop_speed_m_s: float = Field(
        default=0.3, gt=0, le=2, description="fastest mean speed of teleoperation"
    )
    teleop_turn_rad_s: float = Field(
        default=0.6, gt=0, le=3, description="fastest mean turn of teleoperation"
    )
    teleop_hold_s: float = Field(
        default=0.3,
        gt=0,
        le=2,
        description="validity of a teleoperation command; the robot stops without a newer one",
    )
    teleop_idle_s: float = Field(
        default=30.0,
        gt=0,
        description="a WebSocket for teleoperation closes after this long without a message",
    )

    @property
    def other_robots(self) -> tuple[str, ...]:
        return _names(self.robots)

    @property
    def other_origins(self) -> tuple[str, ...]:
        return _names(self.origins)

    @property
    def trusted_proxies(self) -> tuple[str, ...]:
        return _names(self.proxies)


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
