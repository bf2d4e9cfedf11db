"""Metrics of object navigation ("find the X") by the HM3D rules of the VLFM evaluation. Pure.

- Success: the agent reports arrival while its base is within 0.1 m geodesic of a viewpoint of any
  instance of the class. Its viewing direction does not matter. The report ends the episode; an
  agent without a report within 500 steps fails.
- Viewpoints are those of `ovmm_metrics`: up to 1.0 m from the box of an instance, where the robot
  fits and which it can reach.
- SPL: success × l / max(p, l), where l is the shortest path over free ground from the start to the
  nearest viewpoint, and p the distance that the base drove. 0 for a failure.
- Collisions are ignored.
"""

from __future__ import annotations

MIN_SHORTEST_M = 1.0  # lower limit of l in a task


def spl(success: bool, path_m: float, shortest_m: float) -> float:
    """Success weighted by path length, 0 to 1."""
    if not success:
        return 0.0
    longest_m = max(path_m, shortest_m)
    return shortest_m / longest_m if longest_m > 0 else 1.0
