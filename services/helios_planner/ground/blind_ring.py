"""The floor at the feet that a camera cannot see from where the robot stands.

A camera that cannot be tilted far enough meets the floor some way ahead of the rim. Turning on the
spot shows everything but a ring around the feet, and over unknown ground the planner does not
drive: such a robot would never leave its place. So the ring is taken as free, under four bounds:

- only when the robot has looked around and no way leads out otherwise;
- only as far as the camera is blind, and no further than `most_m` beyond the rim: what is higher
  than the line of sight is seen in it, what is lower is not, and the further one drives over ground
  that was never seen, the likelier it holds a shoe, a step or a sleeping cat;
- only where the robot stands then, and never a second ring from within a first, so that rings do
  not add up to a way through the unknown;
- what is seen or felt in it later is an obstacle as anywhere.
"""

from __future__ import annotations

import math

from helios_core.types import RobotDescription

from helios_planner.ground.grid import Pose2

SEEN_M = 0.1  # a camera sees the floor for sure so far beyond the edge of its image

Disc = tuple[float, float, float]  # x, y, radius


def blind_m(robot: RobotDescription) -> float:
    """Nearer than this to the base's middle (m) the robot sees no floor, however it turns and tilts
    where it stands: the lower edge of the image meets the floor there. Infinite if it never does.
    """
    lowest_rad = robot.tilt_range_rad[1] + robot.camera.vfov_rad / 2
    if lowest_rad <= 0:
        return math.inf
    if lowest_rad >= math.pi / 2:
        return 0.0
    return max(0.0, robot.camera_forward_m + robot.camera_height_m / math.tan(lowest_rad))


class BlindRing:
    """Of one robot in one task. `discs`: where its ring was taken as free."""

    def __init__(self, robot: RobotDescription, rim_m: float, most_m: float) -> None:
        """rim_m: radius in which it turns. most_m: longest way over ground that was never seen."""
        self._blind_m, self._rim_m, self._most_m = blind_m(robot), rim_m, most_m
        self.discs: list[Disc] = []

    @property
    def width_m(self) -> float:
        """Of the ring, from the rim outwards; 0 for a robot that sees the floor at its feet."""
        return max(0.0, self._blind_m - self._rim_m)

    def trust(self, pose: Pose2) -> bool:
        """Take the ring around a pose as free; whether there is one that may be."""
        within = any(math.dist(pose.xy, disc[:2]) <= disc[2] for disc in self.discs)
        if within or not 0 < self.width_m <= self._most_m:
            return False
        self.discs.append((pose.x_m, pose.y_m, self._blind_m + SEEN_M))
        return True

    def too_wide(self) -> str:
        """What to do about a ring that is never trusted; empty where there is none."""
        if self.width_m <= self._most_m:
            return ""
        seen = "never" if math.isinf(self._blind_m) else f"only from {self._blind_m:.1f} m on"
        return (
            f"its camera sees the floor {seen}; tilt it further down, or set "
            f"HELIOS_PLANNER_BLIND_M above {self._most_m:g}"
        )
