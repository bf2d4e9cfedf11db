"""Conversion of Frame and Observation, and of their parts, to protobuf messages and back."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.codec.images import color_array, depth_array
from helios_core.errors import InvalidInput
from helios_core.geometry import (
    Matrix,
    Pinhole,
    is_rigid,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from helios_core.image_messages import (
    FrameMessage,
    ImageMessage,
    ObservationMessage,
    image_data,
)
from helios_core.types import Detection, Embedding, Frame, FrameId, Observation, Shown

FARTHEST_M = 2e4  # from the world's origin: float32 still resolves 2 mm there
# Focal length as a multiple of the image's longer side: 176 to 0.6 degrees.
WIDEST_FOCAL, LONGEST_FOCAL = 0.02, 100.0
FARTHEST_CENTRE = 10.0  # principal point, as a multiple of the image's longer side
LATEST_S = 9_000_000_000  # limit of a 64-bit time in nanoseconds


def frame_id_to_proto(id: FrameId) -> pb.FrameId:
    """Message of a frame id; the inverse of `frame_id_from_proto`."""
    return pb.FrameId(robot_boot_id=id.robot_boot_id, world_epoch=id.world_epoch, seq=id.seq)


def frame_id_from_proto(id: pb.FrameId) -> FrameId:
    """FrameId of a message, unchecked: the reader checks that it knows the epoch."""
    return FrameId(id.robot_boot_id, id.world_epoch, id.seq)


def transform_to_proto(T_a_b: Matrix) -> pb.Transform:
    """Message of T_a_b [4, 4], row by row."""
    return pb.Transform(rows=np.asarray(T_a_b, float).ravel().tolist())


def transform_from_proto(transform: pb.Transform, what: str = "the transform") -> Matrix:
    """Matrix [4, 4]. Raises InvalidInput, which names it `what`, if it is not rigid."""
    rows = np.array(transform.rows, float)
    if rows.size != 16 or not is_rigid(rows.reshape(4, 4)):
        came = rows.reshape(4, 4).tolist() if rows.size == 16 else f"{rows.size} numbers"
        raise InvalidInput(f"{what} is not a rigid 4x4 matrix; {came} came")
    return rows.reshape(4, 4)


def pinhole_to_proto(camera: Pinhole) -> pb.Pinhole:
    """Message of the intrinsics and the image size in pixels."""
    return pb.Pinhole(
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        width=camera.width,
        height=camera.height,
    )


def pinhole_from_proto(camera: pb.Pinhole) -> Pinhole:
    """Pinhole camera. Raises InvalidInput on intrinsics implausible for this image size."""
    good = camera.fx > 0 and camera.fy > 0 and camera.width > 0 and camera.height > 0
    if not good or not all(map(math.isfinite, (camera.fx, camera.fy, camera.cx, camera.cy))):
        raise InvalidInput(
            f"the camera has fx {camera.fx}, fy {camera.fy}, size {camera.width}x{camera.height}; "
            "focal lengths and sizes must be positive"
        )
    side = max(camera.width, camera.height)
    focal_ok = all(WIDEST_FOCAL * side <= f <= LONGEST_FOCAL * side for f in (camera.fx, camera.fy))
    if not focal_ok or max(abs(camera.cx), abs(camera.cy)) > FARTHEST_CENTRE * side:
        raise InvalidInput(
            f"no camera of {camera.width}x{camera.height} has fx {camera.fx:g}, fy {camera.fy:g}, "
            f"centre ({camera.cx:g}, {camera.cy:g}); send the calibration in pixels of this image"
        )
    return Pinhole(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)


def pose_to_proto(T_world_x: Matrix, stamp_ns: int) -> PoseInFrame:
    """Message of the rigid transform `T_world_x`, in frame "world"."""
    out = PoseInFrame(frame_id="world")
    out.timestamp.FromNanoseconds(stamp_ns)
    p, q = out.pose.position, out.pose.orientation
    p.x, p.y, p.z = (float(v) for v in T_world_x[:3, 3])
    q.x, q.y, q.z, q.w = quaternion_from_rotation(T_world_x[:3, :3])
    return out


def pose_from_proto(pose: PoseInFrame, what: str) -> Matrix:
    """T_world_x [4, 4]. Raises InvalidInput if it is no pose within FARTHEST_M of the origin."""
    p, q = pose.pose.position, pose.pose.orientation
    numbers = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    norm = math.hypot(q.x, q.y, q.z, q.w) if all(map(math.isfinite, numbers)) else 0.0
    if abs(norm - 1.0) > 0.01:
        raise InvalidInput(
            f"{what} has position ({p.x}, {p.y}, {p.z}) and a quaternion of norm {norm:.3g}; "
            "send finite metres and a unit quaternion"
        )
    if max(abs(p.x), abs(p.y), abs(p.z)) > FARTHEST_M:
        raise InvalidInput(
            f"{what} is at ({p.x:g}, {p.y:g}, {p.z:g}) m; send poses in the local world, within "
            f"{FARTHEST_M:g} m of its origin"
        )
    out = np.eye(4)
    out[:3, :3] = rotation_from_quaternion(q.x, q.y, q.z, q.w)
    out[:3, 3] = (p.x, p.y, p.z)
    return out


def depth_to_mm(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depth [h, w] in metres as little-endian millimetres, rounded to the nearest.

    Beyond 65.535 m, and for infinity, it is 65535; for negative numbers and NaN 0 (no depth).
    """
    depth_mm = depth_m * np.float32(1000)
    np.clip(depth_mm, 0, 65535, out=depth_mm)
    np.rint(depth_mm, out=depth_mm)
    depth_mm[np.isnan(depth_mm)] = 0
    return depth_mm.astype("<u2")


