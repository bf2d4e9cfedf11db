"""Messages of worlds."""

from __future__ import annotations

from helios_core import proto as pb
from helios_core.types import WorldId


def world_to_proto(world: WorldId) -> pb.WorldName:
    return pb.WorldName(
        robot_boot_id=world.robot_boot_id, world_epoch=world.world_epoch, origin_id=world.origin_id
    )


def world_from_proto(message: pb.WorldName) -> WorldId:
    return WorldId(message.robot_boot_id, message.world_epoch, message.origin_id)
