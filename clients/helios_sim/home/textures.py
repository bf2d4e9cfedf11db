"""Procedural patterns: grey ones for tinting by a material, and a few coloured ones.

Each pattern is the same in every home (its index in the table seeds its noise); tint and scale
vary.
"""

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]  # [h, w, 3]

_SIDE = 256


def smooth_noise(
    rng: np.random.Generator, shape: tuple[int, int], cell_px: tuple[float, float]
) -> NDArray[np.float32]:
    """Noise of unit standard deviation with blobs of about `cell_px` (vertical, horizontal)."""
    rows = max(2, round(shape[0] / cell_px[0]))
    columns = max(2, round(shape[1] / cell_px[1]))
    coarse = rng.standard_normal((rows, columns)).astype(np.float32)
    coarse = np.pad(coarse, ((0, 1), (0, 1)), mode="wrap")
    image = cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return image.astype(np.float32)


def _grey(value: NDArray[np.floating]) -> Image:
    clipped = np.clip(value * 255, 0, 255).astype(np.uint8)
    return np.repeat(clipped[..., None], 3, axis=2)


def _wood(rng: np.random.Generator) -> Image:
    shape = (_SIDE, _SIDE)
    bands = smooth_noise(rng, shape, (14, 200)) + 0.5 * smooth_noise(rng, shape, (5, 120))
    fibre = smooth_noise(rng, shape, (1.5, 40))
    return _grey(0.9 + 0.05 * bands + 0.03 * fibre)


def _fabric(rng: np.random.Generator) -> Image:
    y, x = np.mgrid[0:_SIDE, 0:_SIDE]
    weave = 0.035 * (np.sin(x * np.pi / 2) + np.sin(y * np.pi / 2))
    return _grey(
        0.9
        + weave
        + 0.03 * smooth_noise(rng, x.shape, (2, 2))
        + 0.02 * smooth_noise(rng, x.shape, (40, 40))
    )


def _marble(rng: np.random.Generator) -> Image:
    shape = (_SIDE, _SIDE)
    cloud = smooth_noise(rng, shape, (64, 64)) + 0.5 * smooth_noise(rng, shape, (24, 24))
    vein = np.exp(-((cloud / 0.12) ** 2))
    return _grey(0.95 - 0.10 * vein + 0.015 * smooth_noise(rng, shape, (3, 3)))


def _plaster(rng: np.random.Generator) -> Image:
    """Plaster; one repeat covers a wall from floor (row 0) to ceiling, darker at both ends."""
    height = np.linspace(0, 2.6, _SIDE)[:, None]
    shade = 1 - 0.22 * np.exp(-height / 0.22) - 0.16 * np.exp(-(2.6 - height) / 0.3)
    fine = 0.008 * smooth_noise(rng, (_SIDE, _SIDE), (3, 3))
    broad = 0.012 * smooth_noise(rng, (_SIDE, _SIDE), (60, 60))
    return _grey(0.97 * shade + fine + broad)


def _ceramic(rng: np.random.Generator) -> Image:
    return _grey(0.96 + 0.006 * smooth_noise(rng, (64, 64), (8, 8)))


def _speckle(rng: np.random.Generator) -> Image:
    dots = (rng.random((_SIDE, _SIDE)) < 0.06).astype(np.float32)
    return _grey(0.95 - 0.35 * cv2.GaussianBlur(dots, (3, 3), 0.8))


