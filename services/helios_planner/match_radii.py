"""Radii within which two detections or objects count as the same, and why they differ. In metres.

A radius is as small as the position error of the compared objects allows.

- Two objects of the object map, or two points that the robot aimed at, are known to a few
  centimetres: 0.15.
- A single detection, or an object seen again from near, has a larger error, since only its visible
  part counts: 0.3. Much more of a receptacle may become visible from near: 1.0.
- A candidate or a frontier moves while its surroundings become visible step by step, and a view of
  it covers its neighbourhood: 0.5.
"""

from __future__ import annotations

# --- two known positions ------------------------------------------------------------------------
SAME_INSTANCE_M = 0.15  # two estimates of the object map at different times
SAME_POINT_M = 0.15  # a point that was tried, and one to try
SAME_SPOT_M = 0.07  # two raised spots of a surface, which may lie side by side
ON_OUTLINE_M = 0.15  # an object within this distance of a receptacle's outline lies on it
PICKED_PLACE_M = 0.2  # from a receptacle's outline to the point where an object was picked from it

# --- a position from a single view --------------------------------------------------------------
SAME_THING_M = 0.3  # two detections of a class; an object estimated from afar and from near
SAME_BARRIER_M = 0.3  # unknown ground that blocks a path and was looked at
RECEPTACLE_SHIFT_M = 1.0  # shift of a receptacle's centre when the rest of it becomes visible

# --- a position that moves as more becomes visible ----------------------------------------------
SAME_PLACE_M = 0.5  # a candidate that was visited, a frontier that was given up
SAME_FRONTIER_M = 0.5  # a frontier that was chosen before
