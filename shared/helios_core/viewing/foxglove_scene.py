"""Parts of a foxglove.SceneUpdate: boxes, lines, arrows, text, in the frame `world`. No I/O.

Each update deletes the former content of its channel, so a viewer that starts anywhere in a
recording needs only the newest update.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp

from helios_core.object_boxes import UprightBox

WORLD = "world"
LETTER_PX = 13  # height of text

Rgb = tuple[int, int, int]
Xyz = tuple[float, float, float]


def scene(entities: Iterable[SceneEntity], stamp_ns: int) -> SceneUpdate:
    """Complete new content of the channel."""
    out = SceneUpdate(entities=entities)
    deletion = out.deletions.add(type=SceneEntityDeletion.ALL)
    deletion.timestamp.FromNanoseconds(stamp_ns)
    return out


def entity(id: str, stamp_ns: int, about: Mapping[str, object] | None = None) -> SceneEntity:
    """Empty entity. `about`: metadata shown when it is selected."""
    out = SceneEntity(timestamp=stamp(stamp_ns), frame_id=WORLD, id=id, frame_locked=True)
    for key, value in (about or {}).items():
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        out.metadata.add(key=key, value=shown)
    return out


def add_box(out: SceneEntity, box: UprightBox, rgb: Rgb, alpha: float) -> None:
    cube = out.cubes.add(pose=pose(box.center_m, box.yaw_rad), color=color(rgb, alpha))
    cube.size.x, cube.size.y, cube.size.z = box.size_m


def add_ball(out: SceneEntity, center_m: Xyz, diameter_m: float, rgb: Rgb) -> None:
    ball = out.spheres.add(pose=pose(center_m), color=color(rgb))
    ball.size.x = ball.size.y = ball.size.z = diameter_m


def add_line(out: SceneEntity, points_m: Sequence[Xyz], width_m: float, rgb: Rgb) -> None:
    out.lines.add(
        type=LinePrimitive.LINE_STRIP,
        pose=pose((0.0, 0.0, 0.0)),
        thickness=width_m,
        color=color(rgb),
        points=[Point3(x=x, y=y, z=z) for x, y, z in points_m],
    )


def add_arrow(out: SceneEntity, at_m: Xyz, yaw_rad: float, rgb: Rgb) -> None:
    """Add a horizontal arrow, 0.45 m long."""
    out.arrows.add(
        pose=pose(at_m, yaw_rad),
        shaft_length=0.3,
        shaft_diameter=0.05,
        head_length=0.15,
        head_diameter=0.12,
        color=color(rgb),
    )


def add_words(out: SceneEntity, at_m: Xyz, words: str, rgb: Rgb) -> None:
    """Add text that always faces the viewer, of the same height on the screen at any distance."""
    out.texts.add(
        pose=pose(at_m),
        billboard=True,
        font_size=LETTER_PX,
        scale_invariant=True,
        color=color(rgb),
        text=words,
    )


def pose(at_m: Xyz, yaw_rad: float = 0.0) -> Pose:
    out = Pose()
    out.position.x, out.position.y, out.position.z = at_m
    out.orientation.z, out.orientation.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    return out


def color(rgb: Rgb, alpha: float = 1.0) -> Color:
    r, g, b = (c / 255 for c in rgb)
    return Color(r=r, g=g, b=b, a=alpha)


def stamp(ns: int) -> Timestamp:
    out = Timestamp()
    out.FromNanoseconds(ns)
    return out
