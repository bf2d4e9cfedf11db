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
    rotate_mb: float = Field(default=2000, gt=0, description="size at which the next file begins")
    rotate_min: float = Field(default=30, gt=0, description="age at which the next file begins")
    compression: Literal["zstd", "lz4", "none"] = Field(
        default="zstd",
        description="compression of chunks: zstd is smaller, lz4 and none cost less time",
    )
    jpeg_quality: int = Field(
        default=90,
        ge=1,
        le=100,
        description="JPEG quality of stream frames, percent; keyframes are lossless",
    )
    chunk_mb: float = Field(default=4, gt=0, le=64, description="size at which a chunk is written")
    flush_s: float = Field(
        default=1.0,
        gt=0,
        description="age at which a chunk is written; a SIGKILL loses this much at most",
    )
    map_period_s: float = Field(
        default=1.0,
        ge=0,
        description="least time between two recordings of a changed map; 0: maps are not recorded",
    )
    queue_mb: float = Field(
        default=256,
        gt=0,
        description="size of the queue; messages beyond it are dropped and counted",
    )
    min_free_mb: float = Field(default=500, ge=0, description="disk space to leave free")
    retry_s: float = Field(default=5.0, gt=0, description="time until a full disk is tried again")
