"""An exploration rule: the nearest place, rather on the left (docs/tutorials/your-own-agent.md).

helios up --agent helios_examples.left_first:agent
"""

import numpy as np
from helios_planner.plugins import Places, exploring_by
from numpy.typing import NDArray

WORTH_M = 1.0  # straight to the left is worth so much of a way


def left_first(places: Places) -> NDArray[np.float64]:
    """Scores [n]: minus the way in metres, with 1 m more on the left and 1 m less on the right."""
    return -places.distance_m + WORTH_M * np.sin(places.bearing_rad)


agent = exploring_by(left_first)
