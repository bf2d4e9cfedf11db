"""Rendering: colour and depth in one pass, or depth and body ids in one pass.

A `CameraRenderer` holds a GL context; only the thread that created it may use it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_core.errors import Unavailable
from numpy.typing import NDArray

from helios_sim.frustum_culling import Frustum
from helios_sim.mujoco_library import mujoco, no_opengl

_MAX_GEOMS = 5000  # must fit into two bytes of the segmentation image
_HIDDEN_GROUP = 5


def metric_depth(
    buffer: NDArray[np.float32], near_m: float, far_m: float, max_depth_m: float
) -> NDArray[np.float32]:
    """Depth along the optical axis [h, w] in metres from a reversed depth buffer; 0 beyond range.

    The buffer holds 1 at the near plane and 0 at the far one:
    buffer = (far near / z - near) / (far - near).
    """
    span = far_m - near_m
    z = buffer + np.float32(near_m / span)
    np.divide(np.float32(far_m * near_m / span), z, out=z)
    z[z > max_depth_m] = 0.0
    return z


class CameraRenderer:
    """Renders one model through one fixed camera. Raises Unavailable without OpenGL."""

    def __init__(
        self,
        model: mujoco.MjModel,
        camera: int,
        size: tuple[int, int],
        groups: Sequence[int],
    ) -> None:
        """size: (width, height) in pixels; groups: the geom groups that are drawn."""
        self._model, self.camera = model, camera
        self._width, self._height = size
        try:
            gl = mujoco.GLContext(*size)
            gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            from OpenGL import GL  # of the platform that MuJoCo has chosen by now
        except Exception as error:
            raise no_opengl(error) from error
        self._gl: mujoco.GLContext | None = gl
        self._GL = GL
        if self._context.offSamples:
            raise Unavailable(
                "images with several samples a pixel cannot be read; set offsamples 0"
            )
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
        self._viewport = mujoco.MjrRect(0, 0, self._width, self._height)
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [int(group in groups) for group in range(6)]
        self._frustum = Frustum(model, camera, size[0] / size[1])
        self._groups = model.geom_group.copy()
        # With shadows, a geom outside the view may still cast a visible shadow.
        self._cull = not (model.light_castshadow.any() and model.vis.quality.shadowsize > 0)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = camera
        extent_m = float(model.stat.extent)
        self._near_m = float(model.vis.map.znear) * extent_m
        self._far_m = float(model.vis.map.zfar) * extent_m

    def color_and_depth(
        self, data: mujoco.MjData, max_depth_m: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """RGB [h, w, 3] and metric depth along the optical axis [h, w], from one pass."""
        self._draw(data, segment=False)
        color = np.ascontiguousarray(self._pixels()[::-1, :, :3])
        return color, self._depth(max_depth_m)

    def depth_and_body_ids(
        self, data: mujoco.MjData, max_depth_m: float
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Same depth as `color_and_depth` and same ids as `body_ids`, from one pass without
        colour: about half the time of the pass with colour.
        """
        self._draw(data, segment=True)
        return self._depth(max_depth_m), self._bodies()

    def body_ids(self, data: mujoco.MjData) -> NDArray[np.int32]:
        """Body id of each pixel [h, w]; 0 for background and for the world body."""
        self._draw(data, segment=True)
        return self._bodies()

    def _pixels(self) -> NDArray[np.uint8]:
        """Drawn pixels [h, w, 4], RGBA, the lowest row first.

        OpenGL converts on a read in another format, which takes six times as long.
        """
        pixels = np.empty((self._height, self._width, 4), np.uint8)
        self._GL.glReadPixels(
            0, 0, self._width, self._height, self._GL.GL_RGBA, self._GL.GL_UNSIGNED_BYTE, pixels
        )
        return pixels

    def _depth(self, max_depth_m: float) -> NDArray[np.float32]:
        buffer = np.empty((self._height, self._width), np.float32)
        mujoco.mjr_readPixels(None, buffer, self._viewport, self._context)
        return metric_depth(buffer[::-1], self._near_m, self._far_m, max_depth_m)

    def _bodies(self) -> NDArray[np.int32]:
        """Body ids of the drawn segmentation; red and green hold the low and the high byte."""
        low_high = self._pixels().view("<u2")[::-1, :, 0]
        body_of = np.zeros(self._scene.ngeom + 1, np.int32)
        geom_type = int(mujoco.mjtObj.mjOBJ_GEOM)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == geom_type:
                body_of[geom.segid + 1] = self._model.geom_bodyid[geom.objid]
        # Runs of equal pixels are far fewer than pixels.
        flat = np.ascontiguousarray(low_high).ravel()
        begins = np.empty(flat.size, bool)
        begins[0] = True
        np.not_equal(flat[1:], flat[:-1], out=begins[1:])
        starts = np.flatnonzero(begins)
        lengths = np.diff(starts, append=flat.size)
        return np.repeat(body_of[flat[starts]], lengths).reshape(low_high.shape)

    def close(self) -> None:
        """Release the GL context; call it from the thread that created it."""
        if self._gl is not None:
            self._context.free()
            self._gl.free()
            self._gl = None

    def _draw(self, data: mujoco.MjData, *, segment: bool) -> None:
        if self._gl is None:
            raise Unavailable("the world is closed")
        self._gl.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        if self._cull:
            self._model.geom_group[self._frustum.outside(data)] = _HIDDEN_GROUP
        mujoco.mjv_updateScene(
            self._model, data, self._option, None, self._camera, everything, self._scene
        )
        self._model.geom_group[:] = self._groups
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self._scene.flags[flag] = segment
        mujoco.mjr_render(self._viewport, self._scene, self._context)