def _stripes(rng: np.random.Generator) -> Image:
    y, x = np.mgrid[0:_SIDE, 0:_SIDE]
    band = np.where((y // 32) % 2 == 0, 0.96, 0.72)
    return _grey(band + 0.02 * smooth_noise(rng, x.shape, (2, 2)))


def _checks(rng: np.random.Generator) -> Image:
    y, x = np.mgrid[0:_SIDE, 0:_SIDE]
    band = 0.97 - 0.16 * ((y // 32) % 2) - 0.16 * ((x // 32) % 2)
    return _grey(band + 0.02 * smooth_noise(rng, x.shape, (2, 2)))


def _rug(rng: np.random.Generator) -> Image:
    y, x = np.mgrid[0:_SIDE, 0:_SIDE]
    u, v = x / _SIDE * 8, y / _SIDE * 8
    diamonds = (np.abs(u % 1 - 0.5) + np.abs(v % 1 - 0.5)) * 2
    value = 0.9 - 0.22 * (np.abs(diamonds - 0.6) < 0.16) - 0.12 * (diamonds < 0.25)
    return _grey(value + 0.05 * smooth_noise(rng, x.shape, (1.5, 1.5)))


def _foliage(rng: np.random.Generator) -> Image:
    shape = (_SIDE, _SIDE)
    return _grey(0.8 + 0.12 * smooth_noise(rng, shape, (10, 10)))


def _fur(rng: np.random.Generator) -> Image:
    shape = (128, 128)
    return _grey(
        0.85 + 0.09 * smooth_noise(rng, shape, (2, 3)) + 0.05 * smooth_noise(rng, shape, (14, 14))
    )


def _sky(rng: np.random.Generator) -> Image:
    height = np.linspace(0, 1, 128)[:, None, None]
    low, high = np.array([0.88, 0.92, 0.94]), np.array([0.58, 0.77, 0.96])
    image = low + (high - low) * height * np.ones((1, 128, 1))
    cloud = np.clip(smooth_noise(rng, (128, 128), (16, 40)) * 0.6, 0, 1)[..., None]
    image = image + (1 - image) * cloud * 0.8
    hills = 0.16 + 0.05 * smooth_noise(rng, (2, 128), (2, 30))[0]
    trees = height[:, :, 0] < hills[None, :]
    image[trees] = np.array([0.42, 0.56, 0.36])
    return (np.clip(image, 0, 1) * 255).astype(np.uint8)


def _screen(rng: np.random.Generator) -> Image:
    glow = np.linspace(0.5, 1.0, 64)[:, None] * np.linspace(0.8, 1.0, 64)[None, :]
    del rng
    return _grey(glow)


def _art(rng: np.random.Generator) -> Image:
    """Abstract painting: two ellipses on a soft colour field."""
    side = 128
    palette = rng.uniform(0.25, 0.95, (4, 3))
    field = smooth_noise(rng, (side, side), (40, 60))
    level = np.clip((field * 0.6 + 0.5), 0, 1)[..., None]
    image = np.ascontiguousarray(palette[0] * level + palette[1] * (1 - level), dtype=np.float32)
    for color in palette[2:]:
        center = tuple(int(v) for v in rng.integers(20, side - 20, 2))
        axes = tuple(int(v) for v in rng.integers(10, 36, 2))
        tone = tuple(float(v) for v in color)
        cv2.ellipse(image, center, axes, float(rng.uniform(0, 180)), 0, 360, tone, -1, cv2.LINE_AA)
    return (np.clip(image, 0, 1) * 255).astype(np.uint8)


def _weave(rng: np.random.Generator) -> Image:
    """Wicker of interwoven strands."""
    y, x = np.mgrid[0:_SIDE, 0:_SIDE] / 16.0
    over = (np.floor(x) + np.floor(y)) % 2 == 0
    round_y, round_x = np.sin(np.pi * (y % 1)), np.sin(np.pi * (x % 1))
    value = np.where(over, 0.62 + 0.36 * round_y, 0.52 + 0.3 * round_x)
    return _grey(value + 0.03 * smooth_noise(rng, (_SIDE, _SIDE), (3, 3)))


def _dots(rng: np.random.Generator) -> Image:
    y, x = np.mgrid[0:_SIDE, 0:_SIDE] / 32.0
    shifted = x + 0.5 * (np.floor(y) % 2)
    spot = np.hypot(shifted % 1 - 0.5, y % 1 - 0.5) < 0.26
    return _grey(np.where(spot, 0.55, 0.96) + 0.01 * smooth_noise(rng, spot.shape, (3, 3)))


def _bands(rng: np.random.Generator) -> Image:
    """Rings around lathed objects."""
    y, _ = np.mgrid[0:_SIDE, 0:_SIDE] / _SIDE
    value = np.where((y > 0.35) & (y < 0.5), 0.5, 0.96)
    del rng
    return _grey(np.where((y > 0.58) & (y < 0.62), 0.6, value))


# Pattern -> (length of one repeat in metres, drawing function).
PATTERNS: dict[str, tuple[float, Callable[[np.random.Generator], Image]]] = {
    "wood": (0.8, _wood),
    "fabric": (0.35, _fabric),
    "marble": (1.2, _marble),
    "plaster": (2.6, _plaster),
    "ceramic": (0.3, _ceramic),
    "speckle": (0.3, _speckle),
    "stripes": (0.3, _stripes),
    "checks": (0.4, _checks),
    "rug": (1.0, _rug),
    "foliage": (0.3, _foliage),
    "fur": (0.15, _fur),
    "sky": (1.0, _sky),
    "screen": (1.0, _screen),
    **{f"art{k}": (1.0, _art) for k in range(6)},
    "weave": (0.24, _weave),
    "dots": (0.16, _dots),
    "bands": (0.12, _bands),
}


@lru_cache(maxsize=64)
def pattern(name: str) -> Image:
    """Image of a pattern; row 0 is at v = 0. Raises ValueError for a name not in `PATTERNS`."""
    number = list(PATTERNS).index(name)
    return PATTERNS[name][1](np.random.default_rng([7, number]))


def floor(
    rng: np.random.Generator,
    kind: str,
    rgb: tuple[float, float, float],
    size_m: tuple[float, float],
    px_per_m: float,
) -> NDArray[np.float32]:
    """Floor image [h, w, 3] of a room, from 0 to 1; row 0 is at the low-y edge.

    Raises KeyError for an unknown kind.
    """
    height, width = round(size_m[1] * px_per_m), round(size_m[0] * px_per_m)
    y, x = (np.mgrid[0:height, 0:width] + 0.5) / px_per_m
    shape = (height, width)
    if kind == "planks":
        row = np.floor(y / 0.14).astype(int)
        shift = rng.random(row.max() + 1)[row] * 1.2
        column = np.floor((x + shift) / 1.2).astype(int)
        tone = rng.normal(0, 0.06, (row.max() + 1, column.max() + 1))[row, column]
        grain = smooth_noise(rng, shape, (2.0, 40)) * 0.025
        joint = (np.mod(y, 0.14) < 1 / px_per_m) | (np.mod(x + shift, 1.2) < 1 / px_per_m)
        value = (0.95 + tone + grain) * np.where(joint, 0.72, 1)
    elif kind == "tiles":
        pitch = 0.4
        row, column = np.floor(y / pitch).astype(int), np.floor(x / pitch).astype(int)
        tone = rng.normal(0, 0.02, (row.max() + 1, column.max() + 1))[row, column]
        cloud = smooth_noise(rng, shape, (14, 14)) * 0.012
        joint = (np.mod(y, pitch) < 1.2 / px_per_m) | (np.mod(x, pitch) < 1.2 / px_per_m)
        value = (0.95 + tone + cloud) * np.where(joint, 0.8, 1)
    elif kind == "carpet":
        value = 0.93 + 0.05 * rng.standard_normal(shape) + 0.02 * smooth_noise(rng, shape, (6, 6))
    else:
        raise KeyError(f"no floor {kind!r}; one of planks, tiles, carpet is wanted")
    return (value[..., None] * np.asarray(rgb)).astype(np.float32)
