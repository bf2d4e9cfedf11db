"""The interfaces of a detector, a scorer and a depth model; `model_loading` opens them by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import Detection, Embedding, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.simulator_truth import TruthSource

SEEN_SCORE = 0.3  # from which a class that was not asked for counts as seen


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
    """Prompts as a scorer's model sees them; `helios_core.embedding_similarity.fit` compares."""

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
