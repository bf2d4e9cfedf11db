"""Growth of the grid, and refusal of implausible poses.

A grid grows by whole tiles and by more than needed, so that it grows rarely.
"""

from __future__ import annotations

import math

from helios_core.errors import InvalidInput

from helios_map2d.grid import TILE, Box, GridSpec

GROWS_BY = 512  # spare cells beyond the needed ones
CAMERA_WITHIN_M = 5.0  # greatest distance of the camera from the robot's base


def grown_for(grid: GridSpec, needed: Box, margin: int, most_cells: int) -> GridSpec:
    """The grid itself if it contains `needed` (world cells) and a margin, else a larger grid.

    Raises InvalidInput if that would exceed `most_cells` a side plus the spare cells.
    """
    whole, wanted = grid.to_world(grid.whole), needed.grown(margin)
    if needed.empty or whole.holds(wanted):
        return grid
    spare = wanted.grown(GROWS_BY).tiled
    grown = Box(
        min(whole.row_lo, spare.row_lo) if wanted.row_lo < whole.row_lo else whole.row_lo,
        max(whole.row_hi, spare.row_hi) if wanted.row_hi > whole.row_hi else whole.row_hi,
        min(whole.column_lo, spare.column_lo)
        if wanted.column_lo < whole.column_lo
        else whole.column_lo,
        max(whole.column_hi, spare.column_hi)
        if wanted.column_hi > whole.column_hi
        else whole.column_hi,
    )
    if max(grown.rows, grown.columns) > most_cells + 2 * (GROWS_BY + TILE):
        cell_m = grid.cell_m
        raise InvalidInput(
            f"a view around ({(needed.column_lo + needed.columns / 2) * cell_m:.2f}, "
            f"{(needed.row_lo + needed.rows / 2) * cell_m:.2f}) m would make the map "
            f"{grown.columns}x{grown.rows} cells: if the pose is right, start the service with "
            f"a larger HELIOS_MAP2D_MOST_CELLS (now {most_cells}); if the robot's "
            "localisation jumped, its driver must begin a new world epoch"
        )
    return GridSpec.over(grown, grid.cell_m)


def check_plausible_move(
    robot_m: tuple[float, float],
    camera_m: tuple[float, float],
    last_m: tuple[float, float] | None,
    most_leap_m: float,
) -> None:
    """Raise InvalidInput for an implausible position (world x, y) of the robot or its camera.

    `last_m`: last position of the robot, if known.
    """
    (x_m, y_m), (camera_x, camera_y) = robot_m, camera_m
    apart_m = math.hypot(camera_x - x_m, camera_y - y_m)
    if apart_m > CAMERA_WITHIN_M:
        raise InvalidInput(
            f"the camera is at ({camera_x:.2f}, {camera_y:.2f}) m, {apart_m:.2f} m from the "
            f"robot at ({x_m:.2f}, {y_m:.2f}) m: send both poses in one world"
        )
    if last_m is None:
        return
    leap_m = math.hypot(x_m - last_m[0], y_m - last_m[1])
    if leap_m > most_leap_m:
        raise InvalidInput(
            f"the robot is at ({x_m:.2f}, {y_m:.2f}) m, {leap_m:.0f} m from where it last was: "
            "if its localisation jumped, its driver must begin a new world epoch; if it "
            "went there unseen, raise HELIOS_MAP2D_MOST_LEAP_M"
        )
