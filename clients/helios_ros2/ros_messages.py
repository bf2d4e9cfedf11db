"""ROS messages of maps, paths, objects and health. No I/O."""

from __future__ import annotations

import array
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.geometry import Matrix, quaternion_from_rotation
from helios_core.map_snapshot import MapView
from helios_core.object_boxes import LEAST_BOX_M, UprightBox, upright_box
from numpy.typing import NDArray

from helios_ros2.rclpy_loading import interface

LETTER_M = 0.12
LEVELS = {"ready": 0, "starting": 1, "waiting": 1, "stopping": 1}  # of DiagnosticStatus; else error
ERROR, STALE = 2, 3
SILENT_AFTER_S = 5.0  # a service reports each second; the gateway has the same limit


def stamp(header: Any, stamp_ns: int, frame: str) -> None:
    """Fill a header."""
    header.stamp.sec, header.stamp.nanosec = divmod(int(stamp_ns), 10**9)
    header.frame_id = frame


def grid(view: MapView, cells: NDArray[np.int8], ns: int, frame: str) -> Any:
    """OccupancyGrid of cells [rows, columns]; row 0 is at the lowest y, as in the map."""
    out = interface("nav_msgs/msg/OccupancyGrid")()
    stamp(out.header, ns, frame)
    out.info.map_load_time = out.header.stamp
    out.info.resolution = float(view.cell_m)
    out.info.height, out.info.width = view.shape
    out.info.origin.position.x, out.info.origin.position.y = map(float, view.origin_m)
    out.info.origin.orientation.w = 1.0
    out.data = array.array("b", np.ascontiguousarray(cells, np.int8).tobytes())
    return out


def picture(rgb: NDArray[np.uint8], ns: int, frame: str) -> Any:
    """Image of RGB pixels [h, w, 3]."""
    height, width = rgb.shape[:2]
    out = interface("sensor_msgs/msg/Image")(
        height=height, width=width, encoding="rgb8", step=3 * width
    )
    out.data = array.array("B", np.ascontiguousarray(rgb).tobytes())
    stamp(out.header, ns, frame)
    return out


def path(points_m: Iterable[tuple[float, float]], ns: int, frame: str) -> Any:
    """Path of points on the floor; each pose looks at the next."""
    points = [(float(x), float(y)) for x, y in points_m if math.isfinite(x) and math.isfinite(y)]
    out = interface("nav_msgs/msg/Path")()
    stamp(out.header, ns, frame)
    kind = interface("geometry_msgs/msg/PoseStamped")
    yaw_rad = 0.0
    for i, (x, y) in enumerate(points):
        if i + 1 < len(points):
            yaw_rad = math.atan2(points[i + 1][1] - y, points[i + 1][0] - x)
        pose = kind(header=out.header)
        pose.pose.position.x, pose.pose.position.y = x, y
        pose.pose.orientation.z = math.sin(yaw_rad / 2)
        pose.pose.orientation.w = math.cos(yaw_rad / 2)
        out.poses.append(pose)
    return out


def point_cloud(points: NDArray[np.void], ns: int, frame: str) -> Any:
    """PointCloud2 of a structured array; its field names stay."""
    kind = interface("sensor_msgs/msg/PointField")
    types = {"<f4": kind.FLOAT32, "<u4": kind.UINT32}
    out = interface("sensor_msgs/msg/PointCloud2")(
        height=1,
        width=len(points),
        point_step=points.dtype.itemsize,
        row_step=points.nbytes,
        is_dense=True,
    )
    stamp(out.header, ns, frame)
    for name, (field, offset, *_) in (points.dtype.fields or {}).items():
        # viewers expect packed colours as a float
        datatype = kind.FLOAT32 if name == "rgb" else types[field.str]
        out.fields.append(kind(name=name, offset=offset, datatype=datatype, count=1))
    out.data = array.array("B", points.tobytes())
    return out


