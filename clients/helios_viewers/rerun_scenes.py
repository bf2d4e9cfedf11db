"""Scenes as Rerun's boxes, spheres, lines and arrows. No I/O.

A scene replaces the former content of its channel, so each kind that a channel may have is written
each time, also when it is empty.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from helios_core.recording_format import CANDIDATES, FRONTIERS, OBJECTS, PLAN, TRAJECTORY
from numpy.typing import NDArray

KINDS = {  # channel -> kinds of shapes that it may have
    OBJECTS: ("boxes",),
    FRONTIERS: ("spheres",),
    CANDIDATES: ("spheres",),
    TRAJECTORY: ("lines",),
    PLAN: ("lines", "arrows"),
}
Shapes = rr.Boxes3D | rr.Points3D | rr.LineStrips3D | rr.Arrows3D


def scene_shapes(channel: str, scene: SceneUpdate) -> Iterator[tuple[str, Shapes]]:
    """(kind, shapes) of a scene, one for each kind of its channel."""
    makers = {"boxes": boxes, "spheres": spheres, "lines": lines, "arrows": arrows}
    for kind in KINDS.get(channel, tuple(makers)):
        yield kind, makers[kind](scene)


def boxes(scene: SceneUpdate) -> rr.Boxes3D:
    """Boxes, each with the text of its entity."""
    drawn = [(e, c) for e in scene.entities for c in e.cubes]
    return rr.Boxes3D(
        centers=_xyz([c.pose for _, c in drawn]),
        sizes=_rows([(c.size.x, c.size.y, c.size.z) for _, c in drawn], 3),
        quaternions=_rows([_xyzw(c.pose) for _, c in drawn], 4),
        colors=_colors([c.color for _, c in drawn], opaque=True),
        labels=[_words(e) for e, _ in drawn],
        show_labels=True,
    )


def spheres(scene: SceneUpdate) -> rr.Points3D:
    """Spheres, each with the text of its entity."""
    drawn = [(e, s) for e in scene.entities for s in e.spheres]
    return rr.Points3D(
        _xyz([s.pose for _, s in drawn]),
        radii=[s.size.x / 2 for _, s in drawn],
        colors=_colors([s.color for _, s in drawn]),
        labels=[_words(e) for e, _ in drawn],
        show_labels=True,
    )


def lines(scene: SceneUpdate) -> rr.LineStrips3D:
    drawn = [line for e in scene.entities for line in e.lines]
    return rr.LineStrips3D(
        [_rows([(p.x, p.y, p.z) for p in line.points], 3) for line in drawn],
        radii=[line.thickness / 2 for line in drawn],
        colors=_colors([line.color for line in drawn]),
    )


def arrows(scene: SceneUpdate) -> rr.Arrows3D:
    """Horizontal arrows, each with the text of its entity."""
    drawn = [(e, a) for e in scene.entities for a in e.arrows]
    vectors = []
    for _, arrow in drawn:
        q, length = arrow.pose.orientation, arrow.shaft_length + arrow.head_length
        yaw_rad = 2 * np.arctan2(q.z, q.w)
        vectors.append((length * np.cos(yaw_rad), length * np.sin(yaw_rad), 0.0))
    return rr.Arrows3D(
        origins=_xyz([a.pose for _, a in drawn]),
        vectors=_rows(vectors, 3),
        radii=[a.shaft_diameter / 2 for _, a in drawn],
        colors=_colors([a.color for _, a in drawn]),
        labels=[_words(e) for e, _ in drawn],
    )


def _words(entity: SceneEntity) -> str:
    return " ".join(text.text for text in entity.texts)


def _xyzw(pose: Pose) -> tuple[float, ...]:
    q = pose.orientation
    return q.x, q.y, q.z, q.w


def _xyz(poses: list[Pose]) -> NDArray[np.float32]:
    return _rows([(p.position.x, p.position.y, p.position.z) for p in poses], 3)


def _rows(values: list[tuple[float, ...]], columns: int) -> NDArray[np.float32]:
    return np.array(values, np.float32).reshape(-1, columns)


def _colors(colors: list[Color], opaque: bool = False) -> NDArray[np.uint8]:
    values = [(c.r, c.g, c.b, 1.0 if opaque else c.a) for c in colors]
    return (255 * _rows(values, 4)).round().astype(np.uint8)