def frame_to_proto(frame: Frame) -> pb.Frame:
    """Message of a frame: colour as rgb8, depth as 16UC1 millimetres (exact for such sensors)."""
    out = frame_message(frame)
    for field, data in out.images.items():
        getattr(out.head, field).data = data.tobytes()
    return out.head


def frame_message(frame: Frame) -> ImageMessage[pb.Frame]:
    """As `frame_to_proto`, with the images apart. Colour is a view of the frame's array."""
    color = np.ascontiguousarray(frame.color)
    images = {"raw_color": color, "raw_depth": depth_to_mm(frame.depth_m)}
    return ImageMessage(
        _frame_head(frame), {f: memoryview(a.reshape(-1).view(np.uint8)) for f, a in images.items()}
    )


def _frame_head(frame: Frame) -> pb.Frame:
    """Message of a frame without the bytes of its images."""
    height, width = frame.depth_m.shape
    out = pb.Frame(
        id=frame_id_to_proto(frame.id),
        keyframe=frame.keyframe,
        held=frame.held,
        origin_id=frame.origin_id,
    )
    out.stamp.FromNanoseconds(frame.stamp_ns)
    out.raw_color.CopyFrom(
        RawImage(width=width, height=height, encoding="rgb8", step=3 * width, frame_id="camera")
    )
    out.raw_depth.CopyFrom(
        RawImage(width=width, height=height, encoding="16UC1", step=2 * width, frame_id="camera")
    )
    out.calibration.CopyFrom(
        CameraCalibration(
            width=frame.camera.width,
            height=frame.camera.height,
            frame_id="camera",
            K=frame.camera.matrix.ravel().tolist(),
        )
    )
    out.T_world_cam.CopyFrom(pose_to_proto(frame.T_world_cam, frame.stamp_ns))
    out.T_world_base.CopyFrom(pose_to_proto(frame.T_world_base, frame.stamp_ns))
    if frame.shown is not None:
        x, y, z = frame.shown.point_m
        point = pb.Vector3(x=x, y=y, z=z)
        out.shown.CopyFrom(pb.Shown(point_m=point, turn_rad=frame.shown.turn_rad))
    return out


