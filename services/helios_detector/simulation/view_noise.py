"""Persistent random draws: errors correlated by object, viewing direction, view and frame.

Real detectors err by object and viewpoint, so errors of neighbouring views must not be independent.
Each draw (missed or not, reported class, score, ...) is one standard normal number from a Gaussian
copula over four levels, with variance shares that add up to 1:

    z = √thing·n(thing) + √side·n(thing, angle) + √view·n(thing, cell) + √frame·n(thing, stamp)

All n are standard normal numbers hashed from (seed, name of the object, purpose of the draw) and
the level's own key. So z is standard normal and Φ(z) uniform for any shares: the shares set the
correlation of errors, never their rate. `thing` is the object. `angle` and `cell` locate the camera
as seen from the object. Here they are 12 viewing sectors of 30 degrees, fixed in the world; `cell`
adds the bands of distance and of visible pixels. `smooth_view_noise.py` has the other way to draw
the two terms, without sectors and bands. The `side` term is a field on the circle: four knots 90
degrees apart, interpolated at the sector's middle and scaled to unit variance. In units of the
`side` share, neighbouring sectors correlate by 0.83 to 0.96, sectors 90 degrees apart by 0.2 to
0.5, opposite ones by 0, so that an object may be mistaken from one direction only.

Correlation 1 distributes the frame's share over the other three in their ratios, so the view fixes
every error. Correlation 0 gives the whole variance to the frame. Unset, the table's shares hold:
with the frame's share f, z of two frames of one view correlate by 1 - f, and a binary error at even
odds differs between them with probability acos(1 - f) / π: 0.14 for f = 0.1.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

SECTORS = 12
SIDES = 4

Rows = slice | NDArray[np.int64]
Term = tuple[NDArray[np.float64], NDArray[np.float64]]  # weights and normals, broadcast to [n, p]

_THING, _SIDE, _VIEW, _FRAME = (np.array([n], np.uint64) for n in range(1, 5))


@dataclass(frozen=True)
class Shares:
    """Variance shares of a draw by level (see the module); they add up to 1."""

    thing: float
    side: float
    view: float
    frame: float

    def correlated(self, correlation: float) -> Shares:
        """Shares with 1 - `correlation` for the frame and the rest in the same ratios.

        Raises ValueError if the frame has the whole variance and `correlation` is above 0.
        """
        fixed = self.thing + self.side + self.view
        if fixed == 0 and correlation > 0:
            raise ValueError("the frame has the whole variance; nothing is there to be correlated")
        k = correlation / fixed if fixed else 0.0
        return Shares(k * self.thing, k * self.side, k * self.view, 1.0 - correlation)


class Views(Protocol):
    """The views of n objects. The squared weights of the terms of one level add up to 1."""

    @property
    def keys(self) -> NDArray[np.uint64]:
        """Hash [n] of the seed and the object."""
        ...

    def __len__(self) -> int: ...

    def part(self, rows: Rows) -> Self:
        """The views of these objects only."""
        ...

    def side_terms(self, hashes: NDArray[np.uint64]) -> Iterator[Term]:
        """Terms of the side; hashes: [n, p] of the objects and p purposes."""
        ...

    def view_terms(self, hashes: NDArray[np.uint64]) -> Iterator[Term]:
        """Terms of the view; hashes: [n, p] of the objects and p purposes."""
        ...


@dataclass(frozen=True)
class SectorViews:
    """The views of n objects, by world-aligned sectors and bands."""

    keys: NDArray[np.uint64]  # [n] hash of the seed and the object
    sectors: NDArray[np.int64]  # [n] 0 to 11
    cells: NDArray[np.int64]  # [n] sector, distance band and pixel band in one number

    def __len__(self) -> int:
        return len(self.keys)

    def part(self, rows: Rows) -> SectorViews:
        """The views of these objects only."""
        return SectorViews(self.keys[rows], self.sectors[rows], self.cells[rows])

    def side_terms(self, hashes: NDArray[np.uint64]) -> Iterator[Term]:
        """The two knots around the middle of the sector; hashes: [n, p]."""
        knots, weights = _sides()
        for k in range(2):
            knot, weight = knots[self.sectors, k, None], weights[self.sectors, k, None]
            yield weight, normals(mixed(hashes, knot))

    def view_terms(self, hashes: NDArray[np.uint64]) -> Iterator[Term]:
        """One number for each cell; hashes: [n, p]."""
        cell = self.cells.astype(np.uint64)[:, None]
        yield np.ones(1), normals(mixed(hashes, cell))


@lru_cache(maxsize=65536)
def key_of(text: str) -> int:
    """64-bit hash that depends only on the text, on any machine."""
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")


def keys_of(texts: Sequence[str]) -> NDArray[np.uint64]:
    """Hashes [n] of the texts."""
    return np.array([key_of(text) for text in texts], np.uint64)


def mixed(key: NDArray[np.uint64], value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Combined hash of key and value, in this order, broadcast to one shape (splitmix64)."""
    out = key + (value + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    out = (out ^ (out >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    out = (out ^ (out >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return out ^ (out >> np.uint64(31))


def normals(keys: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Standard normal number of each key (Box-Muller)."""
    u = ((keys >> np.uint64(32)).astype(np.float64) + 0.5) / 2**32
    v = (keys & np.uint64(0xFFFFFFFF)).astype(np.float64) / 2**32
    return np.sqrt(-2 * np.log(u)) * np.cos(math.tau * v)


def uniform(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Φ(z): uniform numbers from standard normal ones."""
    erf = [math.erf(x) for x in (z / math.sqrt(2)).ravel().tolist()]
    return 0.5 + 0.5 * np.array(erf, np.float64).reshape(z.shape)


def angles_of(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Viewing angle [n] in rad, 0 to 2π, of a camera at xy_m [n, 2] relative to the object."""
    return np.arctan2(xy_m[:, 1], xy_m[:, 0]) % math.tau


def sectors_of(xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Viewing sector [n] of the camera from its position [n, 2] relative to the object."""
    turn = angles_of(xy_m)
    return np.minimum((turn * (SECTORS / math.tau)).astype(np.int64), SECTORS - 1)


def normal_draws(
    views: Views, purposes: NDArray[np.uint64], shares: Shares, stamp_ns: int
) -> NDArray[np.float64]:
    """Standard normal draws [n, p]; each level repeats its term for the same key.

    purposes: [p], or [n, p] for purposes of each object.
    """
    base = mixed(views.keys[:, None], np.atleast_2d(purposes))
    out = np.zeros(base.shape)
    if shares.thing > 0:
        out += math.sqrt(shares.thing) * normals(mixed(base, _THING))
    if shares.side > 0:
        for weight, z in views.side_terms(mixed(base, _SIDE)):
            out += math.sqrt(shares.side) * weight * z
    if shares.view > 0:
        for weight, z in views.view_terms(mixed(base, _VIEW)):
            out += math.sqrt(shares.view) * weight * z
    if shares.frame > 0:
        out += math.sqrt(shares.frame) * frame_normals(base, stamp_ns)
    return out


def frame_normals(hashes: NDArray[np.uint64], stamp_ns: int) -> NDArray[np.float64]:
    """Standard normal numbers that the frame fixes; hashes: of the objects and purposes."""
    stamp = np.array([stamp_ns], np.int64).view(np.uint64)
    return normals(mixed(mixed(hashes, _FRAME), stamp))


@lru_cache(maxsize=1)
def _sides() -> tuple[NDArray[np.uint64], NDArray[np.float64]]:
    """(the two knots [12, 2] around each sector's middle, their weights [12, 2])."""
    at = (np.arange(SECTORS) + 0.5) * SIDES / SECTORS
    low = np.floor(at)
    knots = np.stack([low, (low + 1) % SIDES], -1).astype(np.uint64)
    weights = np.stack([1 - (at - low), at - low], -1)
    return knots, weights / np.linalg.norm(weights, axis=-1, keepdims=True)
