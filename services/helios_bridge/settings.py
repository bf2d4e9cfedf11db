"""Settings of the bridge."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from helios_core.settings import ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Flags of `python -m helios_bridge`."""

    model_config = service_config("bridge")

    driver: str = Field(
        default="sim",
        description="sim, replay, spot, bus, push, or package:Class of your own driver",
    )
    address: str = Field(
        default="", description="where the robot is, for drivers that reach it over a network"
    )
    source: Path | None = Field(
        default=None, description="what a replay plays: a recording, a folder, a ROS bag"
    )
    limit: int = Field(default=0, ge=0, description="frames of a replay; 0: all")
    from_s: float = Field(default=0.0, ge=0, description="where a replay begins, seconds into it")
    to_s: float = Field(default=math.inf, gt=0, description="where a replay ends, seconds into it")
    rate: float = Field(
        default=0.0, ge=0, description="speed of a replay: 1 as it was recorded, 0 without waiting"
    )
    topics: str = Field(
        default="", description="topics of a ROS bag: color=/a,depth=/b,info=/c,pose=/d"
    )
    contexts: bool = Field(
        default=False, description="a replay begins the recorded searches by itself"
    )
    max_depth_m: float = Field(
        default=5.0, gt=0, le=100, description="of the driver push: depth beyond it is not used"
    )
    watch_threshold: float = Field(
        default=0.25,
        ge=0,
        le=1,
        description="of the driver push: detector confidence from which a class asked for counts",
    )
    strict: bool = Field(
        default=False,
        description="a replay ends at a frame that cannot be read, instead of leaving it out",
    )
    depth: Literal["sensor", "estimated"] = Field(
        default="sensor",
        description="where depth comes from: sensor, or estimated by the detector from colour (its "
        "setting depth), for robots without usable depth",
    )
    depth_timeout_s: float = Field(default=30.0, gt=0, description="longest wait for that depth")
    stream_hz: float = Field(
        default=2.0, ge=0, le=60, description="frames a second while standing; 0: off"
    )
    lockstep: bool = Field(
        default=False, description="send a keyframe when the maps have answered the last"
    )
    ack_timeout_s: float = Field(default=30.0, gt=0, description="longest wait for a map's answer")
    lease_s: float = Field(
        default=10.0, gt=0, description="a lease ends after this without an action"
    )
    stop_timeout_s: float = Field(
        default=0.8,
        gt=0,
        le=60,
        description="longest wait for the driver's stop; then it is said that the robot may move",
    )
    autoplay: bool = Field(
        default=True, description="play a recording by itself once the maps are ready"
    )
