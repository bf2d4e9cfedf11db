"""Conversion of one entry to Rerun's entities. No I/O.

/world                     z up
/world/robot               pose and heading of the base
/world/camera              pose and calibration, stream image, depth, detections
/world/keyframe            the same of the last keyframe
/world/map/…               occupancy, values, obstacles, Gaussians, objects, frontiers, plan …
/log/…, /task, /decision   texts
/timing/…                  duration of the maps' updates (ms)
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.codec.images import depth_array
from helios_core.recording_format import GAUSSIANS, KEYFRAME_CHANNELS, MAPS
from helios_core.viewing.entry import Entry

from helios_viewers.rerun_grids import cloud_points, cloud_splats, grid_mesh
from helios_viewers.rerun_scenes import scene_shapes
from helios_viewers.rerun_texts import decision_text, task_text

Entity = tuple[str, rr.AsComponents]  # path, content

WORLD, ROBOT, CAMERA, KEYFRAME = "world", "world/robot", "world/camera", "world/keyframe"
MAP = "world/map/"
HEADING_M = 0.5  # length of the arrow on the robot
IMAGE_PLANE_M = 0.6
MEDIA = {"jpeg": "image/jpeg", "jpg": "image/jpeg", "png": "image/png"}
LEVELS = {
    Log.Level.DEBUG: "DEBUG",
    Log.Level.WARNING: "WARN",
    Log.Level.ERROR: "ERROR",
    Log.Level.FATAL: "CRITICAL",
}


def fixed_entities() -> Iterator[Entity]:
    """Entities that never change."""
    yield WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP
    yield (
        f"{ROBOT}/heading",
        rr.Arrows3D(
            vectors=[[HEADING_M, 0, 0]], origins=[[0, 0, 0.1]], radii=0.06, colors=[(24, 90, 219)]
        ),
    )


def entities_of(entry: Entry) -> Iterator[Entity]:
    """Entities of an entry; none for one that Rerun does not show.

    Raises InvalidInput for a broken image, grid or cloud.
    """
    channel, message = entry.channel, entry.message
    if channel.startswith(MAPS):
        yield from _map_entities(channel, MAP + channel.removeprefix(MAPS), message)
    elif isinstance(message, CompressedImage):
        yield _image(channel, message)
    elif isinstance(message, RawImage):
        yield _depth(channel, message)
    elif isinstance(message, pb.Frame):
        yield from _frame(message)
    elif isinstance(message, ImageAnnotations):
        yield f"{CAMERA}/detections", _detections(message)
    elif isinstance(message, Log):
        yield (
            f"log/{message.name or 'other'}",
            rr.TextLog(message.message, level=LEVELS.get(message.level, "INFO")),
        )
    else:
        yield from _texts_and_figures(message)


def _map_entities(channel: str, path: str, message: Message) -> Iterator[Entity]:
    if isinstance(message, Grid):
        yield path, grid_mesh(message)
    elif isinstance(message, PointCloud):
        yield path, cloud_splats(message) if channel == GAUSSIANS else cloud_points(message)
    elif isinstance(message, SceneUpdate):
        for kind, shapes in scene_shapes(channel, message):
            yield f"{path}/{kind}", shapes
    elif isinstance(message, PosesInFrame):
        points = [(p.position.x, p.position.y, p.position.z) for p in message.poses]
        yield path, rr.Points3D(np.array(points, np.float32).reshape(-1, 3), radii=0.03)


def _camera_of(channel: str) -> str:
    keyframe = channel in (KEYFRAME_CHANNELS.color, KEYFRAME_CHANNELS.depth)
    return KEYFRAME if keyframe else CAMERA


def _image(channel: str, image: CompressedImage) -> Entity:
    media = MEDIA.get(image.format.lower(), "image/jpeg")
    return f"{_camera_of(channel)}/color", rr.EncodedImage(contents=image.data, media_type=media)


def _depth(channel: str, image: RawImage) -> Entity:
    depth_m = depth_array(image, None)
    return f"{_camera_of(channel)}/depth", rr.DepthImage(depth_m, meter=1.0, depth_range=(0, 8))


def _frame(frame: pb.Frame) -> Iterator[Entity]:
    """Poses and calibration of a frame without pixels."""
    yield ROBOT, _transform(frame.T_world_base)
    path, size = KEYFRAME if frame.keyframe else CAMERA, frame.calibration
    yield path, _transform(frame.T_world_cam)
    if len(size.K) == 9:
        yield (
            path,
            rr.Pinhole(
                image_from_camera=np.array(size.K).reshape(3, 3),
                width=size.width,
                height=size.height,
                image_plane_distance=IMAGE_PLANE_M,
            ),
        )


def _transform(pose: PoseInFrame) -> rr.Transform3D:
    p, q = pose.pose.position, pose.pose.orientation
    return rr.Transform3D(
        translation=(p.x, p.y, p.z), quaternion=rr.Quaternion(xyzw=(q.x, q.y, q.z, q.w))
    )


def _detections(annotations: ImageAnnotations) -> rr.Boxes2D:
    """Boxes with class and score, in pixels."""
    pixels = [[(p.x, p.y) for p in box.points] for box in annotations.points if box.points]
    corners = [np.concatenate([np.min(box, axis=0), np.max(box, axis=0)]) for box in pixels]
    return rr.Boxes2D(
        array=np.array(corners, np.float32).reshape(-1, 4),
        array_format=rr.Box2DFormat.XYXY,
        labels=[text.text for text in annotations.texts],
        colors=[(255, 140, 0)],
    )


def _texts_and_figures(message: Message) -> Iterator[Entity]:
    if isinstance(message, pb.Task):
        yield "task", rr.TextDocument(task_text(message), media_type=rr.MediaType.MARKDOWN)
    elif isinstance(message, pb.Decision):
        yield "decision", rr.TextDocument(decision_text(message), media_type=rr.MediaType.MARKDOWN)
    elif isinstance(message, pb.Ack) and message.update_ms > 0:
        yield f"timing/{message.service}/{message.part}", rr.Scalars(message.update_ms)
