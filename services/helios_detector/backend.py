"""What a detector and a scorer are to the service, and how one is chosen by a setting.

    simulated              the simulator's truth through seeded noise
    ground-truth           the simulator's truth as it is
    onnx:FILE              a YOLOX model of a fixed vocabulary: COCO's, or its own (onnx_names.py)
    transformers:ID        a text-prompted model of the hub or of a folder (docs/models.md)
    NAME or NAME:ARGUMENT  an outside package's entry point in the group `helios.detectors`

An outside package's entry point is a callable `(argument: str, options: DetectorOptions) ->
DetectorBackend`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import Detection, Embedding, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.truth import TruthSource

ENTRY_POINTS = "helios.detectors"
SCORER_ENTRY_POINTS = "helios.scorers"


@dataclass(frozen=True)
class Seen:
    """A class that the detector believes to be in the image, asked for or not."""

    class_name: str
    score: float


@dataclass(frozen=True)
class Findings:
    """All that a detector made of one frame."""

    detections: tuple[Detection, ...]  # of the classes asked for, under the names asked for
    seen: tuple[Seen, ...]  # of every class it knows


@dataclass(frozen=True)
class Judgement:
    """All that a scorer made of one frame."""

    scores: dict[str, float]  # value layer -> score of 0 to 1
    image: Embedding | None = None  # by which a new prompt can be scored later


@dataclass(frozen=True)
class TextEmbeddings:
    """Prompts as a scorer's model sees them; `helios_core.embeddings.fit` compares."""

    texts: tuple[Embedding, ...]
    scale: float
    offset: float


class DetectorBackend(ABC):
    """Finds things in a frame. Calls may come from several threads at once."""

    name: str

    @abstractmethod
    def vocabulary(self) -> tuple[str, ...] | None:
        """All names it knows; None when any name may be asked for."""

    @abstractmethod
    def refused(self, context: SearchContext) -> Mapping[str, str]:
        """Asked class name -> why it cannot be found, in a sentence; empty when all can."""

    @abstractmethod
    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        """Raises InvalidInput when a class of the context cannot be found."""

    @abstractmethod
    def warm_up(self) -> None:
        """Make the first frame as fast as the others. Raises Unavailable when it cannot work."""

    def unload(self) -> None:  # noqa: B027 - nothing to free is the common case
        """Free the memory of its models; the next call loads them again."""

    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory since the last call; 0 without one."""
        return 0.0

    @abstractmethod
    def close(self) -> None:
        """Free what it holds. Idempotent."""


class ScorerBackend(ABC):
    """Says how well an image fits a prompt. Calls may come from several threads at once."""

    name: str
    reads_names = False  # scores what the detector reports instead of the image

    @abstractmethod
    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        """Value layer -> score of 0 to 1 for its prompt, all layers in one pass."""

    def judge(self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]) -> Judgement:
        """Scores, and the image's embedding where the model makes one."""
        return Judgement(self.score(frame, seen, prompts))

    def embed_text(self, prompts: Sequence[str]) -> TextEmbeddings:
        """Raises InvalidInput for a scorer that has no embeddings."""
        raise InvalidInput(
            f"the scorer {self.name} looks at no image and has no embeddings; set scorer to "
            "transformers:ID"
        )

    @abstractmethod
    def warm_up(self) -> None:
        """Make the first frame as fast as the others. Raises Unavailable when it cannot work."""

    def unload(self) -> None:  # noqa: B027 - nothing to free is the common case
        """Free the memory of its models; the next call loads them again."""

    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory since the last call; 0 without one."""
        return 0.0

    @abstractmethod
    def close(self) -> None:
        """Free what it holds. Idempotent."""


@dataclass(frozen=True)
class DepthEstimate:
    """Depth of one image from its colour."""

    depth_m: NDArray[np.float32]  # [h, w] along the optical axis; 0 is invalid
    focal_px: float  # by which it was scaled


class DepthBackend(ABC):
    """Makes depth of colour. Calls may come from several threads at once."""

    name: str

    @abstractmethod
    def estimate(self, color: NDArray[np.uint8], focal_px: float | None) -> DepthEstimate:
        """`focal_px` is the calibrated one. Raises InvalidInput when it is needed and missing."""

    @abstractmethod
    def warm_up(self) -> None:
        """Make the first frame as fast as the others. Raises Unavailable when it cannot work."""

    @abstractmethod
    def unload(self) -> None:
        """Free the memory of its model; the next call loads it again."""

    @abstractmethod
    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory since the last call; 0 without one."""

    @abstractmethod
    def close(self) -> None:
        """Free what it holds. Idempotent."""


