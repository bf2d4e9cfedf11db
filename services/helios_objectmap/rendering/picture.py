"""The map as a camera anywhere would see it: colour, depth, and what is believed (eq. 1, 4).

As the paper renders: the expectation and the standard deviation of a class take the colour's place.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_objectmap.rendering.renderer import Projection

LAYERS = ("color", "depth", "probability", "uncertainty")
MOST_UNCERTAIN = (
    0.3  # standard deviation that is drawn brightest: that of the prior and two classes
)


def color(projection: Projection, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """[h, w, 3] RGB on white. rgb: [k, 3] of `projection.rows`."""
    rendering = projection.render(rgb.astype(np.float32) / np.float32(255))
    image = rendering.features.transpose(1, 2, 0) + (1 - rendering.coverage)[..., None]
    return np.rint(image.clip(0, 1) * 255).astype(np.uint8)


def depth_mm(projection: Projection) -> NDArray[np.uint16]:
    """[h, w] millimetres along the optical axis; 0 where nothing is modelled."""
    return np.rint(projection.render().depth_m.clip(0, 65.5) * 1000).astype(np.uint16)


def belief(projection: Projection, values: NDArray[np.floating], most: float) -> NDArray[np.uint8]:
    """[h, w, 3] RGB from dark (0) to yellow (`most`), on white. values: [k]."""
    rendering = projection.render(values.astype(np.float32)[:, None])
    share = np.divide(
        rendering.features[0], rendering.coverage,
        out=np.zeros_like(rendering.coverage), where=rendering.coverage > 1e-3,
    )  # fmt: skip
    level = np.rint((share / most).clip(0, 1) * 255).astype(np.uint8)
    tint = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)[..., ::-1].astype(np.float32)
    cover = rendering.coverage[..., None]
    return np.rint(tint * cover + 255 * (1 - cover)).clip(0, 255).astype(np.uint8)


def png(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """[h, w, 3] RGB or [h, w] grey."""
    ok, data = cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)
    if not ok:
        raise RuntimeError("the image could not be written as PNG")
    return data.tobytes()
