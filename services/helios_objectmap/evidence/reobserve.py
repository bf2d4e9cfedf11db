"""Which pixels look at what is modelled (appendix, re-observing parts of the scene).

Only these update the Gaussians. Those without a detection count as "other": the negative evidence.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_objectmap.evidence.create import MODELLED
from helios_objectmap.rendering.renderer import Rendering


def reobserved(
    depth_m: NDArray[np.float32],
    rendering: Rendering,
    created: NDArray[np.bool_],
    agreement_m: float,
    closing_px: int,
) -> NDArray[np.bool_]:
    """Pixels [h, w] whose measured depth agrees with the model, small holes closed.

    `rendering` is of the map before the pixels `created` were added; those agree by construction.
    Pixels without a measured depth never count.
    """
    agrees = (rendering.coverage >= MODELLED) & (np.abs(rendering.depth_m - depth_m) < agreement_m)
    mask = ((agrees | created) & (depth_m > 0)).astype(np.uint8)
    kernel = np.ones((closing_px, closing_px), np.uint8)
    return cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel).astype(bool) & (depth_m > 0)
