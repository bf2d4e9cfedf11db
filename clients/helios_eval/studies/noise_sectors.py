"""How errors that depend on the view are correlated, by noise table.

    python -m helios_eval.studies.noise_sectors ovmm-v1 ovmm-v1-smooth

The agent `helios` counts evidence by world-aligned sectors of 30 degrees. For each table the
program prints the correlation of the draws of one object in two frames, by the angle between the
views at one distance. Then it prints the share of the variance of side and view that is constant
within a sector: the correlation of two random views of one sector. Sectors "shifted" lie 15 degrees
beside those of the agent. "Boundary" is the correlation of two views 1 degree apart on both sides
of a boundary of the agent's sectors; "middle" the same around the middle of a sector.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from helios_core.errors import HeliosError
from helios_detector.simulation.view_noise import Shares, key_of, keys_of, normal_draws
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from helios_eval.studies.noise_plot import view_table

OBJECTS = 50_000
SECTOR_DEG = 30.0
DISTANCE_M = 2.5
NEAR_FAR_M = (1.5, 3.5)
ANGLES_DEG = (5, 10, 15, 30, 45, 60, 90, 120, 180)
_KEYS = np.array([key_of(f"object {n}") for n in range(OBJECTS)], np.uint64)
_PURPOSE = keys_of(("miss",))

Places = NDArray[np.float64]


def drawn(
    table: ViewNoiseTable, shares: Shares, angles_deg: Places, distances_m: Places, stamp_ns: int
) -> Places:
    """Draws [n] of n objects, each seen from its own angle and distance, both [n]."""
    turn = np.radians(angles_deg)
    eyes_m = distances_m[:, None] * np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
    views, _ = table.views(_KEYS[: len(turn)], np.zeros(3), -eyes_m, None)
    return normal_draws(views, _PURPOSE, shares, stamp_ns)[:, 0]


def by_angle(table: ViewNoiseTable, apart_deg: float) -> float:
    """Correlation of two frames with this angle between the views, over all directions."""
    first = np.random.default_rng(0).uniform(0, 360, OBJECTS)
    far = np.full(OBJECTS, DISTANCE_M)
    return _correlation(
        drawn(table, table.shares, first, far, 1),
        drawn(table, table.shares, first + apart_deg, far, 2),
    )


def constant(table: ViewNoiseTable, shift_deg: float, near_far_m: tuple[float, float]) -> float:
    """Share of the variance of side and view that is constant in a sector of 30 degrees.

    shift_deg: of the sectors from those of the agent; near_far_m: range of the distances.
    """
    rng = np.random.default_rng(1)
    sector = rng.integers(0, 12, OBJECTS) * SECTOR_DEG + shift_deg
    pair = [
        drawn(
            table,
            side_and_view(table),
            sector + rng.uniform(0, SECTOR_DEG, OBJECTS),
            rng.uniform(*near_far_m, OBJECTS),
            1,
        )
        for _ in range(2)
    ]
    return _correlation(*pair)


def across(table: ViewNoiseTable, angle_deg: float) -> float:
    """Correlation of side and view half a degree before and behind this angle of each sector."""
    sector = np.random.default_rng(2).integers(0, 12, OBJECTS) * SECTOR_DEG + angle_deg
    sector = sector.astype(np.float64)
    far = np.full(OBJECTS, DISTANCE_M)
    shares = side_and_view(table)
    return _correlation(*(drawn(table, shares, sector + by, far, 1) for by in (-0.5, 0.5)))


def side_and_view(table: ViewNoiseTable) -> Shares:
    """The table's shares of side and view alone, scaled to add up to 1."""
    s = table.shares
    return Shares(0.0, s.side / (s.side + s.view), s.view / (s.side + s.view), 0.0)


def _correlation(a: Places, b: Places) -> float:
    return float(np.corrcoef(a, b)[0, 1])


def show(tables: list[ViewNoiseTable], console: Console) -> None:
    """Print both tables."""
    angles = Table("degrees between the views", *(str(a) for a in ANGLES_DEG))
    for table in tables:
        angles.add_row(table.name, *(f"{by_angle(table, a):.2f}" for a in ANGLES_DEG))
    console.print(angles)
    near, far = NEAR_FAR_M
    sectors = Table(
        "constant in a sector",
        f"at {DISTANCE_M:g} m",
        "shifted",
        f"{near:g} to {far:g} m",
        "shifted",
        "boundary",
        "middle",
    )
    for table in tables:
        values = [
            constant(table, shift, range_m)
            for range_m in ((DISTANCE_M, DISTANCE_M), NEAR_FAR_M)
            for shift in (0.0, SECTOR_DEG / 2)
        ]
        values += [across(table, 0.0), across(table, SECTOR_DEG / 2)]
        sectors.add_row(table.name, *(f"{v:.2f}" for v in values))
    console.print(sectors)


def main() -> int:
    parser = argparse.ArgumentParser(description="Print how errors depend on the view.")
    parser.add_argument("tables", nargs="+", help='names or files with format = "views"')
    try:
        show([view_table(name) for name in parser.parse_args().tables], Console(width=120))
    except HeliosError as error:
        print(error.message, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
