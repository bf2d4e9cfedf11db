"""Fake services on a MemoryBus: a small home, a robot in it, one task. Deterministic."""

from __future__ import annotations

import json
import math
import threading

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus, Registration
from helios_core.codec import frame_to_proto, state_to_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.geometry import Pinhole, se2_to_se3
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CLEAR_STOP,
    EXPORT_OBJECTS,
    GAUSSIANS,
    KEYFRAME,
    LOAD_MAP2D,
    LOAD_OBJECTS,
    MAP2D_ACK,
    OBJECT_DETAIL,
    OBJECTMAP_ACK,
    OBJECTS,
    OBSERVATION,
    PICTURE,
    PLAN,
    RECALL,
    RENDER_OBJECTS,
    RESET_MAP2D,
    RESET_OBJECTS,
    ROBOT_CHECKS,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SAVE_MAP2D,
    SAVE_OBJECTS,
    SNAPSHOT,
    STOP,
    STORED_OBJECTS,
    SUPERVISOR,
    VOCABULARY,
    settings_method,
    status_topic,
)
from helios_core.types import Frame, FrameId, RobotState
from numpy.typing import NDArray

from tests.gateway_driving import MadeUpDriving
from tests.gateway_home import description, gaussians, picture_jpeg, snapshot, thing
from tests.gateway_tasks import MadeUpTasks

SERVICES = ("world", "bridge", "detector", "objectmap", "map2d", "planner")
CAMERA = Pinhole(fx=520.0, fy=520.0, cx=319.5, cy=239.5, width=640, height=480)


