"""The middle of the largest open floor of a home, for tests that drop what the robot holds."""

from __future__ import annotations

import cv2
import numpy as np
from helios_sim.episode_tracker import reachable
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.world import World

CELL_M = 0.05


def drive_to_open_floor(oracle: GroundTruthSolver, world: World) -> None:
    """Drive to the cell with the largest clearance."""
    free, (x0, y0) = reachable(world.home, world.home.preset.passage_radius_m, CELL_M)
    room = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 5)
    row, column = np.unravel_index(int(np.argmax(room)), room.shape)
    assert oracle.go_near((x0 + CELL_M * (column + 0.5), y0 + CELL_M * (row + 0.5)))
