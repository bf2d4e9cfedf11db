"""Grasping an object by its pixel, and placing at a point."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from helios_core.geometry import Matrix, project

from helios_spot import bosdyn_api
from helios_spot.arm_poses import placing_poses
from helios_spot.errors import doing
from helios_spot.frame_transforms import VISION, to_vision
from helios_spot.halt_conditions import Halt
from helios_spot.motion import POLL_S, CannotDo, Motion
from helios_spot.posed_images import HandShot, SpotCameras
from helios_spot.robot_connection import RobotConnection
from helios_spot.self_mask import SHOULDER_BODY_M

EDGE_PX = 4  # points this near to the image border count as outside

Point = tuple[float, float, float]


class SpotArm:
    """Grasping and placing, for the action thread only. Raises CannotDo on failure and leaves the
    arm where it is."""

    def __init__(
        self, link: RobotConnection, cameras: SpotCameras, motion: Motion, halt: Halt
    ) -> None:
        self._link, self._cameras, self._motion, self._halt = link, cameras, motion, halt
        self._s = link.settings

    def grasp(self, point_world_m: Point, class_name: str) -> None:
        """Look at the point, then grasp the object that the hand's camera sees there."""
        reading = self._link.read()
        if reading.holding:
            raise CannotDo("the gripper holds something already; place it first")
        point = to_vision(point_world_m, reading.ground_m)
        self._motion.gaze(point)
        shot = self._cameras.hand_shot()
        pixel = pixel_of(point, shot)
        if pixel is None:
            raise CannotDo(f"the hand cannot see the {class_name}; look from another place")
        why = self._wait_for_grasp(self._ask_grasp(shot, pixel), class_name)
        if not why and not self._link.read().holding:
            why = f"the gripper closed on nothing where the {class_name} should be"
        if why:
            self._motion.grip(open=True)
            raise CannotDo(why)

    def place(self, point_world_m: Point) -> None:
        """Release the held object above a point, and lift the hand again."""
        reading = self._link.read()
        if not reading.holding:
            raise CannotDo("the gripper holds nothing; pick something first")
        point = to_vision(point_world_m, reading.ground_m)
        shoulder = (reading.T_vision_body @ [*SHOULDER_BODY_M, 1.0])[:3]
        above, release = placing_poses(point, shoulder, self._s.place_clearance_m)
        move = self._motion.hand_to
        move(above, VISION, 1.0, "reach over the place")
        move(release, VISION, self._s.place_clearance_m, "go down to the place")
        self._motion.grip(open=True)
        end = time.monotonic() + self._s.rpc_timeout_s
        while self._link.read().holding:
            if time.monotonic() > end:
                raise CannotDo("the gripper opened but still holds the thing; look at it")
            self._halt.rest(POLL_S)
        move(above, VISION, self._s.place_clearance_m, "lift the hand")

    def _ask_grasp(self, shot: HandShot, pixel: tuple[float, float]) -> int:
        m = bosdyn_api.manipulation_api_pb2
        taken, source = shot.response.shot, shot.response.source
        mode = m.PICK_AUTO_WALK_AND_GAZE if self._s.walk_to_grasp else m.PICK_AUTO_GAZE
        grasp = m.PickObjectInImage(
            pixel_xy=bosdyn_api.geometry_pb2.Vec2(x=pixel[0], y=pixel[1]),
            transforms_snapshot_for_camera=taken.transforms_snapshot,
            frame_name_image_sensor=taken.frame_name_image_sensor,
            camera_model=source.pinhole,
            walk_gaze_mode=mode,
        )
        request = m.ManipulationApiRequest(pick_object_in_image=grasp)
        self._halt.check()
        with doing("grasp", self._link.host):
            client = self._link.client("manipulation")
            reply = client.manipulation_api_command(request, timeout=self._s.rpc_timeout_s)
        self._motion.check_after_command()
        return int(reply.manipulation_cmd_id)

    def _wait_for_grasp(self, id: int, class_name: str) -> str:
        """Wait for the end of the grasp; return the reason of a failure, else ""."""
        m = bosdyn_api.manipulation_api_pb2
        request = m.ManipulationApiFeedbackRequest(manipulation_cmd_id=id)
        end = time.monotonic() + self._s.grasp_timeout_s
        client: Any = self._link.client("manipulation")
        while time.monotonic() < end:
            with doing("grasp", self._link.host):
                reply = client.manipulation_api_feedback_command(
                    request, timeout=self._s.rpc_timeout_s
                )
            state = reply.current_state
            if state == m.MANIP_STATE_GRASP_SUCCEEDED:
                return ""
            if why := FINAL.get(m.ManipulationFeedbackState.Name(state)):
                return why.format(class_name)
            self._halt.rest(POLL_S)
        self._motion.stop()
        return f"the grasp of the {class_name} took longer than {self._s.grasp_timeout_s:g} s"


FINAL = {
    "MANIP_STATE_GRASP_FAILED": "the grasp of the {} failed",
    "MANIP_STATE_GRASP_PLANNING_NO_SOLUTION": "the arm finds no way to grasp the {} from here",
    "MANIP_STATE_GRASP_FAILED_TO_RAYCAST_INTO_MAP": (
        "the robot has no depth where the {} is; look from another place"
    ),
    "MANIP_STATE_GRASP_PLANNING_WAITING_DATA_AT_EDGE": (
        "the {} lies at the edge of what the hand sees; look from another place"
    ),
    "MANIP_STATE_DONE": "the grasp of the {} was ended by somebody else",
}


def pixel_of(point_vision_m: Matrix, shot: HandShot) -> tuple[float, float] | None:
    """Pixel (u, v) of a point in the hand's camera; None outside the image."""
    uv, z = project(np.asarray(point_vision_m)[None], shot.camera, shot.T_vision_cam)
    u, v = (float(x) for x in uv[0]) if z[0] > 0 else (-1.0, -1.0)
    inside_u = EDGE_PX <= u < shot.camera.width - EDGE_PX
    inside_v = EDGE_PX <= v < shot.camera.height - EDGE_PX
    return (u, v) if inside_u and inside_v else None
