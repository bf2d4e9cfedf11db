"""Settings of Spot: variables `HELIOS_SPOT_…` or the table `[spot]` of the settings file.

The name and the password are never flags: other users of the machine could read them.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Literal, Self

from helios_core.errors import InvalidInput
from helios_core.settings import ServiceSettings, service_config
from pydantic import Field, SecretStr, ValidationError


class SpotSettings(ServiceSettings):
    """Everything that may differ from robot to robot and from place to place."""

    model_config = service_config("spot")

    host: str = Field(default="", description="name or address of the robot; `--spot-host`")
    port: int = Field(default=443, ge=1, le=65535, description="its port")
    ca_file: Path | None = Field(
        default=None, description="certificates to trust in place of the SDK's own"
    )
    username: str = Field(default="", description="who logs in")
    password: SecretStr = Field(default=SecretStr(""), description="of that user")
    credentials_file: Path | None = Field(
        default=None, description="file with the name and the password on its first two lines"
    )

    rpc_timeout_s: float = Field(default=3.0, gt=0, le=30, description="longest wait for an answer")
    command_s: float = Field(
        default=1.0, ge=0.3, le=3.0,
        description="a walk ends by itself after this unless renewed; renewed four times as often",
    )  # fmt: skip
    speed_m_s: float = Field(default=0.5, gt=0, le=1.0, description="fastest walk")
    turn_rad_s: float = Field(default=0.8, gt=0, le=1.5, description="fastest turn")
    arm_m_s: float = Field(default=0.5, gt=0, le=1.0, description="fastest hand")
    arm_rad_s: float = Field(default=1.5, gt=0, le=3.0, description="fastest turn of the hand")
    blocked_s: float = Field(
        default=4.0, gt=0, description="a walk without progress for so long is blocked"
    )
    obstacle_padding_m: float = Field(
        default=0.1, ge=0, le=0.5, description="kept to obstacles by the robot's own avoidance"
    )

    lease: Literal["acquire", "take"] = Field(
        default="acquire", description="take: also from somebody who holds it"
    )
    estop: Literal["none", "endpoint"] = Field(
        default="none",
        description="endpoint: replace the robot's e-stop configuration by one of ours",
    )
    estop_timeout_s: float = Field(
        default=9.0, ge=3, description="silence after which our e-stop endpoint trips"
    )
    power: Literal["on", "expect"] = Field(
        default="on", description="expect: the motors must be on already"
    )
    power_timeout_s: float = Field(default=30.0, gt=0, description="longest wait for the motors")
    time_sync_s: float = Field(default=5.0, gt=0, description="longest wait for the robot's clock")

    camera: Literal["hand", "frontleft", "frontright", "left", "right", "back"] = Field(
        default="hand", description="whose images the maps are made from"
    )
    jpeg_quality: int = Field(default=90, ge=1, le=100, description="of colour images, percent")
    min_depth_m: float = Field(default=0.25, ge=0, description="nearer is the gripper, or noise")
    max_depth_m: float = Field(default=4.0, gt=0, description="further is not believed")
    depth: Literal["sensor", "fill", "estimate"] = Field(
        default="sensor",
        description="fill: an estimator where the sensor has none; estimate: the estimator alone",
    )
    depth_estimator: str = Field(
        default="detector",
        description="the detector (its setting depth), or package:callable (colour, Pinhole) -> m",
    )
    depth_timeout_s: float = Field(default=15.0, gt=0, description="longest wait for the detector")

    hand_forward_m: float = Field(
        default=0.5, description="hand while looking, ahead of the body's middle"
    )
    hand_height_m: float = Field(default=1.15, gt=0, description="hand while looking, above ground")
    tilt_rad: float = Field(default=0.52, description="its first tilt, down")
    footprint_radius_m: float = Field(
        default=0.55, gt=0, description="of a disc around the body's middle that stands for it"
    )
    length_m: float = Field(default=1.1, gt=0, description="of the body with its legs, walking")
    width_m: float = Field(default=0.5, gt=0, description="likewise; the planner turns it to fit")
    reach_m: float = Field(default=1.0, gt=0, description="body's middle to a thing, on the ground")
    walk_to_grasp: bool = Field(
        default=False, description="let the robot walk by itself while it grasps"
    )
    grasp_timeout_s: float = Field(default=30.0, gt=0, description="longest grasp")
    place_clearance_m: float = Field(
        default=0.12, gt=0, description="height over the place from which the hand goes down"
    )

    @classmethod
    def read(cls, host: str = "") -> Self:
        """From the environment and the file; `host` goes before both.

        Raises InvalidInput, naming the setting but never its value.
        """
        try:
            settings = cls(host=host) if host else cls()
        except ValidationError as error:
            wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
            raise InvalidInput(f"wrong setting of Spot: {wrong}") from None
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise InvalidInput(f"cannot read the settings of Spot: {error}") from None
        if not settings.host:
            raise InvalidInput("no robot is named; give --spot-host, or set HELIOS_SPOT_HOST")
        return settings

    def login(self) -> tuple[str, str]:
        """Name and password. Raises InvalidInput when there are none."""
        if self.credentials_file is not None:
            try:
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
