"""Noise of the simulated detector: its table, and draws that repeat for the same view.

Fusion by counting assumes independent errors, but real detectors err by object and viewpoint. So an
error is a fixed function of (seed, table, object instance, 30 degree viewing sector, distance band,
visible-pixel band). A given share of the draws is redrawn in each frame.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.name_rules import plain
from numpy.typing import NDArray

from helios_detector.simulation.table_files import read_table
from helios_detector.simulation.view_noise_table import ViewNoiseTable, view_table

_STANDARD = NormalDist()


@dataclass(frozen=True)
class Knots:
    """Piecewise linear function, constant beyond its ends; `log`: over a logarithmic axis."""

    at: tuple[float, ...]
    value: tuple[float, ...]
    log: bool = False

    def __call__(self, x: float) -> float:
        if self.log:
            return float(np.interp(math.log(max(x, 1e-9)), np.log(self.at), self.value))
        return float(np.interp(x, self.at, self.value))


@dataclass(frozen=True)
class NoiseTable:
    """Error rates of a simulated detector, 0 to 1; see `noise_tables/demo-v1.toml`."""

    name: str
    digest: str  # hash of the file and its bases, which identifies the table in use
    redrawn: float
    score_jitter: float
    sector_rad: float
    distance_bands_m: tuple[float, ...]
    pixel_bands: tuple[float, ...]
    always_missed_below_px: int
    miss_by_pixels: Knots
    miss_by_distance: Knots
    true_score: tuple[float, float]  # mean, standard deviation
    confused_score: tuple[float, float]
    false_score: tuple[float, float]
    score_factor_by_pixels: Knots
    erode_px: int
    false_positive: float
    false_never_on: frozenset[str]  # normalised true classes
    false_radius_m: float
    false_min_px: int
    confusion: Mapping[str, Mapping[str, float]]  # normalised true class -> reported -> probability
    level: float = field(default=1.0)

    def scaled(self, level: float, correlation: float | None = None) -> NoiseTable:
        """The table with error rates and magnitudes multiplied by `level`. `correlation` 1 redraws
        nothing per frame, 0 everything. Raises InvalidInput outside their ranges."""
        if not 0 <= level <= 10:
            raise InvalidInput(f"the noise level is {level}; wanted 0 to 10")
        if correlation is not None and not 0 <= correlation <= 1:
            raise InvalidInput(f"the noise correlation is {correlation}; wanted 0 to 1")
        redrawn = self.redrawn if correlation is None else 1.0 - correlation
        return replace(self, level=level, redrawn=redrawn)

    def miss(self, visible_px: int, distance_m: float) -> float:
        """Probability that an object is not reported."""
        seen = (1 - self.miss_by_pixels(visible_px)) * (1 - self.miss_by_distance(distance_m))
        return min(1.0, self.level * (1 - seen))

    def cell(self, sector_rad: float, distance_m: float, visible_px: int) -> tuple[int, int, int]:
        """The discrete view that errors depend on: sector, distance band, pixel band."""
        return (
            int((sector_rad % math.tau) / self.sector_rad),
            int(np.searchsorted(self.distance_bands_m, distance_m)),
            int(np.searchsorted(self.pixel_bands, visible_px)),
        )


class Draws:
    """Random numbers by name for one object in one view."""

    def __init__(self, key: str, stamp_ns: int, redrawn: float) -> None:
        self._key, self._stamp_ns, self._redrawn = key, stamp_ns, redrawn

    def uniform(self, purpose: str) -> float:
        """Number in (0, 1), fixed by the view or, for a share `redrawn`, by the frame."""
        key = f"{self._key}/{purpose}"
        if self._redrawn > 0 and hashed(f"{key}/redrawn/{self._stamp_ns}") < self._redrawn:
            return hashed(f"{key}/{self._stamp_ns}")
        return hashed(key)

    def normal(self, purpose: str) -> float:
        """Standard normal number, fixed by the view or the frame like `uniform`."""
        return _STANDARD.inv_cdf(self.uniform(purpose))

    def frame_normal(self, purpose: str) -> float:
        """Standard normal number, fixed by the frame."""
        return _STANDARD.inv_cdf(hashed(f"{self._key}/{purpose}/{self._stamp_ns}"))


def hashed(key: str) -> float:
    """Number in (0, 1) that depends only on the key, on any machine."""
    number = int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "big")
    return (number + 0.5) / (2**64 + 1)


def hashed_voxels(voxels: NDArray[np.int64], key: str) -> NDArray[np.uint64]:
    """One number per voxel [n, 3] that depends only on the voxel and the key (splitmix64)."""
    salt = int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "big")
    out = np.full(len(voxels), salt, np.uint64)
    for column in voxels.T:
        out = (out ^ column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        out = (out ^ (out >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        out ^= out >> np.uint64(27)
    return out


def load_noise(name_or_path: str) -> NoiseTable | ViewNoiseTable:
    """A table by name or from a file; a `ViewNoiseTable` if it contains `format = "views"`.

    `table_files.py` explains the entry `base`. Raises InvalidInput for a missing or invalid table.
    """
    table, digest = read_table(name_or_path)
    try:
        return view_table(table, digest) if "format" in table else _table(table, digest)
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(
            f"the noise table {name_or_path!r} is wrong ({type(error).__name__}: {error}); it "
            'needs the entries of demo-v1.toml, or with format = "views" those of ovmm-v1.toml; '
            'base = "ovmm-v1" takes over the entries that are missing'
        ) from error


def _table(t: dict[str, Any], digest: str) -> NoiseTable:
    miss, score, false = t["miss"], t["score"], t["false_positive"]
    confusion = {
        plain(true): {str(name): float(p) for name, p in row.items()}
        for true, row in t["confusion"].items()
    }
    probabilities = [t["redrawn"], false["probability"], *miss["by_pixels"], *miss["by_distance"]]
    probabilities += [sum(row.values()) for row in confusion.values()]
    if not all(0 <= p <= 1 for p in probabilities):
        raise ValueError("a probability is outside 0 to 1")
    return NoiseTable(
        name=str(t["name"]),
        digest=digest,
        redrawn=float(t["redrawn"]),
        score_jitter=float(t["score_jitter"]),
        sector_rad=math.radians(t["bands"]["sector_deg"]),
        distance_bands_m=tuple(map(float, t["bands"]["distance_m"])),
        pixel_bands=tuple(map(float, t["bands"]["pixels"])),
        always_missed_below_px=int(miss["always_below_px"]),
        miss_by_pixels=_knots(miss["pixels"], miss["by_pixels"], log=True),
        miss_by_distance=_knots(miss["distance_m"], miss["by_distance"]),
        true_score=(float(score["true_mean"]), float(score["true_sd"])),
        confused_score=(float(score["confused_mean"]), float(score["confused_sd"])),
        false_score=(float(score["false_mean"]), float(score["false_sd"])),
        score_factor_by_pixels=_knots(score["pixels"], score["factor_by_pixels"], log=True),
        erode_px=int(t["mask"]["erode_px"]),
        false_positive=float(false["probability"]),
        false_never_on=frozenset(plain(str(name)) for name in false["never_on"]),
        false_radius_m=float(false["radius_m"]),
        false_min_px=int(false["min_px"]),
        confusion=confusion,
    )


def _knots(at: list[float], value: list[float], log: bool = False) -> Knots:
    if len(at) != len(value) or not at or sorted(at) != at:
        raise ValueError(f"{len(at)} ascending places for {len(value)} values")
    return Knots(tuple(map(float, at)), tuple(map(float, value)), log)
