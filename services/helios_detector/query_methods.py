"""Query methods of a detector: its vocabulary, embeddings of prompts, depth of an image."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod

import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core.bus import Bus, Registration
from helios_core.codec import embedding_to_proto
from helios_core.codec.images import color_array
from helios_core.errors import InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.topics import EMBED_TEXT, ESTIMATE_DEPTH, VOCABULARY

from helios_detector.backend import DepthEstimate
from helios_detector.frame_analysis import FrameAnalyzer
from helios_detector.model_usage import ModelUsage

MOST_PROMPTS = 64


class QueryMethodsBase(ABC):
    """Bus methods served between `open` and `close`, which may be called repeatedly."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._served: list[Registration] = []

    def open(self) -> None:
        if not self._served:
            self._served = [
                self._bus.serve(VOCABULARY, self.vocabulary),
                self._bus.serve(EMBED_TEXT, self.embed_text),
                self._bus.serve(ESTIMATE_DEPTH, self.estimate_depth),
            ]

    def close(self) -> None:
        served, self._served = self._served, []
        for registration in served:
            registration.close()

    @abstractmethod
    def vocabulary(self, _: pb.Empty) -> pb.VocabularyReply: ...

    @abstractmethod
    def embed_text(self, request: pb.EmbedTextRequest) -> pb.EmbedTextReply: ...

    @abstractmethod
    def estimate_depth(self, request: pb.DepthRequest) -> pb.DepthReply: ...


class LoadingQueryMethods(QueryMethodsBase):
    """Query methods while the models load: each raises Unavailable with the reason."""

    def __init__(self, bus: Bus, health: Health) -> None:
        super().__init__(bus)
        self._health = health

    def vocabulary(self, _: pb.Empty) -> pb.VocabularyReply:
        raise self._reason()

    def embed_text(self, request: pb.EmbedTextRequest) -> pb.EmbedTextReply:
        raise self._reason()

    def estimate_depth(self, request: pb.DepthRequest) -> pb.DepthReply:
        raise self._reason()

    def _reason(self) -> Unavailable:
        return Unavailable(f"the detector is not ready: {self._health.state[1]}")


class QueryMethods(QueryMethodsBase):
    """Query methods that the loaded models answer."""

    def __init__(
        self, bus: Bus, analyzer: FrameAnalyzer, usage: ModelUsage, health: Health
    ) -> None:
        super().__init__(bus)
        self._analyzer, self._usage, self._health = analyzer, usage, health

    def vocabulary(self, _: pb.Empty) -> pb.VocabularyReply:
        models, names = self._analyzer.models, self._analyzer.vocabulary()
        return pb.VocabularyReply(
            open=names is None,
            names=names or (),
            detector=models.detector.name,
            scorer=models.scorer.name,
        )

    def embed_text(self, request: pb.EmbedTextRequest) -> pb.EmbedTextReply:
        """The scorer's embeddings of prompts, to compare with images of earlier observations."""
        if not 0 < len(request.prompts) <= MOST_PROMPTS:
            raise InvalidInput(
                f"{len(request.prompts)} prompts came; send 1 to {MOST_PROMPTS} in one call"
            )
        with self._usage.work():
            made = self._analyzer.models.scorer.embed_text(list(request.prompts))
        return pb.EmbedTextReply(
            embeddings=[embedding_to_proto(e) for e in made.texts],
            scale=made.scale,
            offset=made.offset,
        )

    def estimate_depth(self, request: pb.DepthRequest) -> pb.DepthReply:
        """Depth of a colour image; the bridge calls it for robots without a depth camera."""
        depth = self._analyzer.models.depth
        if depth is None:
            raise InvalidInput(
                "this detector makes no depth; set its depth to transformers:ID, or the bridge's "
                "depth to sensor"
            )
        began = time.perf_counter()
        color = color_array(
            request.raw_color if request.HasField("raw_color") else None,
            request.compressed_color if request.HasField("compressed_color") else None,
        )
        focal_px = focal_of(request, color.shape[1])
        with self._usage.work():
            made = depth.estimate(color, focal_px)
        self._analyzer.measure()
        out = depth_to_proto(made, depth.name)
        out.estimate_ms = self._analyzer.timed("depth", began)
        self._health.count("depths_estimated")
        return out


def focal_of(request: pb.DepthRequest, width: int) -> float | None:
    """Calibrated focal length of the request's image in pixels; None without a calibration.

    Raises InvalidInput for a calibration that does not fit the image.
    """
    K = request.calibration.K
    if not K:
        return None
    if len(K) != 9 or not math.isfinite(K[0]) or not 0.02 * width <= K[0] <= 100 * width:
        raise InvalidInput(
            f"the calibration's K is {list(K)[:9]} for an image {width} wide; send 9 numbers, row "
            "by row, in pixels of this image, or none"
        )
    return float(K[0])


def depth_to_proto(made: DepthEstimate, model: str) -> pb.DepthReply:
    height, width = made.depth_m.shape
    mm = np.rint(made.depth_m * 1000).astype("<u2")
    return pb.DepthReply(
        raw_depth=RawImage(
            width=width,
            height=height,
            encoding="16UC1",
            step=2 * width,
            frame_id="camera",
            data=mm.tobytes(),
        ),
        focal_px=made.focal_px,
        model=model,
    )
