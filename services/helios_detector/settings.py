"""Settings of the detector."""

from __future__ import annotations

from helios_core.settings import RobotNames, ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Flags of `python -m helios_detector`."""

    model_config = service_config("detector")

    detector: str = Field(
        default="simulated",
        description="simulated, ground-truth, onnx:FILE, transformers:ID or transformers:FOLDER, "
        "or the name of an installed plugin",
    )
    masks: str = Field(
        default="depth",
        description="masks from the boxes of transformers detectors: depth, or transformers:ID of "
        "a SAM 2 model",
    )
    depth: str = Field(
        default="none",
        description="depth from colour, for robots without usable depth: none, or transformers:ID "
        "of a Depth Pro or metric Depth Anything model",
    )
    depth_focal: str = Field(
        default="calibrated",
        description="focal length that scales this depth: calibrated, or own (Depth Pro's "
        "estimate)",
    )
    unload_after_s: float = Field(
        default=0.0, ge=0, description="unload idle models after this long; 0: never"
    )
    by_similarity: bool = Field(
        default=False,
        description="let an onnx detector report its most similar class for a class that it does "
        "not know (by the text model of scorer minilm)",
    )
    device: str = Field(
        default="auto", description="device of transformers models: auto, cpu, cuda, cuda:N or mps"
    )
    precision: str = Field(
        default="auto",
        description="number format of transformers models: auto (half on cuda), float32, float16 "
        "or bfloat16",
    )
    scorer: str = Field(
        default="lexical",
        description="image-text scorer: lexical, minilm, simulated or simulated:TABLE (the "
        "simulator's ground truth with errors), transformers:ID of a BLIP-2, CLIP or SigLIP model, "
        "or the name of an installed plugin",
    )
    landmarks: str = Field(
        default="auto",
        description="further classes for transformers detectors, as context for a scorer that "
        "reads names: auto (furniture, if the scorer needs it), none, or names separated by "
        "commas",
    )
    score_head: str = Field(
        default="itc",
        description="head of BLIP-2: itc (contrastive, as in the paper) or itm (matching)",
    )
    threads: int = Field(default=1, ge=1, le=64, description="CPU threads of one model run")
    robots: RobotNames = Field(
        default="",
        description="names of the robots to serve, separated by commas; detectors with the same "
        "names share the work",
    )
    noise: str = Field(
        default="demo-v1", description="noise table of the simulated detector: a name or a file"
    )
    noise_seed: int = Field(default=0, description="seed of the simulated detector's errors")
    noise_level: float = Field(
        default=1.0,
        ge=0,
        le=10,
        description="factor on rate and size of the simulated detector's errors; 0: none, but "
        "demo-v1 still misses things below 40 pixels",
    )
    noise_correlation: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="share of the simulated detector's errors that persist over frames, 0 to 1; "
        "unset: the table's",
    )
    retry_s: float = Field(
        default=2.0,
        gt=0,
        description="pause before a model that cannot load is tried again; doubles up to 60 s",
    )
