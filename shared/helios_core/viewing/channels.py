"""Message types of the channels that a running robot is known to have."""

from __future__ import annotations

from collections.abc import Mapping

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message

from helios_core import recording_format as names
from helios_core.topics import TOPICS

LAYERS = ("pick", "place")  # value layers of a task that moves an object
CHANNELS: Mapping[str, type[Message]] = {
    **{names.channel_of(topic): topic.type for topic in TOPICS},
    **{names.VALUES + layer: Grid for layer in LAYERS},
    **dict.fromkeys((names.STREAM_CHANNELS.color, names.KEYFRAME_CHANNELS.color), CompressedImage),
    **dict.fromkeys((names.STREAM_CHANNELS.depth, names.KEYFRAME_CHANNELS.depth), RawImage),
    **dict.fromkeys((names.OBSTACLES, names.GAUSSIANS), PointCloud),
    **dict.fromkeys(
        (names.FRONTIERS, names.TRAJECTORY, names.OBJECTS, names.PLAN, names.CANDIDATES),
        SceneUpdate,
    ),
    names.CALIBRATION: CameraCalibration,
    names.TRANSFORMS: FrameTransform,
    names.LOG: Log,
    names.ANNOTATIONS: ImageAnnotations,
    names.OCCUPANCY: Grid,
    names.PATH: PosesInFrame,
}
