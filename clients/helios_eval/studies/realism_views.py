"""Views of a simulated home for a detector trained on real images.

They show each object from two distances, with ground truth for every pixel. Lens and renderer are
those of the robot's own camera, without its noise.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import cv2
import mujoco
import numpy as np
from helios_core.geometry import Matrix, Pinhole, project
from helios_core.types import Frame, FrameId
from helios_sim.assets import FurnitureReplacement
from helios_sim.assets.asset_pack import Model
from helios_sim.home import Home
from helios_sim.home.home_types import Fixture, Receptacle, SceneObject, Shape
from helios_sim.renderer import CameraRenderer
from helios_sim.robot_model import CAMERA_HEIGHT_M, FOVY_DEG, MAX_DEPTH_M, camera_pose, pinhole
from helios_sim.robot_sensors import DRAWN_GROUPS
from numpy.typing import NDArray
from scipy import ndimage

THING_DISTANCES_M = (0.9, 1.5)
FURNITURE_DISTANCES_M = (2.0, 3.0)
CELL_M = 0.05
CAMERA = "realism"
NEAREST_M = 0.1

Box = tuple[int, int, int, int]  # x0, y0, x1, y1, half open


@dataclass(frozen=True)
class Thing:
    """One instance as seen in an image."""

    name: str
    class_name: str
    box_xyxy: Box
    pixels: int
    open_box: float  # IoU of its box with the box of its unoccluded outline
    open_pixels: float  # visible pixels / hull of that outline; both 0 if cut off
    model: Model | None  # the baked model of its looks; None: parametric


@dataclass(frozen=True)
class View:
    """Image and the objects in it, largest first."""

    frame: Frame
    things: tuple[Thing, ...]
    bodies: NDArray[np.int32]  # [h, w] body id of each pixel; 0 is background


@dataclass(frozen=True, eq=False)
class RecordedFurnitureModels(FurnitureReplacement):
    """Furniture models that record the model of each shape."""

    _made: list[tuple[object, Model]] = field(default_factory=list, repr=False)

    def _shape(
        self, model: Model, scale: NDArray[np.float64], drawn: Shape, *, origin_z: float
    ) -> Shape:
        shape = super()._shape(model, scale, drawn, origin_z=origin_z)
        self._made.append((shape.visuals, model))
        return shape

    def model_of(self, shape: Shape) -> Model | None:
        """Model of a shape; None if the shape is parametric."""
        return next((model for visuals, model in self._made if visuals is shape.visuals), None)


class ObserverCamera:
    """Camera that renders one home from anywhere. Holds a GL context: close it."""

    def __init__(self, home: Home, furniture_models: RecordedFurnitureModels | None) -> None:
        self.home, self._pinhole, self._number = home, pinhole(), 0
        spec = home.spec()
        spec.visual.global_.offwidth = self._pinhole.width
        spec.visual.global_.offheight = self._pinhole.height
        spec.worldbody.add_camera(name=CAMERA, fovy=FOVY_DEG)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._camera = int(self._model.camera(CAMERA).id)
        size = (self._pinhole.width, self._pinhole.height)
        self._painter = CameraRenderer(self._model, self._camera, size, DRAWN_GROUPS)
        self._models: dict[str, Model | None] = {
            thing.name: furniture_models.model_of(thing.shape) if furniture_models else None
            for thing in _things(home)
        }
        self._vertices = {
            thing.name: np.concatenate([v.mesh.vertices for v in thing.shape.visuals])
            for thing in _things(home)
        }

    def close(self) -> None:
        self._painter.close()

    def look(self, from_xy: tuple[float, float], at_m: tuple[float, float, float]) -> View:
        """View of a world point from the height of a robot's camera."""
        x, y = from_xy
        T = looking(np.array([x, y, CAMERA_HEIGHT_M]), np.array(at_m))
        self._model.cam_pos[self._camera] = T[:3, 3]
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, (T[:3, :3] * [1.0, -1.0, -1.0]).ravel())
        self._model.cam_quat[self._camera] = quat
        mujoco.mj_forward(self._model, self._data)
        color, depth_m = self._painter.color_and_depth(self._data, MAX_DEPTH_M)
        self._number += 1
        frame = Frame(
            FrameId("realism", self.home.seed, self._number),
            self._number,
            True,
            color,
            depth_m,
            self._pinhole,
            camera_pose(self._data, self._camera),
            np.eye(4),
        )
        bodies = self._painter.body_ids(self._data)
        return View(frame, self._seen(bodies, frame.T_world_cam), bodies)

    def names(self) -> dict[int, str]:
        """Name of each body, by its id."""
        return {body: self._model.body(body).name for body in range(self._model.nbody)}

    def _seen(self, bodies: NDArray[np.int32], T_world_cam: Matrix) -> tuple[Thing, ...]:
        out = []
        counts = np.bincount(bodies.ravel())
        for body, part in enumerate(ndimage.find_objects(bodies), 1):
            if part is None or (name := self._model.body(body).name) not in self._models:
                continue  # not in view, or wall or floor
            (rows, columns), pixels = part, int(counts[body])
            box = columns.start, rows.start, columns.stop, rows.stop
            class_name, model = self.home.class_of(name), self._models[name]
            shares = self._open(body, box, pixels, T_world_cam)
            out.append(Thing(name, class_name, box, pixels, *shares, model))
        return tuple(sorted(out, key=lambda t: -t.pixels))

    def _open(self, body: int, box: Box, pixels: int, T_world_cam: Matrix) -> tuple[float, float]:
        placed = self._data.body(body)
        vertices = self._vertices[placed.name] @ placed.xmat.reshape(3, 3).T + placed.xpos
        outline = outline_of(vertices, self._pinhole, T_world_cam)
        if outline is None:
            return 0.0, 0.0
        free, area = outline
        return iou(box, free), pixels / max(area, 1.0)

    def views(self, classes: Collection[str]) -> Iterator[View]:
        """Views of each object of these classes from two distances, where there is free floor."""
        free, origin = self.home.free_space(self.home.preset.robot_radius_m, CELL_M)
        rows, columns = np.nonzero(free)
        x, y = origin[0] + (columns + 0.5) * CELL_M, origin[1] + (rows + 0.5) * CELL_M
        room_of = {item.name: item.room for item in self.home.receptacles}
        for thing in _things(self.home):
            if thing.class_name not in classes:
                continue
            if isinstance(thing, SceneObject):
                at_m, room, distances_m = thing.position_m, room_of[thing.receptacle], None
            else:
                low_m = thing.z_m if isinstance(thing, Fixture) else 0.0
                at_m = (thing.x, thing.y, low_m + thing.size_m[2] / 2)
                room, distances_m = thing.room, FURNITURE_DISTANCES_M
            r = self.home.rooms[room]
            inside = (x > r.x0) & (x < r.x1) & (y > r.y0) & (y < r.y1)
            if not inside.any():
                continue
            away_m = np.where(inside, np.hypot(x - at_m[0], y - at_m[1]), math.inf)
            for wanted_m in distances_m or THING_DISTANCES_M:
                k = int(np.argmin(np.abs(away_m - wanted_m)))
                yield self.look((float(x[k]), float(y[k])), at_m)


def iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (a, b))
    return width * height / (areas - width * height)


def outline_of(
    points_m: NDArray[np.float64], camera: Pinhole, T_world_cam: Matrix
) -> tuple[Box, float] | None:
    """Box, and area of the convex hull (pixels), of projected world points [n, 3].

    None if a point is outside the image or behind the camera.
    """
    uv, z = project(points_m, camera, T_world_cam)
    if (z < NEAREST_M).any() or (uv < 0).any() or (uv > [camera.width, camera.height]).any():
        return None
    (x0, y0), (x1, y1) = np.floor(uv.min(0)), np.ceil(uv.max(0))
    area = cv2.contourArea(cv2.convexHull(uv.astype(np.float32)))
    return (int(x0), int(y0), int(x1), int(y1)), float(area)


def looking(eye_m: NDArray[np.float64], at_m: NDArray[np.float64]) -> Matrix:
    """T_world_cam [4, 4] (OpenCV) of a camera at `eye_m` that looks at `at_m` without roll.

    The two points must differ.
    """
    ahead = (at_m - eye_m) / np.linalg.norm(at_m - eye_m)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    out[:3, 3] = eye_m
    return out


def _things(home: Home) -> tuple[Receptacle | Fixture | SceneObject, ...]:
    return (*home.receptacles, *home.fixtures, *home.objects)
