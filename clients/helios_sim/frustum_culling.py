"""Which geoms a camera cannot see, by bounding spheres. MuJoCo would draw all of them."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray


class Frustum:
    """The four side planes and the front of a fixed camera's view."""

    def __init__(self, model: mujoco.MjModel, camera: int, aspect: float) -> None:
        """aspect: width by height."""
        self._camera = camera
        tan_y = math.tan(math.radians(float(model.cam_fovy[camera])) / 2)
        tan_x = tan_y * aspect
        # Inward normals in the camera's frame, which looks along -z with y up.
        planes = [
            (1.0, 0.0, -tan_x),
            (-1.0, 0.0, -tan_x),
            (0.0, 1.0, -tan_y),
            (0.0, -1.0, -tan_y),
            (0.0, 0.0, -1.0),
        ]
        self._normals = np.array([np.array(p) / np.linalg.norm(p) for p in planes])
        # Planes and height fields have no bounding sphere.
        self._radius_m = np.where(model.geom_rbound > 0, model.geom_rbound, np.inf)

    def outside(self, data: mujoco.MjData) -> NDArray[np.bool_]:
        """Geoms that lie wholly outside [ngeom]."""
        R_world_cam = data.cam_xmat[self._camera].reshape(3, 3)
        away = (data.geom_xpos - data.cam_xpos[self._camera]) @ (R_world_cam @ self._normals.T)
        return away.min(axis=1) < -self._radius_m
