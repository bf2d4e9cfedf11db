"""Rectification of Spot's cameras to upright pinhole cameras, and registration of depth to colour.

The body's cameras are fisheyes (Kannala-Brandt), and the two in front are mounted sideways; newer
hands have Brown-Conrady lenses. Maps and detectors get an upright pinhole image. The optical axis
does not change, so neither does the depth along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, Pinhole
from numpy.typing import NDArray

SMALL_ROLL_RAD = math.radians(2)


@dataclass(frozen=True)
class Lens:
    """Intrinsics from the robot; `distortion` has OpenCV's order of coefficients."""

    camera: Pinhole
    fisheye: bool = False
    distortion: tuple[float, ...] = ()

    @property
    def plain(self) -> bool:
        """True for a pinhole without distortion."""
        return not any(self.distortion) and not self.fisheye


@dataclass(frozen=True)
class Mount:
    """An upright pinhole camera that replaces a real one.

    `T_cam_upright` is the rotation about the optical axis from the upright to the real camera.
    """

    lens: Lens
    camera: Pinhole
    T_cam_upright: Matrix
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None  # None: no remapping needed


def lens_of(source: Any) -> Lens:
    """Lens of an ImageSource. Raises InvalidInput for a camera without a model."""
    kind = source.WhichOneof("camera_models")
    if kind is None:
        raise InvalidInput(f"the robot tells no intrinsics of {source.name}; choose another camera")
    k = getattr(source, kind).intrinsics
    base = k if kind == "pinhole" else k.pinhole_intrinsics
    camera = Pinhole(
        base.focal_length.x,
        base.focal_length.y,
        base.principal_point.x,
        base.principal_point.y,
        source.cols,
        source.rows,
    )
    if kind == "pinhole_brown_conrady":
        return Lens(camera, distortion=(k.k1, k.k2, k.p1, k.p2, k.k3))
    if kind == "kannala_brandt":
        return Lens(camera, fisheye=True, distortion=(k.k1, k.k2, k.k3, k.k4))
    return Lens(camera)


def roll_to_upright(T_world_cam: Matrix) -> float:
    """Angle about the optical axis that turns the camera's image upright.

    0 if the camera looks straight up or down.
    """
    up = T_world_cam[:3, :3].T @ [0.0, 0.0, 1.0]  # world's up in camera axes; image up is -y
    if math.hypot(up[0], up[1]) < 1e-3:
        return 0.0
    return math.atan2(up[0], -up[1])


def mounted(lens: Lens, roll_rad: float) -> Mount:
    """The upright camera of a lens whose image needs a turn by `roll_rad`."""
    k = lens.camera
    if abs(roll_rad) < SMALL_ROLL_RAD:
        if lens.plain:
            return Mount(lens, k, np.eye(4), None)
        roll_rad = 0.0
    sideways = abs(math.sin(roll_rad)) > math.sin(math.pi / 4)
    width, height = (k.height, k.width) if sideways else (k.width, k.height)
    upright = Pinhole(k.fx, k.fx, (width - 1) / 2, (height - 1) / 2, width, height)
    T = np.eye(4)
    c, s = math.cos(roll_rad), math.sin(roll_rad)
    T[:2, :2] = [[c, -s], [s, c]]
    R = np.ascontiguousarray(T[:3, :3].T)
    D = np.array(lens.distortion or (0.0,) * 4, np.float64)
    make = cv2.fisheye.initUndistortRectifyMap if lens.fisheye else cv2.initUndistortRectifyMap
    maps = make(k.matrix, D, R, upright.matrix, (width, height), cv2.CV_32FC1)
    return Mount(lens, upright, T, (maps[0].astype(np.float32), maps[1].astype(np.float32)))


def straight_color(mount: Mount, color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colour [h, w, 3] of the real camera, remapped to the upright one."""
    if mount.maps is None:
        return color
    return cv2.remap(color, *mount.maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)


def straight_depth(mount: Mount, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth [h, w] of the real camera, remapped to the upright one; 0 outside its image."""
    if mount.maps is None:
        return depth_m
    out = cv2.remap(depth_m, *mount.maps, cv2.INTER_NEAREST, borderValue=0.0)
    return out.astype(np.float32, copy=False)
