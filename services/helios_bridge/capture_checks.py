"""Check of the types, shapes and numbers of a driver's capture."""

from __future__ import annotations

from numbers import Real

import numpy as np
from helios_core.codec import pinhole_from_proto, pinhole_to_proto
from helios_core.codec.frames import LATEST_S
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole
from helios_core.robot import Capture

from helios_bridge.pose_checks import check_poses

LATEST_NS = LATEST_S * 10**9
LARGEST_SIDE = 2**16  # pixels; larger images have too many in any case


def check_capture(c: Capture) -> None:
    """Check types, shapes and numbers of a capture, except for the values of its pixels.

    Raises InvalidInput that names the field, the value and the requirement.
    """
    _check_camera(c.camera)
    if isinstance(c.stamp_ns, bool) or not isinstance(c.stamp_ns, (int, np.integer)):
        raise InvalidInput(
            f"the driver's stamp_ns is a {type(c.stamp_ns).__name__}; give an int, nanoseconds"
        )
    if abs(int(c.stamp_ns)) > LATEST_NS:
        raise InvalidInput(
            f"the driver's stamp_ns is {c.stamp_ns}; give the robot's clock in nanoseconds, within "
            f"{LATEST_NS}"
        )
    size = (c.camera.height, c.camera.width)
    wanted = {
        "color": (c.color, np.uint8, (*size, 3), "RGB"),
        "depth_m": (c.depth_m, np.float32, size, "metres along the optical axis, 0 where none"),
    }
    for name, (array, dtype, shape, words) in wanted.items():
        if not isinstance(array, np.ndarray):
            raise InvalidInput(
                f"the driver's {name} is a {type(array).__name__}; give an array of "
                f"{np.dtype(dtype)} {shape}: {words}"
            )
        if array.dtype != dtype or array.shape != shape:
            raise InvalidInput(
                f"the driver's {name} is {array.dtype} {array.shape}; give {np.dtype(dtype)} "
                f"{shape}, as the calibration says: {words}"
            )
    check_poses(c.T_world_cam, c.T_world_base, "the driver's")


def _check_camera(camera: object) -> None:
    """Check the intrinsics and the image size, as every reader of a frame does."""
    if not isinstance(camera, Pinhole):
        raise InvalidInput(f"the driver's camera is a {type(camera).__name__}; give a Pinhole")
    for name in ("fx", "fy", "cx", "cy"):
        value = getattr(camera, name)
        if isinstance(value, bool) or not isinstance(value, Real):
            raise InvalidInput(f"the driver's camera.{name} is {value!r}; give a number of pixels")
    for name in ("width", "height"):
        value = getattr(camera, name)
        whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
        if not whole or not 0 < value <= LARGEST_SIDE:
            raise InvalidInput(
                f"the driver's camera.{name} is {value!r}; give an int of pixels, 1 to "
                f"{LARGEST_SIDE}"
            )
    try:
        pinhole_from_proto(pinhole_to_proto(camera))
    except InvalidInput as error:
        raise InvalidInput(f"the driver's camera is wrong: {error.message}") from error