def _shown_from_proto(frame: FrameMessage) -> Shown | None:
    """Shown object of a frame. Raises InvalidInput on numbers that are not finite."""
    if not frame.HasField("shown"):
        return None
    p, turn_rad = frame.shown.point_m, frame.shown.turn_rad
    if not all(map(math.isfinite, (p.x, p.y, p.z, turn_rad))):
        raise InvalidInput(
            f"the frame shows an object at ({p.x}, {p.y}, {p.z}) m, turned by {turn_rad} rad; send "
            "finite numbers"
        )
    return Shown((p.x, p.y, p.z), turn_rad)


def frame_from_proto(frame: FrameMessage) -> Frame:
    """Frame; its colour is a view of the message's, its depth an array of its own.

    Raises InvalidInput on corrupt images, mismatched sizes, bad calibration or poses.
    """
    color = color_array(
        frame.raw_color if frame.HasField("raw_color") else None,
        frame.compressed_color if frame.HasField("compressed_color") else None,
        image_data(frame, "raw_color"),
    )
    depth_m = depth_array(
        frame.raw_depth if frame.HasField("raw_depth") else None,
        frame.compressed_depth if frame.HasField("compressed_depth") else None,
        image_data(frame, "raw_depth"),
    )
    K = frame.calibration.K
    if len(K) != 9:
        raise InvalidInput(f"the calibration's K has {len(K)} numbers; send 9, row by row")
    camera = pinhole_from_proto(
        pb.Pinhole(
            fx=K[0],
            fy=K[4],
            cx=K[2],
            cy=K[5],
            width=frame.calibration.width,
            height=frame.calibration.height,
        )
    )
    if abs(frame.stamp.seconds) > LATEST_S or not 0 <= frame.stamp.nanos < 1_000_000_000:
        raise InvalidInput(
            f"the frame's stamp is {frame.stamp.seconds} s and {frame.stamp.nanos} ns; send the "
            "robot's clock"
        )
    size = (camera.height, camera.width)
    if color.shape[:2] != size or depth_m.shape != size:
        raise InvalidInput(
            f"sizes disagree (height x width): colour {color.shape[:2]}, depth {depth_m.shape}, "
            f"calibration {size}; send colour and depth registered, of the calibrated size"
        )
    return Frame(
        id=frame_id_from_proto(frame.id),
        stamp_ns=frame.stamp.ToNanoseconds(),
        keyframe=frame.keyframe,
        color=color,
        depth_m=depth_m,
        camera=camera,
        T_world_cam=pose_from_proto(frame.T_world_cam, "T_world_cam"),
        T_world_base=pose_from_proto(frame.T_world_base, "T_world_base"),
        held=frame.held if frame.HasField("held") else None,
        origin_id=frame.origin_id,
        shown=_shown_from_proto(frame),
    )


def detection_to_proto(detection: Detection, with_mask: bool = True) -> pb.Detection:
    """Message of a detection, with only the part of the mask within the box."""
    x0, y0, x1, y1 = detection.box_xyxy
    out = pb.Detection(class_name=detection.class_name, score=detection.score)
    out.mask.x, out.mask.y, out.mask.width, out.mask.height = x0, y0, x1 - x0, y1 - y0
    if with_mask:
        out.mask.bits = np.packbits(detection.mask[y0:y1, x0:x1]).tobytes()
    return out


