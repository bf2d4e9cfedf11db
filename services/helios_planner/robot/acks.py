"""What answers a keyframe, in a task's words."""

from __future__ import annotations

# Who answers each part of a keyframe; all but the occupancy come by way of the detector.
PARTS = {
    "detections": "detector",
    "occupancy": "map2d",
    "value": "map2d (or the detector before it)",
    "objects": "objectmap (or the detector before it)",
}
BY_DETECTOR = frozenset(PARTS) - {"occupancy"}  # not answered while the detector answers nothing
