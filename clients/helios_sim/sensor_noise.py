"""Sensor noise model for depth and colour images. Pure functions with seeds.

Depth, after Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data" (2012): the
sensor measures inverse depth with constant noise and constant quantization. Noise and step of the
depth therefore grow with its square: at 4 m, 2.3 cm and 4.6 cm. Neighbouring pixels share part of
their error because they share the matched patch. Depth is invalid outside the range, in the shadow
behind a depth edge, and at grazing angles.

Colour: slight defocus and linear motion blur, with random amounts for each image.

Poses: `odometry_drift.py`. Ground truth (segmentation, metrics) has none of these errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from helios_core.geometry import Pinhole
from numpy.typing import NDArray

Depth = NDArray[np.float32]  # [h, w] m along the optical axis; 0 is invalid
Color = NDArray[np.uint8]  # [h, w, 3]


@dataclass(frozen=True)
class SensorErrorModel:
    """Error parameters of a robot's sensors; with the defaults they are exact."""

    name: str
    inverse_depth_noise_per_m: float = 0.0  # standard deviation; in depth: depth_m**2 times this
    inverse_depth_step_per_m: float = 0.0  # quantization step; in depth: depth_m**2 times this
    edge_per_m: float = 0.0  # smallest step in inverse depth that casts a shadow; 0: no shadows
    edge_px: int = 0  # width of the shadow
    grazing_cos: float = 0.0  # depth is invalid below this cosine of the incidence angle
    min_depth_m: float = 0.0
    max_depth_m: float = math.inf
    defocus_px: float = 0.0  # maximum standard deviation of the defocus blur
    smear_px: float = 0.0  # maximum length of the motion blur
    drift_m: float = 0.0  # position drift per square root of a metre driven
    drift_rad: float = 0.0  # heading drift per square root of a metre driven
    turn_drift_rad: float = 0.0  # heading drift per square root of a radian turned

    @property
    def errs_in_depth(self) -> bool:
        """True if depth has errors."""
        errors = (self.inverse_depth_noise_per_m, self.inverse_depth_step_per_m, self.edge_per_m)
        limits = (self.grazing_cos, self.min_depth_m, 1 / self.max_depth_m)
        return any(value > 0 for value in (*errors, *limits))

    @property
    def drifts(self) -> bool:
        """True if poses have errors."""
        return max(self.drift_m, self.drift_rad, self.turn_drift_rad) > 0


SENSORS: dict[str, SensorErrorModel] = {
    sensor.name: sensor
    for sensor in (
        SensorErrorModel("none"),
        SensorErrorModel(
            "realistic",
            inverse_depth_noise_per_m=1.425e-3,
            inverse_depth_step_per_m=2.85e-3,
            edge_per_m=0.03,
            edge_px=2,
            grazing_cos=0.12,
            min_depth_m=0.3,
            max_depth_m=6.0,
            defocus_px=0.9,
            smear_px=5.0,
            drift_m=0.01,
            drift_rad=math.radians(0.1),
            turn_drift_rad=math.radians(0.2),
        ),
    )
}

_BANK_PX = 1024
_SHARED = 0.7  # share of the noise's standard deviation that is common to neighbours
_PATCH_PX = 2.0
_GRAZING_SPREAD = 0.25


def sensed_depth(
    depth_m: Depth, camera: Pinhole, sensor: SensorErrorModel, seed: int, stamp_ns: int
) -> Depth:
    """Depth with sensor errors. The same seed and stamp give the same noise."""
    if not sensor.errs_in_depth:
        return depth_m
    rng = np.random.default_rng([seed, stamp_ns, 1])
    inverse = np.reciprocal(np.maximum(depth_m, np.float32(1e-3)))
    unseen = depth_m <= 0
    inverse[unseen] = 0.0
    lost = unseen
    if sensor.edge_per_m > 0:
        shadow = np.ones((2 * sensor.edge_px + 1,) * 2, np.uint8)
        rise = cv2.subtract(cv2.dilate(inverse, shadow), inverse)
        lost = lost | (rise > sensor.edge_per_m)
    if sensor.grazing_cos > 0:
        lost = lost | _grazed(inverse, camera, sensor.grazing_cos, rng)
    if sensor.inverse_depth_noise_per_m > 0:
        noise = _noise(rng, depth_m.shape)
        inverse = cv2.addWeighted(inverse, 1.0, noise, sensor.inverse_depth_noise_per_m, 0.0)
    if sensor.inverse_depth_step_per_m > 0:
        step = np.float32(sensor.inverse_depth_step_per_m)
        inverse *= 1 / step
        np.rint(inverse, out=inverse)
        inverse *= step
    lost = lost | (inverse <= np.float32(1 / sensor.max_depth_m))
    if sensor.min_depth_m > 0:
        lost |= inverse >= np.float32(1 / sensor.min_depth_m)
    inverse[lost] = np.inf
    return np.reciprocal(inverse, out=inverse)


