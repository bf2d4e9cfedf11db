"""Frustum culling of geoms by their bounding spheres, because MuJoCo draws all geoms."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from helios_sim.mujoco_library import mujoco


class Frustum:
    """View frustum of a fixed camera: four side planes and the front plane."""

    def __init__(self, model: mujoco.MjModel, camera: int, aspect: float) -> None:
        """aspect: width divided by height."""
        self._camera = camera
        tan_y = math.tan(math.radians(float(model.cam_fovy[camera])) / 2)
        tan_x = tan_y * aspect
        # Inward normals in the camera frame, in which the camera looks along -z with y up.
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
        """Mask [ngeom] of geoms that lie completely outside the frustum."""
        R_world_cam = data.cam_xmat[self._camera].reshape(3, 3)
        away = (data.geom_xpos - data.cam_xpos[self._camera]) @ (R_world_cam @ self._normals.T)
        return away.min(axis=1) < -self._radius_m