def markers(objects: Sequence[pb.ObjectInstance], frame: str) -> Any:
    """MarkerArray with a box and a label for each object; it replaces the one before."""
    kind = interface("visualization_msgs/msg/Marker")
    out = interface("visualization_msgs/msg/MarkerArray")(markers=[kind(action=kind.DELETEALL)])
    for o in objects:
        box = upright_box(o, LEAST_BOX_M)
        if box is None:
            continue
        color = _color_of(o.class_name)
        cube, label = (
            kind(ns=ns, id=int(o.id) % 2**31, type=shape, action=kind.ADD)
            for ns, shape in (("objects", kind.CUBE), ("labels", kind.TEXT_VIEW_FACING))
        )
        cube.header.frame_id = label.header.frame_id = frame
        _place(cube.pose, box)
        cube.scale.x, cube.scale.y, cube.scale.z = box.size_m
        _place(label.pose, box)
        label.pose.position.z += box.size_m[2] / 2 + LETTER_M
        label.scale.z = LETTER_M
        label.text = f"{o.class_name} {o.score:.2f}"
        for marker, alpha in ((cube, 0.5), (label, 1.0)):
            marker.color.r, marker.color.g, marker.color.b = color
            marker.color.a = alpha
            out.markers.append(marker)
    return out


def _place(pose: Any, box: UprightBox) -> None:
    pose.position.x, pose.position.y, pose.position.z = box.center_m
    pose.orientation.z = math.sin(box.yaw_rad / 2)
    pose.orientation.w = math.cos(box.yaw_rad / 2)


def _color_of(name: str) -> tuple[float, float, float]:
    """One colour per class, the same at every start. Floats: rclpy sends an int as 0."""
    hue = sum((i + 1) * b for i, b in enumerate(name.encode())) % 360 / 60
    x = 1 - abs(hue % 2 - 1)
    return (
        (1.0, x, 0.0), (x, 1.0, 0.0), (0.0, 1.0, x), (0.0, x, 1.0), (x, 0.0, 1.0), (1.0, 0.0, x),
    )[int(hue)]  # fmt: skip


def detections(objects: Sequence[pb.ObjectInstance], ns: int, frame: str) -> Any:
    """Detection3DArray of the object map."""
    out = interface("vision_msgs/msg/Detection3DArray")()
    stamp(out.header, ns, frame)
    for o in objects:
        box = upright_box(o)
        if box is None:
            continue
        one = interface("vision_msgs/msg/Detection3D")(header=out.header, id=str(o.id))
        center, size = one.bbox.center, one.bbox.size
        _place(center, box)
        size.x, size.y, size.z = box.size_m
        guess = interface("vision_msgs/msg/ObjectHypothesisWithPose")()
        guess.hypothesis.class_id, guess.hypothesis.score = o.class_name, float(o.score)
        guess.pose.pose = center
        one.results.append(guess)
        out.detections.append(one)
    return out


def diagnostics(statuses: Iterable[tuple[pb.ServiceStatus, float]], ns: int) -> Any:
    """DiagnosticArray with one status per service, from its newest status and the age of that in s.
    A service that is silent for longer than `SILENT_AFTER_S` is STALE."""
    out = interface("diagnostic_msgs/msg/DiagnosticArray")()
    stamp(out.header, ns, "")
    kind = interface("diagnostic_msgs/msg/DiagnosticStatus")
    pair = interface("diagnostic_msgs/msg/KeyValue")
    for s, age_s in statuses:
        level, message = LEVELS.get(s.state, ERROR), s.reason or s.state
        if age_s > SILENT_AFTER_S:
            level, message = STALE, f"silent for {age_s:.0f} s; it said last: {message}"
        one = kind(
            level=bytes([level]),
            name=f"helios: {s.service}",
            message=message,
            hardware_id="helios",
        )
        values = {"state": s.state, "pid": str(s.pid), "uptime_s": f"{s.uptime_s:.0f}"}
        values |= {name: f"{value:.6g}" for name, value in s.metrics.items()}
        one.values = [pair(key=key, value=value) for key, value in values.items()]
        out.status.append(one)
    return out


def transform(parent: str, child: str, T_parent_child: Matrix, ns: int) -> Any:
    """TransformStamped of a matrix [4, 4]."""
    out = interface("geometry_msgs/msg/TransformStamped")(child_frame_id=child)
    stamp(out.header, ns, parent)
    t, q = out.transform.translation, out.transform.rotation
    t.x, t.y, t.z = (float(v) for v in T_parent_child[:3, 3])
    q.x, q.y, q.z, q.w = quaternion_from_rotation(T_parent_child[:3, :3])
    return out