def incidence_cos(inverse: Depth, camera: Pinhole) -> Depth:
    """Cosine of the angle between each pixel's ray and the surface normal [h, w], 0 to 1.

    A plane is linear in inverse depth, i = gx x + gy y + c, with x and y the pixel's tangents: its
    normal points along (gx, gy, c), and the scalar product of ray and normal is i itself.
    """
    x, y, away = _rays(camera)
    gx = cv2.Sobel(inverse, cv2.CV_32F, 1, 0, ksize=3, scale=camera.fx / 8)
    gy = cv2.Sobel(inverse, cv2.CV_32F, 0, 1, ksize=3, scale=camera.fy / 8)
    c = inverse - gx * x - gy * y
    normal: Depth = np.sqrt(gx * gx + gy * gy + c * c)
    return np.divide(inverse, normal * away + np.float32(1e-12), dtype=np.float32)


def sensed_color(color: Color, sensor: SensorErrorModel, seed: int, stamp_ns: int) -> Color:
    """Colour image with defocus and motion blur."""
    rng = np.random.default_rng([seed, stamp_ns, 2])
    sigma, length = sensor.defocus_px * rng.random(), sensor.smear_px * rng.random() ** 2
    angle = rng.normal(0.0, 0.3)  # a robot turns and drives: motion blur is almost horizontal
    if sigma > 0.2:
        color = cv2.GaussianBlur(color, (0, 0), sigma).astype(np.uint8, copy=False)
    if length > 1.0:
        color = cv2.filter2D(color, -1, smear_kernel(length, angle)).astype(np.uint8, copy=False)
    return color


def smear_kernel(length_px: float, angle_rad: float) -> NDArray[np.float32]:
    """Kernel [n, n] of a linear motion blur; its weights add up to 1."""
    half = math.ceil(length_px / 2)
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    along = np.linspace(-length_px / 2, length_px / 2, 8 * half + 1)
    u = np.rint(half + along * math.cos(angle_rad)).astype(int)
    v = np.rint(half + along * math.sin(angle_rad)).astype(int)
    np.add.at(kernel, (v, u), 1.0)
    return kernel / kernel.sum()


def _grazed(
    inverse: Depth, camera: Pinhole, limit: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Mask [h, w] of pixels at a grazing angle, with a noisy border; computed at half size."""
    half = Pinhole(
        camera.fx / 2,
        camera.fy / 2,
        camera.cx / 2,
        camera.cy / 2,
        (camera.width + 1) // 2,
        (camera.height + 1) // 2,
    )
    cos = incidence_cos(np.ascontiguousarray(inverse[::2, ::2]), half)
    ragged = cv2.addWeighted(cos, 1.0, _noise(rng, cos.shape), -limit * _GRAZING_SPREAD, 0.0)
    grazed = (ragged < limit).astype(np.uint8)
    size = (camera.width, camera.height)
    return cv2.resize(grazed, size, interpolation=cv2.INTER_NEAREST).view(np.bool_)


@lru_cache(maxsize=4)
def _rays(camera: Pinhole) -> tuple[Depth, Depth, Depth]:
    """Tangents x [1, w] and y [h, 1] of the pixels, and ray lengths [h, w] per metre of depth."""
    x = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)[None, :]
    y = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)[:, None]
    return x, y, np.sqrt(1 + x * x + y * y)


@lru_cache(maxsize=1)
def _bank() -> Depth:
    """Noise field [1024, 1024] of standard deviation 1, from which images take crops."""
    rng = np.random.default_rng(0x5E45)
    own = rng.standard_normal((_BANK_PX, _BANK_PX), np.float32)
    shared = cv2.GaussianBlur(
        rng.standard_normal((_BANK_PX, _BANK_PX), np.float32), (0, 0), _PATCH_PX
    )
    shared /= shared.std()
    return np.float32(_SHARED) * shared + np.float32(math.sqrt(1 - _SHARED**2)) * own


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> Depth:
    """Random crop [h, w] of the noise field, randomly mirrored."""
    height, width = shape
    bank = _bank()
    if height > _BANK_PX or width > _BANK_PX:
        bank = np.tile(bank, (-(-height // _BANK_PX), -(-width // _BANK_PX)))
    row = rng.integers(bank.shape[0] - height + 1)
    column = rng.integers(bank.shape[1] - width + 1)
    piece = np.ascontiguousarray(bank[row : row + height, column : column + width])
    mirror = int(rng.integers(4))
    return piece if mirror == 3 else cv2.flip(piece, mirror - 1).astype(np.float32, copy=False)
