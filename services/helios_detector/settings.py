"""Settings of the detector."""

from __future__ import annotations

from helios_core.settings import RobotNames, ServiceSettings, service_config
from pydantic import Field


class Settings(ServiceSettings):
    """Flags of `python -m helios_detector`."""

    model_config = service_config("detector")

    detector: str = Field(
        default="simulated",
        description="simulated, ground-truth, onnx:FILE, transformers:ID or :FOLDER, or an outside "
        "package's name",
    )
    masks: str = Field(
        default="depth",
        description="from boxes of transformers: depth, or transformers:ID of a SAM 2",
    )
    depth: str = Field(
        default="none",
        description="depth from colour, for robots without usable depth: none, or transformers:ID "
        "of a Depth Pro or a metric Depth Anything",
    )
    depth_focal: str = Field(
        default="calibrated", description="what scales that depth: calibrated, or own (Depth Pro)"
    )
    unload_after_s: float = Field(
        default=0.0, ge=0, description="models leave the memory after this without work; 0: never"
    )
    by_similarity: bool = Field(
        default=False,
        description="a class that onnx does not know is found as the most similar one that it "
        "knows, by the text model of the scorer minilm",
    )
    device: str = Field(
        default="auto", description="of transformers models: auto, cpu, cuda, cuda:N, mps"
    )
    precision: str = Field(
        default="auto",
        description="of transformers models: auto (half on cuda), float32, float16, bfloat16",
    )
    scorer: str = Field(
        default="lexical",
        description="how images are scored against prompts: lexical, minilm, or transformers:ID "
        "of a BLIP-2, CLIP or SigLIP",
    )
    landmarks: str = Field(
        default="auto",
        description="what transformers detectors look for besides, to tell the place to a scorer "
        "of names: auto (furniture, if the scorer reads names), none, or names by comma",
    )
    score_head: str = Field(
        default="itc", description="of BLIP-2: itc (contrastive, the paper's) or itm (matching)"
    )
    threads: int = Field(default=1, ge=1, le=64, description="threads of one model run")
    robots: RobotNames = Field(
        default="",
        description="names by comma: serve all of them, in place of robot; several detectors with "
        "the same names share the work",
    )
    noise: str = Field(
        default="demo-v1", description="noise table of the simulated detector, or a file"
    )
    noise_seed: int = Field(default=0, description="seed of the simulated detector's errors")
    noise_level: float = Field(
        default=1.0,
        ge=0,
        le=10,
        description="multiplies how often and how much it errs; 0: not at all",
    )
    noise_correlation: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="1: no error is redrawn per frame, 0: all; unset: the table's",
    )
    truth_timeout_s: float = Field(
        default=3.0, gt=0, description="longest wait for the simulated world's truth of a frame"
    )
    preview_quality: int = Field(
        default=80, ge=1, le=100, description="JPEG quality of previews, percent"
    )
    retry_s: float = Field(
        default=2.0,
        gt=0,
        description="pause before a model that cannot load is retried; doubles to 60 s",
    )
