"""Image-text score computed from embeddings."""

from __future__ import annotations

import numpy as np

from helios_core.errors import InvalidInput
from helios_core.types import Embedding


def image_text_score(
    image: Embedding, text: Embedding, scale: float = 1.0, offset: float = 0.0
) -> float:
    """Score clip(scale * cosine + offset, 0, 1); of several vectors the best pair counts.

    Raises InvalidInput for embeddings of different models.
    """
    if image.model != text.model or image.vectors.shape[1] != text.vectors.shape[1]:
        raise InvalidInput(
            f"an image embedding of {image.model} {image.vectors.shape} cannot be compared with a "
            f"text embedding of {text.model} {text.vectors.shape}; embed the text with the same "
            "model"
        )
    cosine = float((image.vectors @ text.vectors.T).max())
    return float(np.clip(scale * cosine + offset, 0.0, 1.0))
