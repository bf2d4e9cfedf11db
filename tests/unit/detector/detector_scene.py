"""A small ray-cast room: boxes on a floor seen by a tilted camera, with each pixel's truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from helios_core.errors import Unavailable
from helios_core.geometry import Matrix, Pinhole, camera_on_base, se2_to_se3
from helios_core.types import Frame, FrameId, Role, SearchClass, SearchContext
from helios_detector.simulator_truth import Truth, TruthInstance
from numpy.typing import NDArray

CAMERA = Pinhole(300.0, 300.0, 160.0, 120.0, 320, 240)


@dataclass(frozen=True)
class Box:
    """An axis-aligned box that stands for an object."""

    id: int
    class_name: str
    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    graspable: bool = False


TABLE = Box(1, "dining table", (1.5, -0.6, 0.70), (2.5, 0.6, 0.75))
MUG = Box(2, "mug", (1.75, 0.05, 0.75), (1.83, 0.13, 0.85), True)
BOWL = Box(3, "bowl", (1.75, -0.30, 0.75), (1.90, -0.15, 0.82), True)
WALL = Box(4, "wall", (4.0, -5.0, 0.0), (4.1, 5.0, 3.0))
ROOM = (TABLE, MUG, BOWL, WALL)


def looking(x_m: float = 0.5, y_m: float = 0.0, yaw_rad: float = 0.0) -> Matrix:
    """T_world_cam of a camera 1.3 m up, tilted 25 degrees down."""
    return camera_on_base(se2_to_se3(x_m, y_m, yaw_rad), 1.3, np.deg2rad(25))


def render(
    boxes: tuple[Box, ...], T_world_cam: Matrix, camera: Pinhole = CAMERA
) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
    """(depth in metres [h, w], ids [h, w]); the floor has id 0, the sky depth 0."""
    depth_m, ids = _render(boxes, T_world_cam.tobytes(), camera)
    return depth_m.copy(), ids.copy()


@cache
def _render(
    boxes: tuple[Box, ...], pose: bytes, camera: Pinhole
) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
    T_world_cam = np.frombuffer(pose).reshape(4, 4)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays_cam = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, u * 0 + 1], -1)
    rays = rays_cam @ T_world_cam[:3, :3].T
    eye = T_world_cam[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
        depth, ids = floor, np.zeros(floor.shape, np.uint16)
        for box in boxes:
            near = (np.array(box.low_m) - eye) / rays
            far = (np.array(box.high_m) - eye) / rays
            enter = np.minimum(near, far).max(-1)
            leave = np.maximum(near, far).min(-1)
            hit = (enter > 0) & (enter <= leave) & (enter < depth)
            depth, ids = np.where(hit, enter, depth), np.where(hit, box.id, ids).astype(np.uint16)
    return np.where(depth < 10, depth, 0).astype(np.float32), ids


def frame_of(
    boxes: tuple[Box, ...] = ROOM, T_world_cam: Matrix | None = None, seq: int = 1
) -> Frame:
    T = looking() if T_world_cam is None else T_world_cam
    depth_m, ids = render(boxes, T)
    color = np.repeat((40 * (ids % 6)).astype(np.uint8)[..., None], 3, -1)
    return Frame(FrameId("boot", 0, seq), seq * 10**8, True, color, depth_m, CAMERA, T, np.eye(4))


@dataclass
class SceneTruth:
    """The ground truth of every frame that it has made."""

    boxes: tuple[Box, ...] = ROOM
    ids: dict[int, NDArray[np.uint16]] = field(default_factory=dict)
    poses: dict[int, Matrix] = field(default_factory=dict)
    down: bool = False

    def frame(self, T_world_cam: Matrix | None = None, seq: int = 1) -> Frame:
        out = frame_of(self.boxes, T_world_cam, seq)
        self.ids[out.stamp_ns] = render(self.boxes, out.T_world_cam)[1]
        self.poses[out.stamp_ns] = out.T_world_cam
        return out

    def segmentation(self, stamp_ns: int) -> Truth:
        self.check()
        middle = {b.id: (np.array(b.low_m) + np.array(b.high_m)) / 2 for b in self.boxes}
        instances = {
            b.id: TruthInstance(b.id, b.class_name, middle[b.id], b.graspable) for b in self.boxes
        }
        return Truth(self.ids[stamp_ns], instances, self.poses[stamp_ns])

    def check(self) -> None:
        if self.down:
            raise Unavailable("the world is away")


def context_of(
    *classes: str, threshold: float = 0.25, role: Role = Role.OBJECT, id: str = "c1"
) -> SearchContext:
    return SearchContext(id, tuple(SearchClass(name, role, threshold) for name in classes))


def box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """The smallest box around a mask."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
