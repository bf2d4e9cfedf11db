"""Interfaces of a detector, a scorer and a depth model; `model_loading` opens them by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import Detection, Embedding, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.simulator_truth import TruthSource

SEEN_SCORE = 0.3  # score from which a class outside the search context counts as seen


@dataclass(frozen=True)
class Seen:
    """A class that the detector reports in the image, in the search context or not."""

    class_name: str
    score: float


@dataclass(frozen=True)
class Findings:
    """A detector's output for one frame."""

    detections: tuple[Detection, ...]  # of the search classes, with their names in the context
    seen: tuple[Seen, ...]  # of every class that the detector knows


@dataclass(frozen=True)
class Judgement:
    """A scorer's output for one frame."""

    scores: dict[str, float]  # value layer -> score in 0 to 1
    image: Embedding | None = None  # for scoring new prompts later


@dataclass(frozen=True)
class TextEmbeddings:
    """A scorer's embeddings of prompts; `helios_core.embedding_similarity.image_text_score`
    compares them."""

    texts: tuple[Embedding, ...]
    scale: float
    offset: float


class DetectorBackend(ABC):
    """Detector of objects in a frame. Calls may come from several threads at once."""

    name: str

    @abstractmethod
    def vocabulary(self) -> tuple[str, ...] | None:
        """All names that the detector knows; None for an open vocabulary."""

    @abstractmethod
    def refused(self, context: SearchContext) -> Mapping[str, str]:
        """Class name of the context -> one sentence why the detector cannot find it."""

    @abstractmethod
    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        """Detections in one frame. Raises InvalidInput for a class it cannot find."""

    @abstractmethod
    def warm_up(self) -> None:
        """Load the models, so that the first frame is fast. Raises Unavailable when they fail."""

    def unload(self) -> None:  # noqa: B027 - nothing to free is the common case
        """Free the models' memory; the next call loads them again."""

    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory (MB) since the last call; 0 without an accelerator."""
        return 0.0

    @abstractmethod
    def close(self) -> None:
        """Free all resources. Idempotent."""


class ScorerBackend(ABC):
    """Scorer of an image against prompts. Calls may come from several threads at once."""

    name: str
    reads_names = False  # True: scores the detector's class names instead of the image

    @abstractmethod
    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        """Value layer -> score in 0 to 1 of its prompt, all layers in one pass."""

    def judge(self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]) -> Judgement:
        """Scores, and the image's embedding if the model makes one."""
        return Judgement(self.score(frame, seen, prompts))

    def embed_text(self, prompts: Sequence[str]) -> TextEmbeddings:
        """Embeddings of the prompts. Raises InvalidInput for a scorer without embeddings."""
        raise InvalidInput(
            f"the scorer {self.name} looks at no image and has no embeddings; set scorer to "
            "transformers:ID"
        )

    @abstractmethod
    def warm_up(self) -> None:
        """Load the models, so that the first frame is fast. Raises Unavailable when they fail."""

    def unload(self) -> None:  # noqa: B027 - nothing to free is the common case
        """Free the models' memory; the next call loads them again."""

    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory (MB) since the last call; 0 without an accelerator."""
        return 0.0

    @abstractmethod
    def close(self) -> None:
        """Free all resources. Idempotent."""


@dataclass(frozen=True)
class DepthEstimate:
    """Depth estimated from one colour image."""

    depth_m: NDArray[np.float32]  # [h, w] along the optical axis; 0 is invalid
    focal_px: float  # focal length that scaled the depth


class DepthBackend(ABC):
    """Monocular depth estimator. Calls may come from several threads at once."""

    name: str

    @abstractmethod
    def estimate(self, color: NDArray[np.uint8], focal_px: float | None) -> DepthEstimate:
        """Depth of an RGB image; `focal_px` is the calibrated focal length.

        Raises InvalidInput when the model needs `focal_px` and it is missing.
        """

    @abstractmethod
    def warm_up(self) -> None:
        """Load the models, so that the first frame is fast. Raises Unavailable when they fail."""

    @abstractmethod
    def unload(self) -> None:
        """Free the model's memory; the next call loads it again."""

    @abstractmethod
    def accelerator_mb(self) -> float:
        """Peak of the accelerator's memory (MB) since the last call; 0 without an accelerator."""

    @abstractmethod
    def close(self) -> None:
        """Free all resources. Idempotent."""


@dataclass(frozen=True)
class DetectorOptions:
    """Options of a back end besides its own argument."""

    truth: TruthSource | None = None  # simulator only
    threads: int = 1
    noise: str = "demo-v1"  # a table of `noise_tables/` or a path
    noise_seed: int = 0
    noise_level: float = 1.0
    noise_correlation: float | None = None  # None: the table's value
    device: str = "auto"  # for transformers models: auto, cpu, cuda, cuda:N, mps
    precision: str = "auto"  # auto: half on cuda; float32, float16, bfloat16
    masks: str = "depth"  # masks from boxes: depth, or transformers:ID of a SAM 2
    by_similarity: bool = False  # a fixed vocabulary substitutes its most similar name
    score_head: str = "itc"  # head of BLIP-2: itc (the paper's) or itm
    landmarks: tuple[str, ...] = ()  # extra classes for an open vocabulary, reported in `seen` only
