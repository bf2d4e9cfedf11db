"""Ground truth of past frames, rendered on request."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_sim.ground_truth import Segmentation, VisibleBody
from helios_sim.home import Home
from helios_sim.mujoco_library import mujoco
from helios_sim.renderer import CameraRenderer
from helios_sim.robot_model import camera_pose

MAX_STORED_CAPTURES = 64
_REMEMBERED_PICTURES = 4


@dataclass(frozen=True)
class _Capture:
    """State of a capture; see `CaptureHistory.store`."""

    qpos: NDArray[np.float64]
    on: Mapping[str, str]
    shown: tuple[str, float] | None


class CaptureHistory:
    """Last captures of a world: joint positions by stamp."""

    def __init__(
        self, model: mujoco.MjModel, painter: CameraRenderer, home: Home, graspable: Collection[int]
    ) -> None:
        """graspable: bodies that can be picked up."""
        self._model, self._painter = model, painter
        self._data = mujoco.MjData(model)
        self._painted: OrderedDict[bytes, NDArray[np.int32]] = OrderedDict()
        self._taken: OrderedDict[int, _Capture] = OrderedDict()
        names = [model.body(body).name for body in range(model.nbody)]
        known = set(home.body_names())
        sizes = {item.name: item.size_m for item in (*home.receptacles, *home.fixtures)}
        self._instances: dict[int, VisibleBody] = {}
        for body, name in enumerate(names):
            if name in known:
                x, y, z = (float(v) for v in model.body_pos[body])
                # Furniture has its origin on the floor, a movable object at its centre.
                z += sizes[name][2] / 2 if name in sizes else 0.0
                self._instances[body] = VisibleBody(
                    body, name, home.class_of(name), body in graspable, (x, y, z)
                )

    def store(
        self,
        stamp_ns: int,
        qpos: NDArray[np.float64],
        on: Mapping[str, str],
        shown: tuple[str, float] | None = None,
        ids: NDArray[np.int32] | None = None,
    ) -> None:
        """Store the state of a capture.

        on: graspable object -> body on which it stands. shown: name and turn (rad) of the object
        shown to the camera. ids: body ids [h, w], if already rendered.
        """
        self._taken[stamp_ns] = _Capture(qpos.copy(), dict(on), shown)
        if ids is not None:
            self._remember(qpos.tobytes(), ids)
        while len(self._taken) > MAX_STORED_CAPTURES:
            self._taken.popitem(last=False)

    def segmentation(self, stamp_ns: int) -> Segmentation:
        """Segmentation of one of the last 64 captures. Raises InvalidInput for any other stamp."""
        if stamp_ns not in self._taken:
            raise InvalidInput(
                f"there is no capture with stamp {stamp_ns} among the last "
                f"{MAX_STORED_CAPTURES}; ask with a frame's own stamp, and sooner"
            )
        taken = self._taken[stamp_ns]
        ids = self.bodies(taken.qpos)
        self._data.qpos[:] = taken.qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        instances = tuple(
            self._instance(body, taken) for body in _values(ids) if body in self._instances
        )
        pose = camera_pose(self._data, self._painter.camera)
        return Segmentation(stamp_ns, ids, instances, pose)

    def bodies(self, qpos: NDArray[np.float64]) -> NDArray[np.int32]:
        """Body id of each pixel [h, w] for these joint positions. Cached and read-only."""
        key = qpos.tobytes()
        if key not in self._painted:
            self._data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_camlight(self._model, self._data)
            self._remember(key, self._painter.body_ids(self._data))
        return self._painted[key]

    def _remember(self, key: bytes, ids: NDArray[np.int32]) -> None:
        ids.flags.writeable = False
        self._painted[key] = ids
        while len(self._painted) > _REMEMBERED_PICTURES:
            self._painted.popitem(last=False)

    def _instance(self, body: int, taken: _Capture) -> VisibleBody:
        static = self._instances[body]
        if not static.graspable:
            return static
        x, y, z = (float(v) for v in self._data.xpos[body])
        shown, turn_rad = taken.shown or ("", 0.0)
        return replace(
            static,
            center_m=(x, y, z),
            on=taken.on[static.name],
            turn_rad=turn_rad if static.name == shown else 0.0,
        )


def _values(ids: NDArray[np.int32]) -> list[int]:
    """Values in an image, ascending. Its runs of equal pixels are far fewer than its pixels."""
    flat = ids.ravel()
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    return np.unique(np.append(flat[changes], flat[-1])).tolist()
