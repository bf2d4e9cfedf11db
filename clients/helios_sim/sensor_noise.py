"""What a real camera and real odometry do to perfect pictures and poses. Pure and seeded.

Depth, after Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data" (2012): the
sensor measures inverse depth, with an error of constant size, in steps of constant size. So noise
and steps of depth grow with its square: at 4 m, 2.3 cm and 4.6 cm. Neighbouring pixels share part
of their error, as they share the matched patch. Nothing is measured outside the range, in the
shadow behind a depth edge, and where a surface is met at a grazing angle.

Colour: slightly out of focus, and smeared along a line, by an amount of its own for each picture.

Poses: `odometry_drift.py`. The truth (segmentation, metrics) knows nothing of all this.
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
class SensorRealism:
    """How much a robot's senses err; all zeros: not at all."""

    name: str
    inverse_depth_noise_per_m: float = 0.0  # standard deviation; depth_m**2 times this, in metres
    inverse_depth_step_per_m: float = 0.0  # depth_m**2 times this is the step between depths
    edge_per_m: float = 0.0  # step in inverse depth from which an edge throws a shadow; 0: none
    edge_px: int = 0  # width of the shadow
    grazing_cos: float = 0.0  # cosine of the angle to the normal below which nothing is measured
    min_depth_m: float = 0.0
    max_depth_m: float = math.inf
    defocus_px: float = 0.0  # largest standard deviation of the blur
    smear_px: float = 0.0  # largest length of the smear
    drift_m: float = 0.0  # of position, per square root of a metre driven
    drift_rad: float = 0.0  # of heading, per square root of a metre driven
    turn_drift_rad: float = 0.0  # of heading, per square root of a radian turned

    @property
    def errs_in_depth(self) -> bool:
        """Whether depth is anything but exact."""
        errors = (self.inverse_depth_noise_per_m, self.inverse_depth_step_per_m, self.edge_per_m)
        limits = (self.grazing_cos, self.min_depth_m, 1 / self.max_depth_m)
        return any(value > 0 for value in (*errors, *limits))

    @property
    def drifts(self) -> bool:
        """Whether poses are anything but exact."""
        return max(self.drift_m, self.drift_rad, self.turn_drift_rad) > 0


SENSORS: dict[str, SensorRealism] = {
    sensor.name: sensor
    for sensor in (
        SensorRealism("none"),
        SensorRealism(
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
_SHARED = 0.7  # part of the noise's deviation that neighbours share
_PATCH_PX = 2.0
_GRAZING_SPREAD = 0.25


def sensed_depth(
    depth_m: Depth, camera: Pinhole, sensor: SensorRealism, seed: int, stamp_ns: int
) -> Depth:
    """Depth as the sensor measures it. The same seed and stamp give the same noise."""
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
    """Cosine of the angle between each pixel's ray and the surface's normal [h, w], 0 to 1.

    A plane is linear in inverse depth, i = gx x + gy y + c with x and y the pixel's tangents: its
    normal points along (gx, gy, c), and the ray times the normal is i itself.
    """
    x, y, away = _rays(camera)
    gx = cv2.Sobel(inverse, cv2.CV_32F, 1, 0, ksize=3, scale=camera.fx / 8)
    gy = cv2.Sobel(inverse, cv2.CV_32F, 0, 1, ksize=3, scale=camera.fy / 8)
    c = inverse - gx * x - gy * y
    normal: Depth = np.sqrt(gx * gx + gy * gy + c * c)
    return np.divide(inverse, normal * away + np.float32(1e-12), dtype=np.float32)


def sensed_color(color: Color, sensor: SensorRealism, seed: int, stamp_ns: int) -> Color:
    """Colour as the camera takes it: out of focus, and smeared."""
    rng = np.random.default_rng([seed, stamp_ns, 2])
    sigma, length = sensor.defocus_px * rng.random(), sensor.smear_px * rng.random() ** 2
    angle = rng.normal(0.0, 0.3)  # a robot turns and rolls on: smears lie about level
    if sigma > 0.2:
        color = cv2.GaussianBlur(color, (0, 0), sigma).astype(np.uint8, copy=False)
    if length > 1.0:
        color = cv2.filter2D(color, -1, smear_kernel(length, angle)).astype(np.uint8, copy=False)
    return color


def smear_kernel(length_px: float, angle_rad: float) -> NDArray[np.float32]:
    """Weights [n, n] of a straight smear; they add up to 1."""
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
    """Pixels [h, w] at too small an angle, with a ragged edge; looked at on every second pixel."""
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
    """Tangents x [1, w] and y [h, 1] of the pixels, and the length of their rays per metre."""
    x = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)[None, :]
    y = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)[:, None]
    return x, y, np.sqrt(1 + x * x + y * y)


@lru_cache(maxsize=1)
def _bank() -> Depth:
    """A field of noise of deviation 1, of which pictures take pieces [1024, 1024]."""
    rng = np.random.default_rng(0x5E45)
    own = rng.standard_normal((_BANK_PX, _BANK_PX), np.float32)
    shared = cv2.GaussianBlur(
        rng.standard_normal((_BANK_PX, _BANK_PX), np.float32), (0, 0), _PATCH_PX
    )
    shared /= shared.std()
    return np.float32(_SHARED) * shared + np.float32(math.sqrt(1 - _SHARED**2)) * own


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> Depth:
    """A piece [h, w] of the field, mirrored or not."""
    height, width = shape
    bank = _bank()
    if height > _BANK_PX or width > _BANK_PX:
        bank = np.tile(bank, (-(-height // _BANK_PX), -(-width // _BANK_PX)))
    row = rng.integers(bank.shape[0] - height + 1)
    column = rng.integers(bank.shape[1] - width + 1)
    piece = np.ascontiguousarray(bank[row : row + height, column : column + width])
    mirror = int(rng.integers(4))
    return piece if mirror == 3 else cv2.flip(piece, mirror - 1).astype(np.float32, copy=False)
