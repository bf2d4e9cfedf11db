"""Conversion between protobuf messages and the dataclasses of `helios_core.types`.

Incoming messages are validated here: an inconsistent one raises InvalidInput, whose text gives the
value received and the value expected.
"""

from helios_core.codec.frames import (
    embedding_from_proto,
    embedding_to_proto,
    frame_from_proto,
    frame_id_from_proto,
    frame_id_to_proto,
    frame_message,
    frame_to_proto,
    observation_from_proto,
    observation_message,
    observation_to_proto,
    pinhole_from_proto,
    pinhole_to_proto,
    transform_from_proto,
    transform_to_proto,
)
from helios_core.codec.robot import (
    action_from_proto,
    action_to_proto,
    description_from_proto,
    description_to_proto,
    result_from_proto,
    result_to_proto,
    state_from_proto,
    state_to_proto,
)
from helios_core.codec.search import (
    context_from_proto,
    context_to_proto,
    object_from_proto,
    object_to_proto,
    vector_from_proto,
    vector_to_proto,
)
from helios_core.codec.worlds import world_from_proto, world_to_proto

__all__ = [
    "action_from_proto",
    "action_to_proto",
    "context_from_proto",
    "context_to_proto",
    "description_from_proto",
    "description_to_proto",
    "embedding_from_proto",
    "embedding_to_proto",
    "frame_from_proto",
    "frame_id_from_proto",
    "frame_id_to_proto",
    "frame_message",
    "frame_to_proto",
    "object_from_proto",
    "object_to_proto",
    "observation_from_proto",
    "observation_message",
    "observation_to_proto",
    "pinhole_from_proto",
    "pinhole_to_proto",
    "result_from_proto",
    "result_to_proto",
    "state_from_proto",
    "state_to_proto",
    "transform_from_proto",
    "transform_to_proto",
    "vector_from_proto",
    "vector_to_proto",
    "world_from_proto",
    "world_to_proto",
]
