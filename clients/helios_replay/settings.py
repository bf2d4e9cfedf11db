"""Settings of the recorded detector."""

from __future__ import annotations

from pathlib import Path

from helios_core.settings import ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Flags of `python -m helios_replay`."""

    model_config = service_config("replay")

    source: Path = Field(description="the recording: an .mcap file, or a folder of them")
