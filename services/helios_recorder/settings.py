"""Settings of the recorder."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from helios_core.settings import ServiceSettings, service_config
from pydantic import Field

MB = 1_000_000


class Settings(ServiceSettings):
    """Flags of `python -m helios_recorder`."""

    model_config = service_config("recorder")

    out: Path = Field(default=Path("recordings"), description="folder of the recordings")
    rotate_mb: float = Field(
        default=2000, gt=0, description="a file that has grown to this is followed by the next"
    )
    rotate_min: float = Field(
        default=30, gt=0, description="a file that is this old is followed by the next, minutes"
    )
    compression: Literal["zstd", "lz4", "none"] = Field(
        default="zstd", description="of the chunks: zstd is smaller, lz4 and none cost less"
    )
    jpeg_quality: int = Field(
        default=90, ge=1, le=100, description="of the stream's colour; keyframes are lossless"
    )
    chunk_mb: float = Field(default=4, gt=0, le=64, description="size at which a chunk is written")
    flush_s: float = Field(
        default=1.0, gt=0, description="a chunk is written after this; more is lost by a SIGKILL"
    )
    sync_s: float = Field(
        default=5.0, gt=0, description="the disk is made to keep what it has at this pace"
    )
    map_period_s: float = Field(
        default=1.0,
        ge=0,
        description="the maps are recorded at most this often, seconds, and only when they have "
        "changed; 0: not at all",
    )
    map_timeout_s: float = Field(
        default=2.0, gt=0, description="longest wait for a map's answer; without one it is counted"
    )
    queue_mb: float = Field(
        default=256, gt=0, description="what waits to be written; beyond it messages are dropped"
    )
    min_free_mb: float = Field(
        default=500, ge=0, description="space on the disk that is left to others"
    )
    retry_s: float = Field(
        default=5.0, gt=0, description="pause before a disk that was full is tried again"
    )
