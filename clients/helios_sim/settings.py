"""Settings of the simulated world."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from helios_core.errors import InvalidInput
from helios_core.heartbeat import SILENCE_S
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field, field_validator

from helios_sim.home import PRESETS
from helios_sim.injected_faults import Faults
from helios_sim.manipulation import PickRule
from helios_sim.sensor_noise import SENSORS


class Settings(ServiceSettings):
    """Flags of `python -m helios_sim`."""

    model_config = service_config("world")

    seed: int = Field(0, ge=0, description="seed of the home")
    preset: str = Field("demo-v1", description="kind of home")
    task_seed: int | None = Field(
        None, ge=0, description="seed of the task in it; unset: the home's"
    )

    sensor: str = Field("none", description="sensor noise of images and poses: none or realistic")

    faults: str = Field(
        "",
        description="faults of the robot's set-up to inject, such as pitch_deg=2,delay_ms=40 "
        "(docs/how-to/check-your-robot.md)",
    )

    pick_rule: PickRule = Field(
        "physical",
        description="which object a pick takes: physical (the one at the point, of any class) or "
        "ovmm (of the sought class, in reach and in view, the one nearest to the point)",
    )

    start_seed: int | None = Field(
        None, ge=0, description="seed of a random start pose; unset: the home's own start"
    )
    pose_origin: Literal["home", "start"] = Field(
        "home",
        description="origin of the robot's poses: the home's, or the start pose, as of wheel "
        "odometry",
    )

    pace: float = Field(
        0.0,
        ge=0,
        description="simulated seconds per second of a drive: 1 for the speed of a real robot, 0 "
        "for as fast as possible",
    )

    heartbeat_s: float = Field(
        SILENCE_S,
        ge=0,
        le=60,
        description="a drive ends when the bridge is silent for this long; 0: never",
    )

    furniture: Literal["parametric", "realistic"] = Field(
        "parametric",
        description="shapes of furniture: parametric, or realistic (models baked by `helios "
        "assets bake`)",
    )

    home: Path | None = Field(
        None, description="plan of the home, a .sh3d file, instead of a preset"
    )
    level: str = Field("", description="level of the plan; empty: the one with the most rooms")

    @field_validator("sensor")
    @classmethod
    def _sensor_known(cls, sensor: str) -> str:
        if sensor not in SENSORS:
            raise ValueError(f"no such sensor; choose one of {', '.join(sorted(SENSORS))}")
        return sensor

    @field_validator("faults")
    @classmethod
    def _faults_known(cls, faults: str) -> str:
        try:
            Faults.of(faults)
        except InvalidInput as error:
            raise ValueError(error.message) from None
        return faults

    @field_validator("preset")
    @classmethod
    def _known(cls, preset: str) -> str:
        if preset not in PRESETS:
            raise ValueError(f"no such preset; choose one of {', '.join(sorted(PRESETS))}")
        return preset
