"""Search of all turns and shifts: correlation of the present map with the stored one.

For each turn, one Fourier transform scores all shifts on a coarse grid. Surfaces count for shifts
that put them on stored surfaces and against those that put them on free floor; free floor counts
against shifts that put it into obstacles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from helios_map2d.relocalisation.grid_fields import PresentPoints, StoredFields
from helios_map2d.relocalisation.poses import Points, Transform2

COARSE_M = 0.1  # about the size of a coarse cell
TURNS = 144
_BLUR_M = 0.1  # standard deviation of a surface
_FAR_M = 0.25  # a surface this far from any stored one, on free floor, contradicts
CONTRADICTED_SURFACE = 0.5  # weight against, in weights of an agreeing surface
CONTRADICTED_FREE_PER_M = 3.0  # metres of surface that a square metre of floor in obstacles costs
_INSIDE_M = 0.1  # floor counts as inside an obstacle from this depth
_APART_CELLS = 3  # between two maxima of one turn
APART_M, APART_RAD = 0.3, math.radians(6)  # between two distinct transforms
_PER_TURN = 6


@dataclass(frozen=True)
class Candidate:
    """Coarse transform and its score, in metres of agreeing surface."""

    T_stored_present: Transform2
    score_m: float


def candidates(stored: StoredFields, present: PresentPoints, most: int) -> list[Candidate]:
    """The best distinct transforms, best first."""
    factor = max(1, round(COARSE_M / stored.grid.cell_m))
    cell_m = factor * stored.grid.cell_m
    for_surface, for_floor = (_shrunk(field, factor) for field in _fields(stored))
    centre = present.centre_m
    surface, floor = present.surface_m - centre, present.free_m - centre
    reach = max(float(np.hypot(*points.T).max(initial=0)) for points in (surface, floor))
    half = math.ceil(reach / cell_m) + 1
    shape = tuple(_fast_length(n + 2 * half + 1) for n in for_surface.shape)
    spectra = [fft.rfft2(field, shape) for field in (for_surface, for_floor)]
    weights = (present.surface_weight_m, -CONTRADICTED_FREE_PER_M * present.free_weight_m2)
    found: list[Candidate] = []
    for yaw_rad in np.arange(TURNS) * (math.tau / TURNS):
        turn = Transform2(0.0, 0.0, float(yaw_rad))
        total = np.zeros((shape[0], shape[1] // 2 + 1), np.complex64)
        for points, spectrum, weight in zip((surface, floor), spectra, weights, strict=True):
            splat = _splat(turn.of(points) / cell_m, half, shape, weight)
            total += np.asarray(spectrum) * np.conj(np.asarray(fft.rfft2(splat)))
        scores = np.asarray(fft.irfft2(total, shape), np.float32)
        for row, column, score in _peaks(scores):
            # Cell (row, column) of the stored grid lies under the corner of the splat.
            row = row - shape[0] if row > shape[0] - half - 1 else row
            column = column - shape[1] if column > shape[1] - half - 1 else column
            x_m = stored.grid.origin_m[0] + (column + half + 0.5) * cell_m
            y_m = stored.grid.origin_m[1] + (row + half + 0.5) * cell_m
            x, y = np.array([x_m, y_m]) - turn.of(centre[None])[0]
            found.append(Candidate(Transform2(float(x), float(y), float(yaw_rad)), score))
    return _distinct(sorted(found, key=lambda c: -c.score_m), centre, most)


def _fast_length(least: int) -> int:
    """Next length of which a Fourier transform is fast."""
    length = fft.next_fast_len(least, real=True)
    assert length is not None
    return length


def _fields(stored: StoredFields) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Agreement of a surface at each cell, and whether floor there would be inside an obstacle."""
    away = stored.surface_m
    agree = np.exp(-0.5 * (away / _BLUR_M) ** 2)
    agree = np.where(stored.known, agree, 0)
    against = stored.free & (away > _FAR_M)
    for_surface = np.where(against, -CONTRADICTED_SURFACE, agree).astype(np.float32)
    for_floor = (stored.inside_m > _INSIDE_M).astype(np.float32)
    return for_surface, for_floor


def _shrunk(field: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Means over squares of cells."""
    rows, columns = (-(-n // factor) * factor for n in field.shape)
    padded = np.zeros((rows, columns), np.float32)
    padded[: field.shape[0], : field.shape[1]] = field
    blocks = padded.reshape(rows // factor, factor, columns // factor, factor)
    return blocks.mean(axis=(1, 3))


def _splat(points: Points, half: int, shape: tuple[int, ...], weight: float) -> NDArray[np.float32]:
    """Sum of the weights of points [n, 2] (cells) by cell; their origin is at (half, half)."""
    at = np.floor(points + half + 0.5).astype(np.intp)
    flat = np.bincount(at[:, 1] * shape[1] + at[:, 0], minlength=shape[0] * shape[1])
    return (flat * weight).astype(np.float32).reshape(shape)


def _peaks(scores: NDArray[np.float32]) -> list[tuple[int, int, float]]:
    size = 2 * _APART_CELLS + 1
    top = (scores == ndimage.maximum_filter(scores, size, mode="wrap")) & (scores > 0)
    rows, columns = np.nonzero(top)
    best = np.argsort(-scores[rows, columns])[:_PER_TURN]
    return [(int(rows[i]), int(columns[i]), float(scores[rows[i], columns[i]])) for i in best]


def _distinct(found: list[Candidate], centre: Points, most: int) -> list[Candidate]:
    out: list[Candidate] = []
    for one in found:
        if all(
            away > APART_M or turned > APART_RAD
            for away, turned in (
                one.T_stored_present.difference(other.T_stored_present, centre) for other in out
            )
        ):
            out.append(one)
            if len(out) == most:
                break
    return out