@dataclass(frozen=True)
class DetectorOptions:
    """What a back end may need besides its own argument."""

    truth: TruthSource | None = None  # simulator only
    threads: int = 1
    noise: str = "demo-v1"  # a table of `noise_tables/` or a path
    noise_seed: int = 0
    noise_level: float = 1.0
    noise_correlation: float | None = None  # None: as in the table
    device: str = "auto"  # of transformers models: auto, cpu, cuda, cuda:N, mps
    precision: str = "auto"  # auto: half on cuda; float32, float16, bfloat16
    masks: str = "depth"  # from boxes: by depth, or transformers:ID of a SAM 2
    by_similarity: bool = False  # a fixed vocabulary stands in with its most similar name
    score_head: str = "itc"  # of BLIP-2: itc (the paper's) or itm
    landmarks: tuple[str, ...] = ()  # an open vocabulary looks for these too, to tell the place


def open_detector(spec: str, options: DetectorOptions) -> DetectorBackend:
    """The back end that a setting names. Raises InvalidInput (wrong setting) or Unavailable."""
    kind, _, argument = spec.partition(":")
    if kind in ("simulated", "ground-truth") and not argument:
        from helios_detector.ground_truth import GroundTruthDetector
        from helios_detector.noise import NoiseTable, load_noise
        from helios_detector.simulated import SimulatedDetector
        from helios_detector.view_simulated import ViewDetector

        if options.truth is None:
            raise InvalidInput(f"detector {spec!r} needs the simulator's truth; none was given")
        if kind == "ground-truth":
            return GroundTruthDetector(options.truth)
        table = load_noise(options.noise).scaled(options.noise_level, options.noise_correlation)
        if isinstance(table, NoiseTable):
            return SimulatedDetector(options.truth, table, options.noise_seed)
        return ViewDetector(options.truth, table, options.noise_seed)
    if kind == "onnx" and argument:
        from helios_detector.yolox import YoloxDetector

        return YoloxDetector(Path(argument), options.threads, options.by_similarity)
    if kind == "transformers" and argument:
        from helios_detector.hf.detector import HfDetector
        from helios_detector.hf.runtime import Placement

        placement = Placement(options.device, options.precision, options.threads)
        return HfDetector(spec, placement, options.masks, options.landmarks)
    for entry in entry_points(group=ENTRY_POINTS, name=kind):
        return entry.load()(argument, options)
    outside = sorted(entry.name for entry in entry_points(group=ENTRY_POINTS))
    also = f", or one of {', '.join(outside)}" if outside else ""
    raise InvalidInput(
        f"there is no detector {spec!r} in this build; set simulated, ground-truth, onnx:FILE "
        f"or transformers:ID{also}; a package can add one by an entry point of the group "
        f"{ENTRY_POINTS}"
    )


def open_scorer(spec: str, options: DetectorOptions | None = None) -> ScorerBackend:
    """The back end that a setting names. Raises InvalidInput (wrong setting) or Unavailable."""
    options = options or DetectorOptions()
    kind, _, argument = spec.partition(":")
    if spec == "lexical":
        from helios_detector.scorer import LexicalScorer

        return LexicalScorer()
    if spec == "minilm":
        from helios_detector.minilm import MiniLmScorer

        return MiniLmScorer(options.threads)
    if kind == "transformers" and argument:
        from helios_detector.hf.runtime import Placement
        from helios_detector.hf.scorer import HfScorer

        placement = Placement(options.device, options.precision, options.threads)
        return HfScorer(spec, placement, options.score_head)
    for entry in entry_points(group=SCORER_ENTRY_POINTS, name=kind):
        return entry.load()(argument, options)
    raise InvalidInput(
        f"there is no scorer {spec!r} in this build; set lexical, minilm or transformers:ID; a "
        f"package can add one by an entry point of the group {SCORER_ENTRY_POINTS}"
    )


def open_depth(spec: str, options: DetectorOptions, focal: str) -> DepthBackend | None:
    """None for `none`. Raises InvalidInput (wrong setting) or Unavailable."""
    if spec == "none":
        return None
    if spec.startswith("transformers:"):
        from helios_detector.hf.depth import HfDepth
        from helios_detector.hf.runtime import Placement

        return HfDepth(spec, Placement(options.device, options.precision, options.threads), focal)
    raise InvalidInput(f"there is no depth model {spec!r}; set none or transformers:ID")
