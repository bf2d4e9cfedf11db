"""Sensor services of the fake Spot: robot state and images."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from tests.fake_spot import pb
from tests.fake_spot.body import HAND, Arm, Array, pose
from tests.fake_spot.cameras import DEPTH_SCALE, Source
from tests.fake_spot.scene import Seen, look
from tests.fake_spot.world import GROUND_IN_VISION_M, World


def inverse(T: Array) -> Array:
    return np.asarray(np.linalg.inv(T), np.float64)


def frame_tree(world: World, source: Source | None = None) -> Any:
    """The frame tree as on the real robot: the body is the root, and vision is its child."""
    tree = pb.geometry.FrameTreeSnapshot()
    edges = tree.child_to_parent_edge_map
    edges["body"].parent_frame_name = ""

    def add(child: str, parent: str, T: Array) -> None:
        edges[child].parent_frame_name = parent
        made = pb.math_helpers.SE3Pose.from_matrix(T)
        edges[child].parent_tform_child.CopyFrom(made.to_proto())

    with world.lock:
        T_world_body = world.T_world_body
        T_vision_body = pose((0.0, 0.0, GROUND_IN_VISION_M)) @ T_world_body
        add("vision", "body", inverse(T_vision_body))
        add("odom", "body", inverse(T_vision_body))
        add("flat_body", "body", np.eye(4))
        add("hand", "body", world.T_flat_hand)
        add("arm0.link_wr1", "hand", pose((-HAND, 0.0, 0.0)))
        if source is None:
            add("gpe", "body", inverse(T_world_body) @ pose((world.x, world.y, 0.0)))
        else:
            add(source.frame, source.parent, source.T_parent_cam)
    return tree


class State(pb.servicer("RobotStateService")):
    def __init__(self, world: World) -> None:
        self._w = world

    def GetRobotState(self, request: Any, _: Any) -> Any:
        reply = pb.robot_state.RobotStateResponse()
        w, state = self._w, reply.robot_state
        with w.lock:
            w.step()
            power = pb.robot_state.PowerState
            state.power_state.motor_power_state = power.STATE_ON if w.motors else power.STATE_OFF
            state.power_state.locomotion_charge_percentage.value = 88
            kinematics = state.kinematic_state
            pb.util.set_timestamp_from_nsec(kinematics.acquisition_timestamp, w.robot_ns)
            kinematics.transforms_snapshot.CopyFrom(frame_tree(w))
            for name, angle in Arm(w.T_flat_hand).joints.items():
                kinematics.joint_states.add(name=name).position.value = angle
            for name in sorted(w.estops):
                pressed = pb.robot_state.EStopState.STATE_ESTOPPED
                state.estop_states.add(name=name, state=pressed)
            hand = state.manipulator_state
            hand.gripper_open_percentage = 100 * w.open
            hand.is_gripper_holding_item = bool(w.held)
            hand.stow_state = hand.STOWSTATE_STOWED if w.stowed else hand.STOWSTATE_DEPLOYED
        return pb.answer(reply, request, w.robot_ns)

    def GetRobotHardwareConfiguration(self, request: Any, _: Any) -> Any:
        reply = pb.robot_state.RobotHardwareConfigurationResponse()
        for name in ("base_link", "arm0.link_sh0"):
            reply.hardware_configuration.skeleton.links.add(name=name)
        return pb.answer(reply, request, self._w.robot_ns)


class Images(pb.servicer("ImageService")):
    """Serves images. `sources` may lose members at runtime, as when a camera breaks."""

    def __init__(self, world: World, sources: dict[str, Source]) -> None:
        self._w, self.sources = world, sources
        self._last: tuple[Any, Seen] | None = None

    def ListImageSources(self, request: Any, _: Any) -> Any:
        reply = pb.image.ListImageSourcesResponse(
            image_sources=[source_message(s) for s in self.sources.values()]
        )
        return pb.answer(reply, request, self._w.robot_ns)

    def GetImage(self, request: Any, _: Any) -> Any:
        reply = pb.image.GetImageResponse()
        for asked in request.image_requests:
            out = reply.image_responses.add()
            source = self.sources.get(asked.image_source_name)
            if source is None:
                out.status = out.STATUS_UNKNOWN_CAMERA
                continue
            self._take(source, asked, out)
        return pb.answer(reply, request, self._w.robot_ns)

    def _take(self, source: Source, asked: Any, out: Any) -> None:
        w, shot = self._w, out.shot
        with w.lock:
            tree = frame_tree(w, source)
            parent = w.T_world_hand if source.parent == "hand" else w.T_world_body
            shapes = w.shapes
            if source.parent == "body":
                shapes |= Arm(w.T_flat_hand).shapes(w.T_world_body)
            pb.util.set_timestamp_from_nsec(shot.acquisition_time, w.robot_ns)
        seen = self._see(source, shapes, parent @ source.T_parent_cam)
        out.source.CopyFrom(source_message(source))
        shot.frame_name_image_sensor = source.frame
        shot.transforms_snapshot.CopyFrom(tree)
        image = shot.image
        image.cols, image.rows = source.cols, source.rows
        if source.depth:
            image.pixel_format, image.format = image.PIXEL_FORMAT_DEPTH_U16, image.FORMAT_RAW
            image.data = np.rint(seen.depth_m * DEPTH_SCALE).astype("<u2").tobytes()
        else:
            image.pixel_format = (
                image.PIXEL_FORMAT_GREYSCALE_U8 if source.grey else image.PIXEL_FORMAT_RGB_U8
            )
            self._encode(seen, source, asked, image)
        out.status = out.STATUS_OK

    def _encode(self, seen: Seen, source: Source, asked: Any, image: Any) -> None:
        code = cv2.COLOR_RGB2GRAY if source.grey else cv2.COLOR_RGB2BGR
        if asked.image_format == image.FORMAT_RAW:
            pixels = cv2.cvtColor(seen.color, code) if source.grey else seen.color
            image.format, image.data = image.FORMAT_RAW, pixels.tobytes()
            return
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(asked.quality_percent) or 75]
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(seen.color, code), quality)
        image.format, image.data = image.FORMAT_JPEG, jpeg.tobytes()

    def _see(self, source: Source, shapes: dict[str, Any], T_world_cam: Array) -> Seen:
        """Cast once for colour and depth of one moment, which are requested in sequence."""
        key = (source.rays.shape, source.focal, T_world_cam.tobytes(), tuple(shapes.values()))
        if self._last is None or self._last[0] != key:
            self._last = (key, look(shapes, T_world_cam, source.rays))
        return self._last[1]


def source_message(source: Source) -> Any:
    """The ImageSource of a camera."""
    out = pb.image.ImageSource(name=source.name, cols=source.cols, rows=source.rows)
    model = out.pinhole.intrinsics
    if source.distortion:
        fisheye = out.kannala_brandt.intrinsics
        fisheye.k1, fisheye.k2, fisheye.k3, fisheye.k4 = source.distortion
        model = fisheye.pinhole_intrinsics
    model.focal_length.x = model.focal_length.y = source.focal
    model.principal_point.x, model.principal_point.y = source.K[0, 2], source.K[1, 2]
    if source.depth:
        out.depth_scale, out.image_type = DEPTH_SCALE, out.IMAGE_TYPE_DEPTH
        out.pixel_formats.append(pb.image.Image.PIXEL_FORMAT_DEPTH_U16)
    else:
        grey = pb.image.Image.PIXEL_FORMAT_GREYSCALE_U8
        out.image_type = out.IMAGE_TYPE_VISUAL
        out.pixel_formats.append(grey if source.grey else pb.image.Image.PIXEL_FORMAT_RGB_U8)
    return out
