"""Boxes from text with zero-shot detection models, with one score per box and phrase.

The library's post-processing gives one label per box. This module keeps the score of every phrase,
so that thresholds and synonyms apply per class. Boxes and scores agree with the library's (tests).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_detector.hf.model_runtime import HfModel, Placement, picture

MAX_PHRASES = 64  # most phrases in one pass
SETTING = "detector"


@dataclass(frozen=True)
class Found:
    """Output of a text-prompted model for one image."""

    boxes: NDArray[np.float32]  # [n, 4] xyxy, pixels
    scores: NDArray[np.float32]  # [n, phrases] 0 to 1
    masks: NDArray[np.bool_] | None = None  # [n, h, w]; None if the model makes no masks


class TextToBoxes:
    """A model of AutoModelForZeroShotObjectDetection."""

    def __init__(self, source: str, model_type: str, placement: Placement) -> None:
        """Raises InvalidInput for a model of another family."""
        if model_type not in FAMILIES:
            raise InvalidInput(
                f"{source} is a {model_type!r} model, which finds nothing by text; set {SETTING} "
                f"to a model of one of {', '.join((*FAMILIES, 'sam3'))}"
            )
        self._run, self._one_pass = FAMILIES[model_type]
        self.model = HfModel(source, SETTING, placement, "AutoModelForZeroShotObjectDetection")

    def find(
        self,
        color: NDArray[np.uint8],  # [h, w, 3] RGB
        phrases: Sequence[str],
        floors: NDArray[np.float32],  # [phrases] lowest useful scores
    ) -> Found:
        """Find all phrases. Raises Unavailable, InvalidInput or Internal like `HfModel.use`."""
        boxes, scores = [np.zeros((0, 4), np.float32)], [np.zeros((0, len(phrases)), np.float32)]
        with self.model.use() as (model, processor):
            at = 0
            while at < len(phrases):
                count = self._one_pass(model, processor, phrases[at:])
                group = phrases[at : at + count]
                b, s = self._run(self.model, model, processor, color, list(group))
                useful = (s >= floors[at : at + count]).any(1)
                wide = np.zeros((int(useful.sum()), len(phrases)), np.float32)
                wide[:, at : at + count] = s[useful]
                boxes.append(b[useful])
                scores.append(wide)
                at += count
        return Found(np.concatenate(boxes), np.concatenate(scores))


def corners(boxes: NDArray[np.float32], width: float, height: float) -> NDArray[np.float32]:
    """Boxes xyxy in pixels from centre and size [n, 4] as fractions of the image size."""
    centre, half = boxes[:, :2], boxes[:, 2:] / 2
    scale = np.array([width, height, width, height], np.float32)
    return (np.concatenate([centre - half, centre + half], 1) * scale).astype(np.float32)


def token_spans(
    offsets: Sequence[tuple[int, int]],  # character span of each token; (0, 0) for special ones
    phrases: Sequence[str],
) -> list[list[int]]:
    """Token indices of each phrase in "first. second. third."."""
    out, at = [], 0
    for phrase in phrases:
        end = at + len(phrase)
        out.append([i for i, (a, b) in enumerate(offsets) if a < end and b > at and b > a])
        at = end + len(". ")
    return out


def joined(phrases: Sequence[str]) -> str:
    return ". ".join(phrases) + "."


def _numpy(tensor: Any) -> NDArray[np.float32]:
    return tensor.float().cpu().numpy()


def _owl(
    handle: HfModel, model: Any, processor: Any, color: NDArray, phrases: list[str]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(boxes, scores) of OWL-ViT, which stretches the image, or OWLv2, which pads it to a square
    at the bottom and right."""
    inputs = processor(text=[phrases], images=picture(color), return_tensors="pt", truncation=True)
    out = model(**handle.to_device(inputs))
    height, width = color.shape[:2]
    if model.config.model_type == "owlv2":
        height = width = max(height, width)
    return corners(_numpy(out.pred_boxes[0]), width, height), _numpy(out.logits[0].sigmoid())


def _dino(
    handle: HfModel, model: Any, processor: Any, color: NDArray, phrases: list[str]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(boxes, scores); a phrase's score is the maximum over its tokens (Grounding DINO) or their
    mean (MM)."""
    text = joined(phrases)
    inputs = processor(images=picture(color), text=text, return_tensors="pt")
    offsets = processor.tokenizer(text, return_offsets_mapping=True)["offset_mapping"]
    out = model(**handle.to_device(inputs))
    tokens = _numpy(out.logits[0].sigmoid())
    merge = np.mean if model.config.model_type == "mm-grounding-dino" else np.max
    spans = token_spans(offsets, phrases)
    scores = np.stack(
        [merge(tokens[:, s], axis=1) if s else np.zeros(len(tokens)) for s in spans], 1
    )
    height, width = color.shape[:2]
    return corners(_numpy(out.pred_boxes[0]), width, height), scores.astype(np.float32)


def _omdet(
    handle: HfModel, model: Any, processor: Any, color: NDArray, phrases: list[str]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    inputs = processor(images=picture(color), text=[phrases], return_tensors="pt")
    out = model(**handle.to_device(inputs))
    height, width = color.shape[:2]
    boxes = corners(_numpy(out.decoder_coord_logits[0]), width, height)
    return boxes, _numpy(out.decoder_class_logits[0].sigmoid())[:, : len(phrases)]


def _many(model: Any, processor: Any, phrases: Sequence[str]) -> int:
    return min(len(phrases), MAX_PHRASES)


def _by_tokens(model: Any, processor: Any, phrases: Sequence[str]) -> int:
    """Number of phrases that fit the text encoder in one pass; at least one."""
    limit = int(model.config.max_text_len)
    count = min(len(phrases), MAX_PHRASES)
    while count > 1 and len(processor.tokenizer(joined(phrases[:count]))["input_ids"]) > limit:
        count -= 1
    return count


_Run = Callable[..., tuple[NDArray[np.float32], NDArray[np.float32]]]
FAMILIES: dict[str, tuple[_Run, Callable[[Any, Any, Sequence[str]], int]]] = {
    "owlvit": (_owl, _many),
    "owlv2": (_owl, _many),
    "grounding-dino": (_dino, _by_tokens),
    "mm-grounding-dino": (_dino, _by_tokens),
    "omdet-turbo": (_omdet, _many),
}
