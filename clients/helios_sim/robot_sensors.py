"""Camera and odometry of a simulated robot: sensor data with errors, and their ground truth."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from helios_core.geometry import Matrix, Pinhole, se2_to_se3
from helios_core.robot import Capture
from numpy.typing import NDArray

from helios_sim.ground_truth import Segmentation
from helios_sim.home import Home
from helios_sim.mujoco_library import mujoco
from helios_sim.odometry_drift import DriftingOdometry, Pose, moved
from helios_sim.past_frame_truth import CaptureHistory
from helios_sim.renderer import CameraRenderer
from helios_sim.robot_model import MAX_DEPTH_M, RobotIndex, camera_pose
from helios_sim.sensor_noise import SensorErrorModel, sensed_color, sensed_depth

DRAWN_GROUPS = (0, 1, 2)

Point = tuple[float, float, float]


class RobotSensors:
    """Camera and odometry. Holds a GL context; only the thread that created it may use it."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotIndex,
        camera: Pinhole,
        home: Home,
        graspable: Collection[int],
        sensor: SensorErrorModel,
        colored: bool,
        reported_start: Pose | None = None,
    ) -> None:
        """graspable: bodies that can be picked up. colored, reported_start: as for `World`."""
        self._model, self._data = model, data
        self._robot, self._camera = robot, camera
        self._sensor, self._seed = sensor, home.seed
        size = (camera.width, camera.height)
        self._painter = CameraRenderer(model, robot.camera, size, DRAWN_GROUPS)
        self._past = CaptureHistory(model, self._painter, home, graspable)
        self._drift = DriftingOdometry(sensor, home.seed, robot.pose(data), reported_start)
        self._last_stamp_ns = 0
        self._no_color = None if colored else np.zeros((camera.height, camera.width, 3), np.uint8)

    @property
    def T_world_base(self) -> Matrix:
        """Estimated base pose [4, 4]."""
        return se2_to_se3(*self._drift.estimated_pose)

    @property
    def T_estimated_true(self) -> Matrix:
        """Transform [4, 4] from the true world frame to the currently estimated world frame."""
        return self._drift.T_estimated_true

    def true_point_m(self, believed_m: Point) -> Point:
        """True world position of a point given in the robot's estimated world frame."""
        return believed_m if self._drift.is_exact else self._drift.true_point_m(believed_m)

    def update_odometry(self) -> tuple[float, float]:
        """Update the odometry; return the measured motion (m, rad) since the last call."""
        before = self._drift.estimated_pose
        self._drift.follow(self._robot.pose(self._data))
        return moved(before, self._drift.estimated_pose)

    def capture(self, on: Mapping[str, str], shown: tuple[str, float] | None = None) -> Capture:
        """Capture of RGB and depth from one pass, stamped with simulated time.

        on: movable object -> body on which it stands, and shown: the object shown to the camera
        with its turn, both for the ground truth of this capture.
        """
        stamp_ns = max(round(float(self._data.time) * 1e9), self._last_stamp_ns + 1)
        self._last_stamp_ns = stamp_ns
        if self._no_color is None:
            color, depth_m = self._painter.color_and_depth(self._data, MAX_DEPTH_M)
            color = sensed_color(color, self._sensor, self._seed, stamp_ns)
            self._past.store(stamp_ns, self._data.qpos, on, shown)
        else:
            color = self._no_color
            depth_m, ids = self._painter.depth_and_body_ids(self._data, MAX_DEPTH_M)
            self._past.store(stamp_ns, self._data.qpos, on, shown, ids)
        return Capture(
            stamp_ns=stamp_ns,
            color=color,
            depth_m=sensed_depth(depth_m, self._camera, self._sensor, self._seed, stamp_ns),
            camera=self._camera,
            T_world_cam=self.T_estimated_true @ camera_pose(self._data, self._robot.camera),
            T_world_base=self.T_world_base,
        )

    def capture_moving(self) -> Capture:
        """Capture in the middle of a drive, without ground truth for it.

        Drift is added at the end of an action, so that images during it change nothing.
        """
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        stamp_ns = max(round(float(self._data.time) * 1e9), self._last_stamp_ns + 1)
        self._last_stamp_ns = stamp_ns
        color, depth_m = self._painter.color_and_depth(self._data, MAX_DEPTH_M)
        T_world_base = self.T_estimated_true @ se2_to_se3(*self._robot.pose(self._data))
        return Capture(
            stamp_ns=stamp_ns,
            color=sensed_color(color, self._sensor, self._seed, stamp_ns),
            depth_m=sensed_depth(depth_m, self._camera, self._sensor, self._seed, stamp_ns),
            camera=self._camera,
            T_world_cam=self.T_estimated_true @ camera_pose(self._data, self._robot.camera),
            T_world_base=T_world_base,
        )

    def color_image(self) -> NDArray[np.uint8]:
        """Color image [h, w, 3], RGB, of the current view without sensor errors."""
        return self._painter.color_and_depth(self._data, MAX_DEPTH_M)[0]

    def bodies_in_view(self) -> NDArray[np.int32]:
        """Body id of each pixel of the current view [h, w]. Read-only."""
        return self._past.bodies(self._data.qpos)

    def segmentation(self, stamp_ns: int) -> Segmentation:
        """Segmentation of one of the last 64 captures. Raises InvalidInput for any other stamp."""
        return self._past.segmentation(stamp_ns)

    def close(self) -> None:
        """Release the GL context; call it from the thread that created it."""
        self._painter.close()
