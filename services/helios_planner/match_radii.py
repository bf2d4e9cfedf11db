"""How near two things must be to be taken for one: every such radius, and why they differ.

A radius is as small as the error of what is compared allows. In metres.

- Two beliefs of the object map, or two points that the robot aimed at, are known to a few
  centimetres: 0.15.
- A single detection, or a thing that is looked at again from near, is off by more, since only the
  seen side of it counts: 0.3. Of a receptacle much more may come into sight from near: 1.0.
- A candidate or a frontier moves while its surroundings are seen bit by bit, and what is near it is
  seen with it: 0.5.
"""

from __future__ import annotations

# --- two known positions ------------------------------------------------------------------------
SAME_INSTANCE_M = 0.15  # two beliefs of the object map at different times
SAME_POINT_M = 0.15  # a point that was tried, and one to try
ON_OUTLINE_M = 0.15  # a thing this near to a receptacle's outline is on it
PICKED_PLACE_M = 0.2  # a receptacle whose outline is this near to where a thing was picked

# --- a position from one look -------------------------------------------------------------------
SAME_THING_M = 0.3  # two detections of a class; a thing believed from afar and from near
SAME_BARRIER_M = 0.3  # unknown ground that bars a way, and was looked at
GROWN_M = 1.0  # so far a receptacle's middle moves when the rest of it comes into sight

# --- a position that moves as more is seen ------------------------------------------------------
SAME_PLACE_M = 0.5  # a candidate that was visited, a frontier that was given up
SAME_FRONTIER_M = 0.5  # the frontier that was gone to last, in VLFM
