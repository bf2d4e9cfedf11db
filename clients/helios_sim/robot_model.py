"""Robot model: an upright cylinder on a planar base, a camera on a tilting head, one gripper.

The base moves by three velocity-controlled joints (x, y, yaw); the head tilts about its y axis.
The robot is not drawn: its own body never appears in its images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix, Pinhole
from helios_core.types import RobotDescription

from helios_sim.mujoco_library import mujoco

BODY_RADIUS_M = 0.27
BODY_BOTTOM_M = 0.01
BODY_TOP_M = 1.25
CAMERA_HEIGHT_M = 1.31
IMAGE_WIDTH, IMAGE_HEIGHT = 640, 480
FOVY_DEG = 54.0  # horizontal: 68.4 degrees
MAX_DEPTH_M = 10.0
TILT_RANGE_RAD = (-0.6, 1.2)
START_TILT_RAD = math.pi / 6
REACH_M = 0.8  # gripper at rest to object centre; also true of the ground distance from the base
GRIPPER_BASE_M = (0.45, 0.0, 0.75)  # end effector at rest, base frame
CARRY_BASE_M = (-0.15, 0.0, 1.75)  # centre of a held object, base frame: behind the camera
SHOW_BASE_M = (0.5, 0.0, 1.13)  # centre of a shown object, base frame: before the camera

BASE_BODY, HEAD_BODY, CAMERA = "robot_base", "robot_head", "robot_camera"
ROBOT_GROUP = 4  # not drawn
_MASS_KG = 25.0
_DRIVES = (("robot_x", 3000.0, 400.0), ("robot_y", 3000.0, 400.0), ("robot_yaw", 300.0, 60.0))


def pinhole() -> Pinhole:
    """Intrinsics of the rendered image; integer coordinates are pixel centres."""
    f = IMAGE_HEIGHT / 2 / math.tan(math.radians(FOVY_DEG) / 2)
    return Pinhole(f, f, IMAGE_WIDTH / 2 - 0.5, IMAGE_HEIGHT / 2 - 0.5, IMAGE_WIDTH, IMAGE_HEIGHT)


def description(max_depth_m: float = MAX_DEPTH_M) -> RobotDescription:
    """Description of the robot, as its driver reports it."""
    return RobotDescription(
        name="simulated robot",
        footprint_radius_m=0.3,
        height_m=1.35,
        camera=pinhole(),
        camera_height_m=CAMERA_HEIGHT_M,
        reach_m=REACH_M,
        max_depth_m=max_depth_m,
        max_back_m=0.3,
        tilt_range_rad=TILT_RANGE_RAD,
        show_base_m=SHOW_BASE_M,
        simulated=True,
    )


def add_robot(spec: mujoco.MjSpec) -> None:
    """Add the robot to a model, at the origin of the base joints."""
    base = spec.worldbody.add_body(name=BASE_BODY)
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    base.add_joint(name="robot_x", type=slide, axis=[1, 0, 0])
    base.add_joint(name="robot_y", type=slide, axis=[0, 1, 0])
    base.add_joint(name="robot_yaw", type=hinge, axis=[0, 0, 1])
    body = base.add_geom(
        name="robot_body",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[BODY_RADIUS_M, (BODY_TOP_M - BODY_BOTTOM_M) / 2, 0],
        pos=[0, 0, (BODY_TOP_M + BODY_BOTTOM_M) / 2],
    )
    body.mass, body.group, body.friction = _MASS_KG, ROBOT_GROUP, [0.05, 0.005, 0.0001]
    head = base.add_body(name=HEAD_BODY, pos=[0, 0, CAMERA_HEIGHT_M])
    # A positive angle about +y lowers the view.
    head.add_joint(name="robot_tilt", type=hinge, axis=[0, 1, 0], damping=[1.0, 0.0, 0.0])
    skull = head.add_geom(
        name="robot_skull", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.04, 0, 0], pos=[0, 0, 0]
    )
    skull.mass, skull.group, skull.contype, skull.conaffinity = 0.3, ROBOT_GROUP, 0, 0
    camera = head.add_camera(name=CAMERA, fovy=FOVY_DEG)
    camera.quat = [0.5, 0.5, -0.5, -0.5]  # looks along +x with z up
    for joint, gain, force in _DRIVES:
        drive = spec.add_actuator(
            name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=[-force, force]
        )
        drive.set_to_velocity(gain)


@dataclass(frozen=True)
class RobotIndex:
    """Indices of the robot in the arrays of a compiled model."""

    qpos: tuple[int, int, int]  # x, y, yaw
    dof: tuple[int, int, int]
    tilt_qpos: int
    tilt_dof: int
    controls: tuple[int, int, int]
    camera: int
    bodies: frozenset[int]
    geoms: frozenset[int]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> RobotIndex:
        names = [name for name, _, _ in _DRIVES]
        q = [int(model.joint(name).qposadr[0]) for name in names]
        v = [int(model.joint(name).dofadr[0]) for name in names]
        u = [int(model.actuator(name).id) for name in names]
        bodies = frozenset(int(model.body(name).id) for name in (BASE_BODY, HEAD_BODY))
        geoms = (g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in bodies)
        return cls(
            qpos=(q[0], q[1], q[2]),
            dof=(v[0], v[1], v[2]),
            tilt_qpos=int(model.joint("robot_tilt").qposadr[0]),
            tilt_dof=int(model.joint("robot_tilt").dofadr[0]),
            controls=(u[0], u[1], u[2]),
            camera=int(model.camera(CAMERA).id),
            bodies=bodies,
            geoms=frozenset(geoms),
        )

    def pose(self, data: mujoco.MjData) -> tuple[float, float, float]:
        """Pose (x, y, yaw) of the base; yaw is not wrapped."""
        x, y, yaw = (float(data.qpos[k]) for k in self.qpos)
        return x, y, yaw


def camera_pose(data: mujoco.MjData, camera: int) -> Matrix:
    """T_world_cam [4, 4] in the OpenCV convention; MuJoCo cameras look along -z with y up."""
    out = np.eye(4)
    out[:3, :3] = data.cam_xmat[camera].reshape(3, 3) * [1.0, -1.0, -1.0]
    out[:3, 3] = data.cam_xpos[camera]
    return out
