"""Where new Gaussians are made (appendix, Gaussian creation).

The paper makes a Gaussian wherever measured and rendered depth differ by more than 1 mm: with real
depth noise of a centimetre that never ends. The default rule creates where nothing is modelled or
where the measured surface lies in front of the rendered one by more than the depth noise explains.
`paper` is the literal rule.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_objectmap.rendering.renderer import Rendering

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

MODELLED = 0.5  # a pixel with less coverage shows nothing that is modelled


def depth_noise_m(depth_m: Float32) -> Float32:
    """Standard deviation of structured-light depth (Nguyen, Izadi, Lovell 2012), metres."""
    return 0.0012 + 0.0019 * (depth_m - 0.4) ** 2


def tolerance_m(depth_m: Float32, floor_m: float) -> Float32:
    """A difference of depth that noise doesn't explain: 4 standard deviations, not below floor."""
    return np.maximum(np.float32(floor_m), 4 * depth_noise_m(depth_m))


def creation_mask(depth_m: Float32, rendering: Rendering, detected: Mask, front_m: float) -> Mask:
    """Pixels [h, w] that get a new Gaussian: nothing is modelled, or something new is in front."""
    in_front = depth_m < rendering.depth_m - tolerance_m(depth_m, front_m)
    in_front &= rendering.coverage >= MODELLED
    new = (rendering.coverage < MODELLED) | _eroded(in_front)
    return detected & (depth_m > 0) & new


def paper_creation_mask(depth_m: Float32, rendering: Rendering, detected: Mask) -> Mask:
    """Pixels [h, w] that get a new Gaussian by the paper's literal rule."""
    valid = detected & (depth_m > 0)
    error_m = np.abs(depth_m - rendering.depth_m)
    return valid & ((error_m > 1.0) | _eroded(valid & (error_m > 0.001)))


def _eroded(mask: Mask) -> Mask:
    return cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0).astype(bool)