def detection_from_proto(detection: pb.Detection, shape: tuple[int, int]) -> Detection:
    """Detection with its mask over the whole image of `shape` (h, w).

    Raises InvalidInput if the mask does not fit the image or its bytes, or the score lies outside
    0 to 1.
    """
    m = detection.mask
    if m.x + m.width > shape[1] or m.y + m.height > shape[0] or m.width * m.height == 0:
        raise InvalidInput(
            f"a mask of {m.width}x{m.height} at ({m.x}, {m.y}) does not fit the image of "
            f"{shape[1]}x{shape[0]}; send the part of the mask within a box that lies in the image"
        )
    wanted = (m.width * m.height + 7) // 8
    if len(m.bits) != wanted:
        raise InvalidInput(
            f"a mask of {m.width}x{m.height} came with {len(m.bits)} bytes, {wanted} wanted; send "
            "one bit a pixel, row by row, as np.packbits packs them"
        )
    if not 0 <= detection.score <= 1:  # also for NaN
        raise InvalidInput(
            f"a detection of {detection.class_name!r} has a score of {detection.score:g}; send a "
            "number from 0 to 1"
        )
    bits = np.unpackbits(np.frombuffer(m.bits, np.uint8), count=m.width * m.height)
    mask: NDArray[np.bool_] = np.zeros(shape, bool)
    mask[m.y : m.y + m.height, m.x : m.x + m.width] = bits.reshape(m.height, m.width)
    box = (m.x, m.y, m.x + m.width, m.y + m.height)
    return Detection(detection.class_name, detection.score, box, mask)


def embedding_to_proto(embedding: Embedding) -> pb.Embedding:
    """Message of an embedding: float16, row by row."""
    values = np.ascontiguousarray(embedding.vectors).astype("<f2")
    return pb.Embedding(model=embedding.model, rows=len(values), values=values.tobytes())


def embedding_from_proto(embedding: pb.Embedding) -> Embedding:
    """Embedding. Raises InvalidInput if the rows do not fill the bytes or a value is not finite."""
    size = len(embedding.values) // 2
    if embedding.rows == 0 or size == 0 or len(embedding.values) % (2 * embedding.rows):
        raise InvalidInput(
            f"an embedding of {embedding.rows} rows came with {len(embedding.values)} bytes; send "
            "float16 values row by row"
        )
    vectors = np.frombuffer(embedding.values, "<f2").astype(np.float32)
    if not np.isfinite(vectors).all():
        raise InvalidInput("an embedding has values that are not numbers")
    return Embedding(embedding.model, vectors.reshape(embedding.rows, -1))


def observation_to_proto(observation: Observation, frame: pb.Frame | None = None) -> pb.Observation:
    """Message of an observation. `frame`: the frame's message, to avoid encoding it again."""
    out = pb.Observation(
        frame=frame if frame is not None else frame_to_proto(observation.frame),
        context_id=observation.context_id,
        detections=[detection_to_proto(d) for d in observation.detections],
        layer_scores=observation.layer_scores,
        detector=observation.detector,
        scorer=observation.scorer,
        others=[detection_to_proto(d) for d in observation.others],
        class_scores=observation.class_scores,
    )
    if observation.image_embedding is not None:
        out.image_embedding.CopyFrom(embedding_to_proto(observation.image_embedding))
    return out


def observation_message(
    observation: Observation, frame: ImageMessage[pb.Frame]
) -> ImageMessage[pb.Observation]:
    """Message of an observation with the images of its frame's message apart."""
    images = {f"frame.{field}": image for field, image in frame.images.items()}
    return ImageMessage(observation_to_proto(observation, frame.head), images)


def observation_from_proto(
    observation: ObservationMessage, *, with_others: bool = True
) -> Observation:
    """Observation. with_others: False leaves `others` empty, whose masks take time to unpack.

    Raises InvalidInput like `frame_from_proto`, and on masks that do not fit.
    """
    frame = frame_from_proto(observation.frame)
    shape = (frame.camera.height, frame.camera.width)
    return Observation(
        frame=frame,
        context_id=observation.context_id,
        detections=tuple(detection_from_proto(d, shape) for d in observation.detections),
        layer_scores=_finite(observation.layer_scores),
        detector=observation.detector,
        scorer=observation.scorer,
        image_embedding=(
            embedding_from_proto(observation.image_embedding)
            if observation.HasField("image_embedding")
            else None
        ),
        others=tuple(detection_from_proto(d, shape) for d in observation.others if with_others),
        class_scores=_finite(observation.class_scores),
    )


def _finite(scores: Mapping[str, float]) -> dict[str, float]:
    return {k: v for k, v in scores.items() if math.isfinite(v)}
