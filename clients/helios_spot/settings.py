"""Settings of Spot: variables `HELIOS_SPOT_…` or the table `[spot]` of the settings file.

The name and the password are never flags: other users of the machine could read them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self

from helios_core.errors import InvalidInput
from helios_core.private_file import check_private
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field, SecretStr


class SpotSettings(ServiceSettings):
    """Everything that may differ from robot to robot and from place to place."""

    model_config = service_config("spot")

    host: str = Field(default="", description="name or address of the robot; flag `--spot-host`")
    port: int = Field(default=443, ge=1, le=65535, description="TCP port of the robot")
    ca_file: Path | None = Field(
        default=None, description="CA certificates to trust instead of those of the SDK"
    )
    username: str = Field(default="", description="user name")
    password: SecretStr = Field(default=SecretStr(""), description="password of that user")
    credentials_file: Path | None = Field(
        default=None, description="file with user name and password on its first two lines"
    )

    rpc_timeout_s: float = Field(
        default=3.0, gt=0, le=30, description="longest wait for a response of the robot"
    )
    command_s: float = Field(
        default=1.0,
        ge=0.3,
        le=3.0,
        description="a walk ends by itself after this unless renewed (four times as often)",
    )
    speed_m_s: float = Field(default=0.5, gt=0, le=1.0, description="fastest walk")
    turn_rad_s: float = Field(default=0.8, gt=0, le=1.5, description="fastest turn")
    arm_m_s: float = Field(default=0.5, gt=0, le=1.0, description="fastest motion of the hand")
    arm_rad_s: float = Field(default=1.5, gt=0, le=3.0, description="fastest rotation of the hand")
    blocked_s: float = Field(
        default=4.0, gt=0, description="a walk without progress for this long is blocked"
    )
    obstacle_padding_m: float = Field(
        default=0.1,
        ge=0,
        le=0.5,
        description="distance that the robot's own avoidance keeps from obstacles",
    )

    lease: Literal["acquire", "take"] = Field(
        default="acquire", description="acquire: only a free lease; take: also from another client"
    )
    estop: Literal["none", "endpoint"] = Field(
        default="none",
        description="none, or endpoint: replace the robot's e-stop configuration by ours, which "
        "needs its motors off",
    )
    estop_timeout_s: float = Field(
        default=9.0, ge=3, description="silence after which our e-stop endpoint trips"
    )
    power: Literal["on", "expect"] = Field(
        default="on", description="on: power the motors; expect: they must be on already"
    )
    power_timeout_s: float = Field(default=30.0, gt=0, description="longest wait for the motors")
    time_sync_s: float = Field(
        default=5.0, gt=0, description="longest wait for time synchronisation with the robot"
    )

    camera: Literal["hand", "frontleft", "frontright", "left", "right", "back"] = Field(
        default="hand", description="camera whose images build the maps"
    )
    min_depth_m: float = Field(
        default=0.25, ge=0, description="nearer depth is ignored: the gripper, or noise"
    )
    max_depth_m: float = Field(default=4.0, gt=0, description="farther depth is ignored")
    depth: Literal["sensor", "fill", "estimate"] = Field(
        default="sensor",
        description="sensor; fill: estimate where the sensor has none; estimate: estimate "
        "everywhere",
    )
    depth_estimator: str = Field(
        default="detector",
        description="detector (its setting depth), or package:callable (colour, Pinhole) -> depth "
        "in m",
    )
    depth_timeout_s: float = Field(
        default=15.0, gt=0, description="longest wait for estimated depth"
    )

    hand_forward_m: float = Field(
        default=0.5, description="distance of the hand ahead of the body's centre while looking"
    )
    hand_height_m: float = Field(
        default=1.15, gt=0, description="height of the hand above the floor while looking"
    )
    tilt_rad: float = Field(default=0.52, description="initial downward tilt of the hand camera")
    footprint_radius_m: float = Field(
        default=0.55,
        gt=0,
        description="radius of the disc around the body's centre that the maps use",
    )
    length_m: float = Field(
        default=1.1, gt=0, description="length of the walking body with its legs"
    )
    width_m: float = Field(default=0.5, gt=0, description="width of the walking body with its legs")
    reach_m: float = Field(default=1.0, gt=0, description="horizontal reach from the body's centre")
    walk_to_grasp: bool = Field(default=False, description="let the robot walk by itself to grasp")
    grasp_timeout_s: float = Field(default=30.0, gt=0, description="longest duration of a grasp")
    place_clearance_m: float = Field(
        default=0.12, gt=0, description="height above the surface from which the hand moves down"
    )

    @classmethod
    def read(cls, host: str = "", **given: Any) -> Self:
        """From the environment and the file; `host`, unless empty, and `given` go before both.

        Raises InvalidInput, naming the setting but never its value.
        """
        settings = super().read(**({"host": host} if host else {}), **given)
        if settings.estop == "endpoint" and settings.power == "expect":
            raise InvalidInput(
                "estop = endpoint is set up while the motors are off, and power = expect wants "
                "them on; set HELIOS_SPOT_POWER=on, or HELIOS_SPOT_ESTOP=none"
            )
        if not settings.host:
            raise InvalidInput("no robot is named; give --spot-host, or set HELIOS_SPOT_HOST")
        return settings

    def login(self) -> tuple[str, str]:
        """Name and password. Raises InvalidInput when there are none, or others may read them."""
        if self.credentials_file is not None:
            try:
                check_private(self.credentials_file)
                lines = self.credentials_file.read_text().splitlines()
            except (OSError, UnicodeDecodeError) as error:
                raise InvalidInput(
                    f"cannot read {self.credentials_file} ({error.__class__.__name__}); "
                    "HELIOS_SPOT_CREDENTIALS_FILE names it"
                ) from None
            if len(lines) < 2 or not lines[0] or not lines[1]:
                raise InvalidInput(
                    f"{self.credentials_file} must hold the name on its first line and the "
                    "password on its second"
                )
            return lines[0], lines[1]
        if not self.username or not self.password.get_secret_value():
            raise InvalidInput(
                "no login for Spot; set HELIOS_SPOT_USERNAME and HELIOS_SPOT_PASSWORD, or "
                "HELIOS_SPOT_CREDENTIALS_FILE"
            )
        return self.username, self.password.get_secret_value()
