"""Settings of the gateway."""

from __future__ import annotations

from helios_core.settings import ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Where to listen and how much to take."""

    model_config = service_config("gateway")

    host: str = Field("127.0.0.1", description="address to listen on; beyond loopback at your risk")
    port: int = Field(8080, ge=0, le=65535, description="TCP port to listen on; 0: any free one")
    call_timeout_s: float = Field(5.0, gt=0, description="how long a service may take to answer")
    stop_timeout_s: float = Field(1.0, gt=0, description="the same for stop-now")
    tick_s: float = Field(0.5, gt=0, description="shortest time between two robot or map events")
    keepalive_s: float = Field(10.0, gt=0, description="longest silence on the event stream")
    silent_after_s: float = Field(
        5.0, gt=0, description="a service that has not reported for this long is degraded"
    )
    event_backlog: int = Field(
        1000, ge=1, description="events kept for viewers that were cut off, and held for slow ones"
    )
    max_viewers: int = Field(64, ge=1, description="event streams open at the same time")
    body_limit_bytes: int = Field(65536, ge=1, description="largest request body taken")
    picture_max_age_s: float = Field(
        2.0, gt=0, description="a map picture or list of objects older than this is made again"
    )
    boxes_hold_s: float = Field(
        1.0, gt=0, description="how long the last image with boxes stands in for a newer one"
    )
    jpeg_quality: int = Field(82, ge=1, le=100, description="quality of /v1/camera.jpg, 1 to 100")
