"""Settings of the bridge."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from helios_core.heartbeat import SILENCE_S
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Flags of `python -m helios_bridge`."""

    model_config = service_config("bridge")

    driver: str = Field(
        default="sim",
        description="sim, replay, spot, ros2, bus, push, or package:Class of your own driver",
    )
    address: str = Field(
        default="", description="network address of the robot, for drivers that need one"
    )
    source: Path | None = Field(
        default=None, description="input of a replay: a recording, a folder or a ROS bag"
    )
    limit: int = Field(default=0, ge=0, description="most frames of a replay; 0: all")
    from_s: float = Field(
        default=0.0, ge=0, description="start of a replay after the recording's first frame"
    )
    to_s: float = Field(
        default=math.inf,
        gt=0,
        allow_inf_nan=True,
        description="end of a replay after the recording's first frame",
    )
    rate: float = Field(
        default=0.0,
        ge=0,
        description="speed of a replay: 1 for real time, 0 for as fast as possible",
    )
    topics: str = Field(
        default="", description="topics of a ROS bag: color=/a,depth=/b,info=/c,pose=/d"
    )
    contexts: bool = Field(
        default=False, description="a replay starts the recorded searches by itself"
    )
    max_depth_m: float = Field(
        default=5.0, gt=0, le=100, description="depth limit of uploaded frames, m (driver push)"
    )
    strict: bool = Field(
        default=False,
        description="a replay ends at an unreadable frame instead of skipping it",
    )
    depth: Literal["sensor", "estimated"] = Field(
        default="sensor",
        description="source of depth: sensor, or estimated from colour by the detector (its "
        "setting depth), for robots without usable depth",
    )
    depth_timeout_s: float = Field(
        default=30.0, gt=0, description="longest wait for estimated depth"
    )
    stream_hz: float = Field(
        default=2.0, ge=0, le=60, description="frames per second while the robot stands; 0: none"
    )
    lockstep: bool = Field(
        default=False,
        description="send a keyframe only after the maps have integrated the one before: for "
        "exact replays",
    )
    ack_timeout_s: float = Field(
        default=30.0, gt=0, description="longest wait for a map to integrate a keyframe"
    )
    lease_s: float = Field(
        default=10.0, gt=0, description="a lease expires after this long without an action"
    )
    heartbeat_s: float = Field(
        default=SILENCE_S,
        ge=0,
        le=60,
        description="an action of the planner ends when the planner is silent for this long; "
        "0: never",
    )
    stop_timeout_s: float = Field(
        default=0.8,
        gt=0,
        le=60,
        description="longest wait for the driver's stop; then the bridge reports that the "
        "robot may still move",
    )
    state_dir: Path | None = Field(
        default=None,
        description="folder that keeps a stop over restarts of the bridge; unset: keep nothing, "
        "for robots that keep their stop themselves",
    )
    checks: bool = Field(
        default=True,
        description="check the robot's set-up (camera pose, depth, times) with the first keyframes "
        "of every task",
    )
    autoplay: bool = Field(
        default=True, description="play a recording as soon as the maps are ready"
    )
