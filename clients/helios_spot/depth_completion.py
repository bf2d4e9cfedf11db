"""Depth from colour for pixels without sensor depth: shiny, dark, or too near surfaces.

An estimator is any callable `(color [h, w, 3] RGB, camera: Pinhole) -> depth_m [h, w]`, metric and
along the optical axis: the detector's (its setting `depth`), or an external `package:callable`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec.images import estimated_depth
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.geometry import Pinhole
from helios_core.plugins import Kind, PluginReference, load
from helios_core.topics import ESTIMATE_DEPTH
from numpy.typing import NDArray

DepthEstimator = Callable[[NDArray[np.uint8], Pinhole], NDArray[np.float32]]

DETECTOR = "detector"
ESTIMATORS = Kind("depth estimator", "helios.depth_estimators")
LEAST_OVERLAP = 500  # pixels with both depths that are needed to scale the estimate
SCALES = (0.5, 2.0)  # outside this range the estimate is rejected


class DetectorDepth:
    """Depth estimator that calls the detector over the bus."""

    def __init__(self, bus: Bus, timeout_s: float) -> None:
        self._bus, self._timeout_s = bus, timeout_s

    def __call__(self, color: NDArray[np.uint8], camera: Pinhole) -> NDArray[np.float32]:
        """Depth [h, w] of an image. Raises Unavailable or DeadlineExceeded without a detector,
        InvalidInput when it returns no depth or no focal length."""
        height, width = color.shape[:2]
        request = pb.DepthRequest()
        image = request.raw_color
        image.width, image.height, image.step, image.encoding = width, height, 3 * width, "rgb8"
        image.data = color.tobytes()
        request.calibration.K.extend(float(k) for k in camera.matrix.ravel())
        reply = self._bus.call(ESTIMATE_DEPTH, request, self._timeout_s)
        depth_m = estimated_depth(reply, (height, width))
        # The calibrated focal length is right; a model that used another is off by their ratio.
        return depth_m * np.float32(camera.fx / reply.focal_px)


def load_estimator(name: str, bus: Bus | None, timeout_s: float) -> DepthEstimator:
    """The estimator of that name. Raises InvalidInput when there is none."""
    if name == DETECTOR:
        if bus is None:
            raise InvalidInput("without a bus no detector can be asked for depth; name a callable")
        return DetectorDepth(bus, timeout_s)
    module, _, attribute = name.partition(":")
    if not attribute:
        raise InvalidInput(
            "estimated depth needs an estimator; set HELIOS_SPOT_DEPTH_ESTIMATOR to "
            "detector or package:callable, or HELIOS_SPOT_DEPTH to sensor"
            + (f" (it is {name!r})" if name else "")
        )
    found = load(ESTIMATORS, PluginReference(name, module, attribute))
    if not callable(found):
        raise InvalidInput(f"depth estimator {name!r} is no callable")
    estimator: Any = found
    return estimator


def estimated(
    estimator: DepthEstimator, color: NDArray[np.uint8], camera: Pinhole
) -> NDArray[np.float32]:
    """The estimator's depth, checked. Raises Unavailable when it fails or returns a wrong shape."""
    try:
        depth_m = np.asarray(estimator(color, camera), np.float32)
    except HeliosError:
        raise
    except Exception as error:  # external code
        raise Unavailable(
            f"the depth estimator failed ({type(error).__name__}: {error}); set HELIOS_SPOT_DEPTH "
            "to sensor to go on without"
        ) from error
    if depth_m.shape != color.shape[:2]:
        raise Unavailable(
            f"the depth estimator gave {depth_m.shape} for an image of {color.shape[:2]}; "
            "wanted one depth a pixel"
        )
    return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.float32(0))


def filled(sensor_m: NDArray[np.float32], estimate_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """The sensor's depth [h, w]; where it is 0, the estimate scaled to the sensor's depth.

    If the scale is outside `SCALES`, the estimate is not used.
    """
    both = (sensor_m > 0) & (estimate_m > 0)
    scale = 1.0
    if np.count_nonzero(both) >= LEAST_OVERLAP:
        scale = float(np.median(sensor_m[both] / estimate_m[both]))
        if not SCALES[0] <= scale <= SCALES[1]:
            return sensor_m
    return np.where(sensor_m > 0, sensor_m, estimate_m * np.float32(scale)).astype(np.float32)
