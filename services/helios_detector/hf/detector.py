"""The detection back end `transformers:<model id or folder>`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from helios_core.geometry import Pinhole
from helios_core.types import Detection, Frame, FrameId, Role, SearchClass, SearchContext
from numpy.typing import NDArray

from helios_detector.backend import DetectorBackend, Findings, Seen
from helios_detector.box_to_mask import Box, box_to_mask, clip_box
from helios_detector.detection_filtering import box_of, near_box, one_class_each
from helios_detector.hf import sam3_detection
from helios_detector.hf.model_runtime import HfModel, Placement, config_of, source_of
from helios_detector.hf.sam2_masks import BoxesToMasks
from helios_detector.hf.text_prompts import Phrases, phrases_of
from helios_detector.hf.zero_shot_detection import SETTING, Found, TextToBoxes
from helios_detector.vocabulary_matching import SearchTarget

BY_DEPTH = "depth"


class HfDetector(DetectorBackend):
    """Text-prompted detector; masks come from the model itself, SAM 2, or depth within the box."""

    def __init__(
        self,
        spec: str,
        placement: Placement,
        masks: str = BY_DEPTH,  # or transformers:<model id or folder>
        landmarks: Sequence[str] = (),  # extra classes, reported in `Findings.seen` only
    ) -> None:
        """Raises Unavailable (library, folder, hub) or InvalidInput (a model of another kind)."""
        source = source_of(spec, SETTING)
        kind = config_of(source, SETTING).model_type
        self._finder: TextToBoxes | sam3_detection.TextToMasks
        if kind in sam3_detection.KINDS:
            self._finder = sam3_detection.TextToMasks(source, placement)
        else:
            self._finder = TextToBoxes(source, kind, placement)
        gives_masks = isinstance(self._finder, sam3_detection.TextToMasks)
        by_depth = gives_masks or masks == BY_DEPTH
        self._masker = None if by_depth else BoxesToMasks(masks, placement)
        self._landmarks = tuple(landmarks)
        self.name = spec if self._masker is None else f"{spec} + {masks}"

    @property
    def _models(self) -> list[HfModel]:
        return [self._finder.model] + ([self._masker.model] if self._masker else [])

    def vocabulary(self) -> None:
        return None

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return {}

    def warm_up(self) -> None:
        camera = Pinhole(300.0, 300.0, 160.0, 120.0, 320, 240)
        grey, flat = np.full((240, 320, 3), 114, np.uint8), np.ones((240, 320), np.float32)
        frame = Frame(FrameId("", 0, 0), 0, False, grey, flat, camera, np.eye(4), np.eye(4))
        self.detect(frame, SearchContext("", (SearchClass("cup", Role.OBJECT, 1.0),)))
        if self._masker:
            self._masker.masks(grey, np.array([[80, 60, 240, 180]], np.float32))

    def unload(self) -> None:
        for model in self._models:
            model.unload()

    def accelerator_mb(self) -> float:
        return max(model.accelerator_mb() for model in self._models)

    def close(self) -> None:
        self.unload()

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        phrases = phrases_of(context, self._landmarks)
        if not phrases.texts:
            return Findings((), ())
        floors = phrases.thresholds[phrases.owner]
        found = self._finder.find(frame.color, phrases.texts, floors)
        scores = phrases.by_class(found.scores)
        asked, limits = len(phrases.wanted), phrases.thresholds
        classes = sum(not w.is_also for w in phrases.wanted)
        # Each kind is filtered apart, so that no other name takes a box of a search class.
        chosen = [
            (i, first + c)
            for first, end in ((0, classes), (classes, asked))
            for i, c in one_class_each(found.boxes, scores[:, first:end], limits[first:end])
        ]
        marks = one_class_each(found.boxes, scores[:, asked:], limits[asked:])
        picks = [
            (i, c, box) for i, c in chosen if (box := _clipped(found.boxes[i], frame)) is not None
        ]
        masks = self._masks(frame, found, phrases, picks)
        detections = []
        for (i, c, box), mask in zip(picks, masks, strict=True):
            if found.masks is not None or self._masker:
                mask = near_box(mask, box)
            if (found.masks is not None or self._masker) and mask.any():
                box = box_of(mask)  # the mask may extend beyond its prompt box
            name = phrases.wanted[c].name
            detections.append(Detection(name, float(scores[i, c]), box, mask))
        seen = chosen + [(i, asked + c) for i, c in marks]
        return Findings(tuple(detections), _seen(seen, scores, phrases))

    def _masks(
        self, frame: Frame, found: Found, phrases: Phrases, picks: list[tuple[int, int, Box]]
    ) -> list[NDArray[np.bool_]]:
        if found.masks is not None:
            return [found.masks[i] for i, _, _ in picks]
        if self._masker:
            boxes = np.array([box for _, _, box in picks], np.float32).reshape(-1, 4)
            return list(self._masker.masks(frame.color, boxes))
        return [_by_depth(frame, box, phrases.wanted[c]) for _, c, box in picks]


def _by_depth(frame: Frame, box: Box, want: SearchTarget) -> NDArray[np.bool_]:
    return box_to_mask(
        frame.depth_m, box, frame.camera, frame.T_world_cam, keep_surface=want.keep_surface
    )


def _clipped(box: NDArray[np.float32], frame: Frame) -> Box | None:
    x0, y0, x1, y1 = (float(v) for v in box)
    return clip_box((x0, y0, x1, y1), *frame.depth_m.shape)


def _seen(
    chosen: list[tuple[int, int]], scores: NDArray[np.float32], phrases: Phrases
) -> tuple[Seen, ...]:
    names = [w.name for w in phrases.wanted] + list(phrases.landmarks)
    best: dict[str, float] = {}
    for i, c in chosen:
        best[names[c]] = max(best.get(names[c], 0.0), float(scores[i, c]))
    return tuple(Seen(name, score) for name, score in best.items())
