"""Boxes and masks from text with SAM 3, which encodes the image once for all phrases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from helios_detector.hf.model_runtime import HfModel, Placement, picture
from helios_detector.hf.zero_shot_detection import SETTING, Found

KINDS = ("sam3", "sam3_video")
PHRASES_AT_ONCE = 8  # limits memory: the detection part holds queries and masks of each phrase


class TextToMasks:
    """A SAM 3 model: one pass of its image encoder, one batch entry per phrase after it."""

    def __init__(self, source: str, placement: Placement) -> None:
        self.model = HfModel(
            source, SETTING, placement, "Sam3Model", "Sam3Processor", half_weights=False
        )

    def find(
        self,
        color: NDArray[np.uint8],  # [h, w, 3] RGB
        phrases: Sequence[str],
        floors: NDArray[np.float32],  # [phrases] lowest useful scores
    ) -> Found:
        """Find all phrases. Raises Unavailable, InvalidInput or Internal like `HfModel.use`."""
        shape = color.shape[:2]
        boxes, masks = [np.zeros((0, 4), np.float32)], [np.zeros((0, *shape), bool)]
        scores = [np.zeros((0, len(phrases)), np.float32)]
        with self.model.use() as (model, processor):
            image = self.model.to_device(processor(images=picture(color), return_tensors="pt"))
            seen = model.get_vision_features(pixel_values=image["pixel_values"])
            for at in range(0, len(phrases), PHRASES_AT_ONCE):
                group = list(phrases[at : at + PHRASES_AT_ONCE])
                text = self.model.to_device(processor(text=group, return_tensors="pt"))
                out = model(
                    vision_embeds=_repeated(seen, len(group)),
                    input_ids=text["input_ids"],
                    attention_mask=text["attention_mask"],
                )
                lowest = float(floors[at : at + len(group)].min())
                results = processor.post_process_instance_segmentation(
                    out, threshold=lowest, target_sizes=[shape] * len(group)
                )
                for i, result in enumerate(results):
                    found = np.zeros((len(result["scores"]), len(phrases)), np.float32)
                    found[:, at + i] = result["scores"].float().cpu().numpy()
                    scores.append(found)
                    boxes.append(result["boxes"].float().cpu().numpy().reshape(-1, 4))
                    masks.append(result["masks"].cpu().numpy().astype(bool).reshape(-1, *shape))
        return Found(np.concatenate(boxes), np.concatenate(scores), np.concatenate(masks))


def _repeated(seen: Any, count: int) -> Any:
    """The image features repeated once per phrase, without copies."""
    out = type(seen)(**seen)
    for name in ("fpn_hidden_states", "fpn_position_encoding"):
        levels = tuple(level.expand(count, -1, -1, -1) for level in seen[name])
        out[name] = levels
    return out
