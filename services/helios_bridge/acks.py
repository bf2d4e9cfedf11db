"""What answers a keyframe: the parts of the maps, by service and name."""

from __future__ import annotations

from helios_core import proto as pb

OCCUPANCY = "map2d/occupancy"  # answered whether or not anything is looked for
PARTS = frozenset({"objectmap/objects", OCCUPANCY, "map2d/value"})


def part_of(ack: pb.Ack) -> str:
    """As in `PARTS`."""
    return f"{ack.service}/{ack.part}"
