"""Exploration rule: the nearest place, preferably on the left (docs/tutorials/your-own-agent.md).

helios up --agent helios_examples.left_first:agent
"""

import numpy as np
from helios_planner.plugins import Places, exploring_by
from numpy.typing import NDArray

WORTH_M = 1.0  # bonus of a place straight to the left, metres of path


def left_first(places: Places) -> NDArray[np.float64]:
    """Scores [n]: negative path length in metres, up to 1 m more on the left, less on the right."""
    return -places.distance_m + WORTH_M * np.sin(places.bearing_rad)


agent = exploring_by(left_first)
