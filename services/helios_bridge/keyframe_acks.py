"""What answers a keyframe: the parts of the maps, by service and name."""

from __future__ import annotations

from helios_core import proto as pb

OCCUPANCY = "map2d/occupancy"  # answered whether or not anything is looked for
BY_DETECTOR = frozenset({"objectmap/objects", "map2d/value"})  # made of what it found
PARTS = BY_DETECTOR | {OCCUPANCY}


def part_of(ack: pb.Ack) -> str:
    """As in `PARTS`."""
    return f"{ack.service}/{ack.part}"