class Backend(MadeUpTasks):
    """All services behind a gateway. `start` serves them; tests then change single values."""

    def __init__(self, hub: MemoryHub, robot: str = "robot", bus: Bus | None = None) -> None:
        """bus: bus of the robot; None: one on the hub."""
        self.hub = hub
        super().__init__(bus or MemoryBus(hub, robot))
        self._alive: dict[str, Registration] = {}
        self.found = [
            thing(1, "mug", (1.55, 1.45, 0.49), (0.11, 0.09, 0.10), 0.71, 7),
            thing(2, "coffee table", (1.7, 1.5, 0.22), (1.0, 0.6, 0.44), 0.82, 12),
            thing(3, "kitchen counter", (7.4, 0.4, 0.46), (2.9, 0.6, 0.92), 0.58, 5),
            thing(4, "mug", (6.6, 2.3, 0.80), (0.10, 0.10, 0.11), 0.31, 2),
        ]
        self.pose = (3.1, 2.2, 2.5)
        self.battery: float | None = None
        self.stopped, self.stop_reason = False, ""
        self.state_late_s = 0.0  # delay of the state after a stop, behind the answer
        self.map_version = 41
        self.rendered: pb.RenderRequest | None = None
        self.stored = pb.StoredObjectsReply()  # objects of a stored map
        self.kept = {"map2d": b"walls", "objects": b"things"}  # data that a save returns
        self.refuses_maps: HeliosError | None = None  # error that map2d raises at a load
        self.recalls: HeliosError | None = None  # error that map2d raises at a query of past views
        self.seq = 0

    def start(self) -> None:
        self.serve_tasks()
        self.driving = MadeUpDriving(self.bus)
        serve = self.bus.serve
        serve(SNAPSHOT, self._snapshot)
        serve(PICTURE, self._picture)
        serve(OBJECTS, self._objects)
        serve(STORED_OBJECTS, lambda _: self.stored)
        serve(OBJECT_DETAIL, self._detail)
        serve(EXPORT_OBJECTS, self._export)
        serve(GAUSSIANS, lambda _: gaussians(self.found))
        serve(RENDER_OBJECTS, self._render)
        serve(SAVE_MAP2D, self._save_map2d)
        serve(SAVE_OBJECTS, lambda _: pb.ObjectMapFile(data=self.kept["objects"]))
        serve(LOAD_MAP2D, self._load_map2d)
        serve(LOAD_OBJECTS, self._load_objects)
        serve(RESET_MAP2D, lambda _: self._reset("map2d"))
        serve(RESET_OBJECTS, lambda _: self._reset("objects"))
        serve(RECALL, self._recall)
        serve(STOP, lambda request: self._latch(True, request.reason))
        serve(CLEAR_STOP, lambda _: self._latch(False, ""))
        serve(ROBOT_CHECKS, lambda _: pb.RobotChecksReply(
            checks=[
                pb.RobotCheck(name="pitch", verdict="wrong", value=1.6, error=0.1, limit=0.6,
                              unit="deg", words="the camera looks too far down"),
                pb.RobotCheck(name="height", verdict="not measured", limit=0.02, unit="m"),
            ],
            images=3,
        ))  # fmt: skip
        serve(
            VOCABULARY,
            lambda _: pb.VocabularyReply(
                open=False,
                names=["bowl", "coffee table", "kitchen counter", "mug", "sofa"],
                detector="simulated",
                scorer="words",
            ),
        )
        for pid, name in enumerate(SERVICES, start=4100):
            self.alive(name, pid)
        self.supervise()
        self.bus.publish(ROBOT_DESCRIPTION, description())
        self.publish_robot()

    def alive(self, name: str, pid: int, state: str = "ready", reason: str = "") -> None:
        self._alive[name] = self.bus.announce(name, f"{pid}-test")
        self.report(name, pid, state, reason)

    def die(self, name: str) -> None:
        """Drop the liveliness token, as if the process had died."""
        self._alive.pop(name).close()

    def report(self, name: str, pid: int, state: str, reason: str = "") -> None:
        status = pb.ServiceStatus(
            service=name,
            instance=f"{pid}-test",
            state=state,
            reason=reason,
            pid=pid,
            uptime_s=61.0,
            metrics={"update_ms_median": 2.5},
        )
        self.bus.publish(status_topic(name), status)

    def supervise(self, **restarts: int) -> None:
        names = ("router", *SERVICES, "gateway")
        self.bus.publish(
            SUPERVISOR,
            pb.SupervisorStatus(
                processes=[
                    pb.ProcessStatus(
                        name=n, pid=4099 + i, restarts=restarts.get(n, 0), state="running"
                    )
                    for i, n in enumerate(names)
                ]
            ),
        )

    def publish_robot(self) -> None:
        state = RobotState(
            T_world_base=se2_to_se3(*self.pose),
            moving=True,
            stopped=self.stopped,
            robot_boot_id="boot",
            last_seq=self.seq,
            message=self.stop_reason,
            battery=self.battery,
        )
        self.bus.publish(ROBOT_STATE, state_to_proto(state))

    def publish_frame(self, color: NDArray[np.uint8] | None = None) -> pb.Frame:
        """Publish a keyframe from the robot's pose."""
        self.seq += 1
        if color is None:
            rows, columns = np.mgrid[0:480, 0:640]
            color = np.stack([rows // 2, columns // 3, (rows + columns) // 5], -1).astype(np.uint8)
        frame = frame_to_proto(
            Frame(
                id=FrameId("boot", 0, self.seq),
                stamp_ns=self.seq * 10**8,
                keyframe=True,
                color=color,
                depth_m=np.full((480, 640), 2.0, np.float32),
                camera=CAMERA,
                T_world_cam=se2_to_se3(*self.pose),
                T_world_base=se2_to_se3(*self.pose),
            )
        )
        self.bus.publish(KEYFRAME, frame)
        return frame

    def publish_observation(self, frame: pb.Frame) -> None:
        """Publish the detections in the frame: a mug at pixels (200, 150) to (280, 240)."""
        mask = pb.Mask(x=200, y=150, width=80, height=90, bits=bytes(900))
        self.bus.publish(
            OBSERVATION,
            pb.Observation(
                frame=frame,
                context_id="c1",
                detections=[pb.Detection(class_name="mug", score=0.83, mask=mask)],
            ),
        )

    def change_map(self) -> None:
        self.map_version += 1
        self.bus.publish(
            MAP2D_ACK,
            pb.Ack(service="map2d", part="occupancy", accepted=True, version=self.map_version),
        )

    def change_objects(self) -> None:
        self.bus.publish(OBJECTMAP_ACK, pb.Ack(service="objectmap", part="objects", accepted=True))

    def publish_plan(self) -> None:
        self.bus.publish(
            PLAN,
            pb.Plan(
                task_id="t1",
                path_m=[3.1, 2.2, 2.9, 2.5, 2.6, 2.4, 2.45, 2.0],
                goal=pb.Pose2(x_m=2.45, y_m=2.0, yaw_rad=-2.5),
                purpose="to a gaze point of mug 1",
            ),
        )

    def reset(self) -> None:
        """Clear the stop and set every task to queued."""
        self._latch(False, "")
        for task in self.tasks.values():
            task.state = "queued"

    def serve_settings(self, service: str, settings: dict) -> None:
        """Serve the settings of a service."""
        described = {
            name: value
            if isinstance(value, dict)
            else {"value": value, "default": value, "description": ""}
            for name, value in settings.items()
        }
        reply = pb.SettingsReply(json=json.dumps(described))
        self.bus.serve(settings_method(service), lambda _: reply)

    def _latch(self, stopped: bool, reason: str) -> pb.Empty:
        self.stopped, self.stop_reason = stopped, reason
        self.driving.stopped_why = reason or "stop-now" if stopped else ""
        if self.state_late_s == math.inf:
            return pb.Empty()
        if self.state_late_s:
            late = threading.Timer(self.state_late_s, self.publish_robot)
            late.daemon = True
            late.start()
        else:
            self.publish_robot()
        return pb.Empty()

    def _objects(self, _: pb.ObjectsRequest) -> pb.ObjectsReply:
        self.calls.append("objects")
        return pb.ObjectsReply(objects=self.found, version=9, gaussians=5120)

    def _found(self, id: int) -> pb.ObjectInstance:
        for found in self.found:
            if found.id == id:
                return found
        raise InvalidInput(f"no object has the id {id}")

    def _detail(self, request: pb.ObjectRequest) -> pb.ObjectDetail:
        found = self._found(request.object_id)
        scores = [found.score * share for share in (0.3, 0.5, 0.45, 0.8, 1.0)]
        return pb.ObjectDetail(
            object=found,
            box_center_m=found.center_m,
            box_size_m=found.size_m,
            points_m=[1.0, 2.0, 0.5, 1.1, 2.0, 0.5],
            history=[
                pb.Moment(stamp_ns=i * 10**9, views=i + 1, score=score, class_score=score + 0.05)
                for i, score in enumerate(scores)
            ],
        )

    def _export(self, request: pb.ExportRequest) -> pb.ExportReply:
        if request.object_id:
            self._found(request.object_id)
        return pb.ExportReply(data=b"ply\n", gaussians=7)

    def _render(self, request: pb.RenderRequest) -> pb.RenderReply:
        self.rendered = request
        side = request.camera.width
        picture = np.full((side, side, 3), 90, np.uint8)
        cv2.circle(picture, (side // 2, side // 2), side // 4, (40, 60, 200), -1)
        _, png = cv2.imencode(".png", picture)
        return pb.RenderReply(png=png.tobytes())

    def _save_map2d(self, request: pb.SaveMap2DRequest) -> pb.SaveMap2DReply:
        names = ("map.pgm", "map.yaml") if request.format == "ros" else ("map2d.map",)
        return pb.SaveMap2DReply(
            files=[pb.Map2DFile(name=name, data=self.kept["map2d"]) for name in names]
        )

    def _load_map2d(self, request: pb.LoadMap2DRequest) -> pb.LoadMap2DReply:
        if self.refuses_maps is not None:
            raise self.refuses_maps
        self.kept["map2d"] = request.files[0].data
        return pb.LoadMap2DReply(version=50, known_m2=40.0, occupied_m2=8.0, views=3)

    def _load_objects(self, request: pb.ObjectMapFile) -> pb.ObjectMapLoaded:
        self.kept["objects"] = request.data
        return pb.ObjectMapLoaded(gaussians=5120, objects=len(self.found))

    def _reset(self, part: str) -> pb.Empty:
        if part == "map2d" and self.refuses_maps is not None:
            raise self.refuses_maps
        self.kept[part] = b""
        return pb.Empty()

    def _recall(self, request: pb.RecallRequest) -> pb.RecallReply:
        if self.recalls is not None:
            raise self.recalls
        scores = [0.82, 0.64, 0.31][: request.most_places]
        return pb.RecallReply(views=7, version=self.map_version, places=[
            pb.SeenPlace(
                id=pb.FrameId(robot_boot_id="boot", seq=k), stamp_ns=k * 10**9, score=score,
                camera=pb.Pose2(x_m=1.0 + k, y_m=2.0, yaw_rad=0.5), x_m=1.6 + k, y_m=1.5,
                jpeg=picture_jpeg(40 * k),
            )
            for k, score in enumerate(scores)
        ])  # fmt: skip

    def _snapshot(self, request: pb.SnapshotRequest) -> pb.MapSnapshot:
        self.calls.append("snapshot")
        if request.if_newer and request.if_newer == self.map_version:
            return pb.MapSnapshot(version=self.map_version, unchanged=True)
        return snapshot(self.map_version, self.pose)

    def _picture(self, request: pb.PictureRequest) -> pb.PictureReply:
        self.calls.append("picture")
        if request.layer not in ("occupancy", "pick", "place"):
            raise InvalidInput(f"no layer {request.layer!r}; there are occupancy, pick, place")
        side = request.size_px
        _, png = cv2.imencode(".png", np.full((side, side, 3), 200, np.uint8))
        return pb.PictureReply(png=png.tobytes(), version=self.map_version)
