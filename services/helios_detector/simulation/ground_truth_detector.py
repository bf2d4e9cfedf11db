"""Error-free detector: detections directly from simulator ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from helios_core.name_rules import plain
from helios_core.types import Detection, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.backend import DetectorBackend, Findings, Seen
from helios_detector.simulator_truth import Truth, TruthInstance, TruthSource, truth_of
from helios_detector.vocabulary_matching import open_wanted

MIN_VISIBLE_PX = 10


@dataclass(frozen=True)
class Visible:
    """The visible part of one instance."""

    instance: TruthInstance
    pixels: int
    box_xyxy: tuple[int, int, int, int]
    crop: NDArray[np.bool_]  # its mask within the box


def visible(truth: Truth, min_px: int = MIN_VISIBLE_PX) -> Iterator[Visible]:
    """The instances with at least `min_px` pixels, in ascending order of id."""
    extents = truth.extents
    for k in np.flatnonzero(extents.pixels >= min_px):
        id = int(extents.ids[k])
        instance = truth.instances.get(id)
        if id == 0 or instance is None:
            continue
        x0, y0, x1, y1 = extents.boxes_xyxy[k].tolist()
        crop = truth.ids[y0:y1, x0:x1] == id
        yield Visible(instance, int(extents.pixels[k]), (x0, y0, x1, y1), crop)


def detection(
    name: str,
    score: float,
    box_xyxy: tuple[int, int, int, int],
    crop: NDArray[np.bool_],
    shape: tuple[int, int],
) -> Detection:
    """Detection with `crop` as its mask [h, w] within the box."""
    x0, y0, x1, y1 = box_xyxy
    mask = np.zeros(shape, bool)
    mask[y0:y1, x0:x1] = crop
    return Detection(name, score, box_xyxy, mask)


class GroundTruthDetector(DetectorBackend):
    """Detector that reports each instance of a search class with at least 10 pixels, score 1."""

    name = "ground-truth"

    def __init__(self, source: TruthSource) -> None:
        self._source = source

    def vocabulary(self) -> None:
        return None

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return {}

    def warm_up(self) -> None:
        self._source.check()

    def close(self) -> None:
        """No resources to free."""

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        truth = truth_of(frame, self._source)
        wanted = open_wanted(context)
        detections: list[Detection] = []
        seen: dict[str, Seen] = {}
        for thing in visible(truth):
            name = thing.instance.class_name
            seen[name] = Seen(name, 1.0)
            for want in wanted:
                if plain(name) in want.names:
                    detections.append(
                        detection(want.name, 1.0, thing.box_xyxy, thing.crop, truth.ids.shape)
                    )
        return Findings(tuple(detections), tuple(seen.values()))
