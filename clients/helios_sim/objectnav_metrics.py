"""Object navigation, "find the X", by the rules of HM3D that VLFM was measured with. Pure.

- Success: the agent says that it has arrived while its base is within 0.1 m geodesic of a viewpoint
  of any instance of the class. Where it looks does not matter. Saying so ends the episode; an agent
  that says nothing within 500 steps has failed.
- Viewpoints are those of `metrics`: up to 1.0 m from the box of an instance, where the robot can
  stand and can get to.
- SPL: success × l / max(p, l), with l the shortest way over free ground from the start to the
  nearest viewpoint, and p what the base drove. 0 for a failure.
- Collisions do not matter to it.
"""

from __future__ import annotations

MAX_STEPS = 500
MIN_SHORTEST_M = 1.0  # tasks that begin nearer are not posed


def spl(success: bool, path_m: float, shortest_m: float) -> float:
    """Success weighted by path length, 0 to 1."""
    if not success:
        return 0.0
    longest_m = max(path_m, shortest_m)
    return shortest_m / longest_m if longest_m > 0 else 1.0
