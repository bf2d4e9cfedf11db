"""Masks from boxes with SAM 2 and related models."""

from __future__ import annotations

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_detector.hf.model_runtime import HfModel, Placement, config_of, picture, source_of

KINDS = ("sam2", "sam2_video", "sam3_tracker", "edgetam", "sam", "sam_hq")
SETTING = "masks"
MAX_BOXES = 32  # most boxes in one pass of the mask decoder


class BoxesToMasks:
    """A segmentation model prompted with boxes."""

    def __init__(self, spec: str, placement: Placement) -> None:
        """Raises InvalidInput for a model of another kind, Unavailable for a missing model."""
        source = source_of(spec, SETTING)
        kind = config_of(source, SETTING).model_type
        if kind not in KINDS:
            raise InvalidInput(
                f"{source} is a {kind!r} model, which makes no mask of a box; set {SETTING} to a "
                f"model of one of {', '.join(KINDS)}, or to depth"
            )
        # The weights' precision also encodes the boxes; 8 bits (bfloat16) are too few for them.
        self.model = HfModel(
            source, SETTING, placement, "AutoModelForMaskGeneration", half_weights=False
        )

    def masks(
        self,
        color: NDArray[np.uint8],  # [h, w, 3] RGB
        boxes: NDArray[np.float32],  # [n, 4] xyxy, pixels
    ) -> NDArray[np.bool_]:
        """Masks [n, h, w]; the image is encoded once per 32 boxes."""
        out = [np.zeros((0, *color.shape[:2]), bool)]
        for at in range(0, len(boxes), MAX_BOXES):
            out.append(self._masks(color, boxes[at : at + MAX_BOXES]))
        return np.concatenate(out)

    def _masks(self, color: NDArray[np.uint8], boxes: NDArray[np.float32]) -> NDArray[np.bool_]:
        with self.model.use() as (model, processor):
            inputs = processor(
                images=picture(color), input_boxes=[boxes.tolist()], return_tensors="pt"
            )
            sizes = inputs.pop("original_sizes")
            reshaped = inputs.pop("reshaped_input_sizes", None)  # SAM 1 pads instead of stretching
            result = model(**self.model.to_device(inputs), multimask_output=False)
            args = (sizes,) if reshaped is None else (sizes, reshaped)
            full = processor.post_process_masks(result.pred_masks.float().cpu(), *args)[0]
            return full[:, 0].numpy().astype(bool)
