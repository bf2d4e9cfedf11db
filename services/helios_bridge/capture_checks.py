"""Check of the types and shapes of a driver's capture."""

from __future__ import annotations

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole
from helios_core.robot import Capture

from helios_bridge.pose_checks import check_poses


def check_capture(c: Capture) -> None:
    """Check types and shapes of a capture. Raises InvalidInput that names the requirement."""
    if not isinstance(c.camera, Pinhole):
        raise InvalidInput(f"the driver's camera is a {type(c.camera).__name__}; give a Pinhole")
    if not isinstance(c.stamp_ns, (int, np.integer)):
        raise InvalidInput(
            f"the driver's stamp_ns is a {type(c.stamp_ns).__name__}; give an int, nanoseconds"
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
