"""Settings of the gateway."""

from __future__ import annotations

from pathlib import Path

from helios_core.settings import RobotNames, ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Where to listen and how much to take."""

    model_config = service_config("gateway")

    host: str = Field(
        default="127.0.0.1", description="address to listen on; beyond loopback API keys are asked"
    )
    port: int = Field(
        default=8080, ge=0, le=65535, description="TCP port to listen on; 0: any free one"
    )
    robots: RobotNames = Field(
        default="", description="further robots on the same router, by name, commas between"
    )
    keys: Path | None = Field(
        default=None, description="TOML file of API keys, made with helios key; none: no key asked"
    )
    without_keys: bool = Field(
        default=False,
        description="ask for no key although the address is not loopback: in a container whose "
        "port is published on loopback alone",
    )
    origins: str = Field(
        default="",
        description="other sites whose pages may use the interface (CORS), commas between",
    )
    call_timeout_s: float = Field(
        default=5.0, gt=0, description="how long a service may take to answer"
    )
    stop_timeout_s: float = Field(default=1.0, gt=0, description="the same for stop-now")
    tick_s: float = Field(
        default=0.5, gt=0, description="shortest time between two robot or map events"
    )
    keepalive_s: float = Field(
        default=10.0, gt=0, description="longest silence on the event stream"
    )
    silent_after_s: float = Field(
        default=5.0, gt=0, description="a service that has not reported for this long is degraded"
    )
    event_backlog: int = Field(
        default=1000,
        ge=1,
        description="events kept for viewers that were cut off, and held for slow ones",
    )
    max_viewers: int = Field(default=256, ge=1, description="event streams open at the same time")
    max_requests: int = Field(
        default=128, ge=1, description="requests answered at the same time; stop-now is not counted"
    )
    max_connections: int = Field(
        default=1000, ge=1, description="TCP connections open at the same time"
    )
    requests_per_s: int = Field(
        default=500,
        ge=1,
        description="of one client (an API key or an address); stop-now is not counted",
    )
    body_limit_bytes: int = Field(default=65536, ge=1, description="largest request body taken")
    frame_limit_bytes: int = Field(
        default=16_000_000, ge=1, description="the same of a frame: meta and images together"
    )
    frame_idle_s: float = Field(
        default=30.0,
        gt=0,
        description="a socket for frames without a message for so long is closed",
    )
    map_limit_bytes: int = Field(
        default=500_000_000, ge=1, description="the same of a file of maps that is loaded"
    )
    body_timeout_s: float = Field(
        default=10.0, gt=0, description="longest time for a body to arrive"
    )
    picture_max_age_s: float = Field(
        default=2.0,
        gt=0,
        description="a map picture or list of objects older than this is made again",
    )
    boxes_hold_s: float = Field(
        default=1.0,
        gt=0,
        description="how long the last image with boxes stands in for a newer one",
    )
    jpeg_quality: int = Field(
        default=82, ge=1, le=100, description="quality of /v1/camera.jpg, 1 to 100"
    )

    teleop_speed_m_s: float = Field(
        default=0.3, gt=0, le=2, description="fastest driving by hand, on average"
    )
    teleop_turn_rad_s: float = Field(
        default=0.6, gt=0, le=3, description="fastest turning by hand, on average"
    )
    teleop_hold_s: float = Field(
        default=0.3,
        gt=0,
        le=2,
        description="a command to drive counts for so long; without a newer one the robot stands",
    )
    teleop_idle_s: float = Field(
        default=30.0,
        gt=0,
        description="a socket for driving without a message for so long is closed",
    )

    @property
    def other_robots(self) -> tuple[str, ...]:
        return _names(self.robots)

    @property
    def other_origins(self) -> tuple[str, ...]:
        return _names(self.origins)


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
