"""Made-up services on a MemoryBus: a small home, a robot in it, one task. Deterministic."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Sequence

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.bus import Registration
from helios_core.codec import frame_to_proto, state_to_proto
from helios_core.errors import Conflict, HeliosError, InvalidInput
from helios_core.geometry import Pinhole, se2_to_se3
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    CANCEL,
    CLEAR_STOP,
    DECISION,
    DECISIONS,
    EXPORT_OBJECTS,
    GAUSSIANS,
    GET_TASK,
    KEYFRAME,
    LIST_TASKS,
    LOAD_MAP2D,
    LOAD_OBJECTS,
    MAP2D_ACK,
    OBJECT_DETAIL,
    OBJECTMAP_ACK,
    OBJECTS,
    OBSERVATION,
    PAUSE,
    PICTURE,
    PLAN,
    RECALL,
    RENDER_OBJECTS,
    RESUME,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SAVE_MAP2D,
    SAVE_OBJECTS,
    SNAPSHOT,
    STOP,
    SUBMIT,
    SUPERVISOR,
    TASK,
    VOCABULARY,
    settings_method,
    status_topic,
)
from helios_core.types import Frame, FrameId, RobotState
from numpy.typing import NDArray

SERVICES = ("world", "bridge", "detector", "objectmap", "map2d", "planner")
CAMERA = Pinhole(fx=520.0, fy=520.0, cx=319.5, cy=239.5, width=640, height=480)
CELL_M = 0.05
WALLS_M = (  # x0, y0, x1, y1
    (0, 0, 9, 0.1), (0, 6.9, 9, 7), (0, 0, 0.1, 7), (8.9, 0, 9, 7),
    (4.4, 0, 4.5, 2.4), (4.4, 3.4, 4.5, 7), (0, 3.8, 1.6, 3.9), (2.6, 3.8, 4.5, 3.9),
    (4.5, 3.8, 6.2, 3.9), (7.2, 3.8, 9, 3.9),
)  # fmt: skip
FURNITURE_M = (
    (1.2, 1.2, 2.2, 1.8), (0.1, 0.8, 0.9, 2.4), (6.0, 0.1, 8.9, 0.7), (6.2, 1.9, 7.6, 2.9),
    (0.4, 5.0, 2.4, 6.9), (7.6, 5.2, 8.9, 6.0),
)  # fmt: skip


class Backend:
    """`start` brings everything up; tests then change single things."""

    def __init__(self, hub: MemoryHub, robot: str = "robot") -> None:
        self.hub = hub
        self.bus = MemoryBus(hub, robot)
        self.calls: list[str] = []
        self._alive: dict[str, Registration] = {}
        self.tasks: dict[str, pb.Task] = {}
        self.decided: list[pb.Decision] = []
        self.found = [
            thing(1, "mug", (1.55, 1.45, 0.49), (0.11, 0.09, 0.10), 0.71, 7),
            thing(2, "coffee table", (1.7, 1.5, 0.22), (1.0, 0.6, 0.44), 0.82, 12),
            thing(3, "kitchen counter", (7.4, 0.4, 0.46), (2.9, 0.6, 0.92), 0.58, 5),
            thing(4, "mug", (6.6, 2.3, 0.80), (0.10, 0.10, 0.11), 0.31, 2),
        ]
        self.pose = (3.1, 2.2, 2.5)
        self.stopped, self.stop_reason = False, ""
        self.map_version = 41
        self.rendered: pb.RenderRequest | None = None
        self.kept = {"map2d": b"walls", "objects": b"things"}  # what a save gives
        self.refuses_maps: HeliosError | None = None  # what map2d says to a load
        self.recalls: HeliosError | None = None  # what it says to a question to past views
        self.seq = 0

    def start(self) -> None:
        serve = self.bus.serve
        serve(SUBMIT, self._submit)
        serve(GET_TASK, self._get)
        serve(LIST_TASKS, lambda _: pb.TaskList(tasks=self.tasks.values()))
        serve(CANCEL, self._cancel)
        serve(PAUSE, lambda request: self._go(request, "running", "paused"))
        serve(RESUME, lambda request: self._go(request, "paused", "running"))
        serve(DECISIONS, self._decisions)
        serve(SNAPSHOT, self._snapshot)
        serve(PICTURE, self._picture)
        serve(OBJECTS, self._objects)
        serve(OBJECT_DETAIL, self._detail)
        serve(EXPORT_OBJECTS, self._export)
        serve(GAUSSIANS, lambda _: gaussians(self.found))
        serve(RENDER_OBJECTS, self._render)
        serve(SAVE_MAP2D, lambda _: pb.SaveMap2DReply(
            files=[pb.Map2DFile(name="map2d.map", data=self.kept["map2d"])]))  # fmt: skip
        serve(SAVE_OBJECTS, lambda _: pb.ObjectMapFile(data=self.kept["objects"]))
        serve(LOAD_MAP2D, self._load_map2d)
        serve(LOAD_OBJECTS, self._load_objects)
        serve(RECALL, self._recall)
        serve(STOP, lambda request: self._latch(True, request.reason))
        serve(CLEAR_STOP, lambda _: self._latch(False, ""))
        serve(VOCABULARY, lambda _: pb.VocabularyReply(
            open=False, names=["bowl", "coffee table", "kitchen counter", "mug", "sofa"],
            detector="simulated", scorer="words"))  # fmt: skip
        for pid, name in enumerate(SERVICES, start=4100):
            self.alive(name, pid)
        self.supervise()
        self.bus.publish(ROBOT_DESCRIPTION, description())
        self.publish_robot()

    def alive(self, name: str, pid: int, state: str = "ready", reason: str = "") -> None:
        self._alive[name] = self.bus.announce(name, f"{pid}-test")
        self.report(name, pid, state, reason)

    def die(self, name: str) -> None:
        """As if the process were gone."""
        self._alive.pop(name).close()

    def report(self, name: str, pid: int, state: str, reason: str = "") -> None:
        status = pb.ServiceStatus(
            service=name, instance=f"{pid}-test", state=state, reason=reason, pid=pid,
            uptime_s=61.0, metrics={"update_ms_median": 2.5},
        )  # fmt: skip
        self.bus.publish(status_topic(name), status)

    def supervise(self, **restarts: int) -> None:
        names = ("router", *SERVICES, "gateway")
        self.bus.publish(SUPERVISOR, pb.SupervisorStatus(processes=[
            pb.ProcessStatus(name=n, pid=4099 + i, restarts=restarts.get(n, 0), state="running")
            for i, n in enumerate(names)
        ]))  # fmt: skip

    def publish_robot(self) -> None:
        state = RobotState(
            T_world_base=se2_to_se3(*self.pose), moving=True, stopped=self.stopped,
            robot_boot_id="boot", last_seq=self.seq,
        )  # fmt: skip
        self.bus.publish(ROBOT_STATE, state_to_proto(state))

    def publish_frame(self, color: NDArray[np.uint8] | None = None) -> pb.Frame:
        """A keyframe from where the robot is."""
        self.seq += 1
        if color is None:
            rows, columns = np.mgrid[0:480, 0:640]
            color = np.stack([rows // 2, columns // 3, (rows + columns) // 5], -1).astype(np.uint8)
        frame = frame_to_proto(Frame(
            id=FrameId("boot", 0, self.seq), stamp_ns=self.seq * 10**8, keyframe=True,
            color=color, depth_m=np.full((480, 640), 2.0, np.float32), camera=CAMERA,
            T_world_cam=se2_to_se3(*self.pose), T_world_base=se2_to_se3(*self.pose),
        ))  # fmt: skip
        self.bus.publish(KEYFRAME, frame)
        return frame

    def publish_observation(self, frame: pb.Frame) -> None:
        """What the detector makes of the frame: a mug at pixels (200, 150) to (280, 240)."""
        mask = pb.Mask(x=200, y=150, width=80, height=90, bits=bytes(900))
        self.bus.publish(OBSERVATION, pb.Observation(
            frame=frame, context_id="c1",
            detections=[pb.Detection(class_name="mug", score=0.83, mask=mask)],
        ))  # fmt: skip

    def change_map(self) -> None:
        self.map_version += 1
        self.bus.publish(MAP2D_ACK, pb.Ack(service="map2d", part="occupancy", accepted=True,
                                           version=self.map_version))  # fmt: skip

    def change_objects(self) -> None:
        self.bus.publish(OBJECTMAP_ACK, pb.Ack(service="objectmap", part="objects", accepted=True))

    def publish_plan(self) -> None:
        self.bus.publish(PLAN, pb.Plan(
            task_id="t1", path_m=[3.1, 2.2, 2.9, 2.5, 2.6, 2.4, 2.45, 2.0],
            goal=pb.Pose2(x_m=2.45, y_m=2.0, yaw_rad=-2.5), purpose="to a gaze point of mug 1",
        ))  # fmt: skip

    def decide(self) -> None:
        made = decision(len(self.decided))
        self.decided.append(made)
        self.bus.publish(DECISION, made)

    def reset(self, state: str = "queued") -> None:
        """No stop is latched, and every task is in this state."""
        self._latch(False, "")
        for task in self.tasks.values():
            task.state = state

    def serve_settings(self, service: str, settings: dict) -> None:
        """A service that tells its settings."""
        described = {
            name: value
            if isinstance(value, dict)
            else {"value": value, "default": value, "description": ""}
            for name, value in settings.items()
        }
        reply = pb.SettingsReply(json=json.dumps(described))
        self.bus.serve(settings_method(service), lambda _: reply)

    def change_task(self, id: str, state: str, **changes: object) -> None:
        """The task goes on, and everybody is told."""
        task = self.tasks[id]
        task.state = state
        for name, value in changes.items():
            setattr(task, name, value)
        self.bus.publish(TASK, task)

    def submit(self, instruction: str) -> pb.Task:
        """As if it had come from elsewhere."""
        return self._submit(pb.SubmitRequest(instruction=instruction))

    def _submit(self, request: pb.SubmitRequest) -> pb.Task:
        self.calls.append("submit")
        words = request.instruction.lower().split()
        if "move" not in words:
            raise InvalidInput(
                f"{request.instruction[:60]!r} names no action; understood: nothing; say for "
                "example: move the mug from the coffee table to the kitchen counter"
            )
        task = pb.Task(
            id=f"t{len(self.tasks) + 1}", instruction=request.instruction, state="queued",
            kind="move", object="mug", start="coffee table", goal="kitchen counter",
            created_s=1.8e9 + len(self.tasks), max_steps=request.max_steps or 500,
            agent=request.agent or "helios", priority=request.priority, settings=request.settings,
        )  # fmt: skip
        self.tasks[task.id] = task
        self.bus.publish(TASK, task)
        return task

    def _get(self, request: pb.TaskRequest) -> pb.Task:
        if request.id not in self.tasks:
            raise InvalidInput(f"there is no task {request.id!r}; list them with GET /v1/tasks")
        return self.tasks[request.id]

    def _cancel(self, request: pb.TaskRequest) -> pb.Task:
        task = self._get(request)
        if task.state in ("succeeded", "failed", "cancelled"):
            raise Conflict(f"task {task.id} has ended ({task.state})")
        task.state = "cancelled"
        self.bus.publish(TASK, task)
        return task

    def _go(self, request: pb.TaskRequest, before: str, after: str) -> pb.Task:
        task = self._get(request)
        if task.state != before:
            raise Conflict(f"task {task.id} is {task.state}, not {before}")
        self.change_task(task.id, after)
        return task

    def _decisions(self, request: pb.TaskRequest) -> pb.DecisionList:
        self._get(request)
        return pb.DecisionList(decisions=self.decided)

    def _latch(self, stopped: bool, reason: str) -> pb.Empty:
        self.stopped, self.stop_reason = stopped, reason
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
            object=found, box_center_m=found.center_m, box_size_m=found.size_m,
            points_m=[1.0, 2.0, 0.5, 1.1, 2.0, 0.5],
            history=[
                pb.Moment(stamp_ns=i * 10**9, views=i + 1, score=score, class_score=score + 0.05)
                for i, score in enumerate(scores)
            ],
        )  # fmt: skip

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

    def _load_map2d(self, request: pb.LoadMap2DRequest) -> pb.LoadMap2DReply:
        if self.refuses_maps is not None:
            raise self.refuses_maps
        self.kept["map2d"] = request.files[0].data
        return pb.LoadMap2DReply(version=50, known_m2=40.0, occupied_m2=8.0, views=3)

    def _load_objects(self, request: pb.ObjectMapFile) -> pb.ObjectMapLoaded:
        self.kept["objects"] = request.data
        return pb.ObjectMapLoaded(gaussians=5120, objects=len(self.found))

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


def gaussians(found: Sequence[pb.ObjectInstance]) -> pb.GaussiansReply:
    """The boxes of the objects, filled evenly."""
    rng = np.random.default_rng(0)
    names = ["other", *sorted({one.class_name for one in found})]
    means, instances, concentrations = [], [], []
    for one in found:
        center, size = ([v.x, v.y, v.z] for v in (one.center_m, one.size_m))
        means.append(rng.uniform(-0.5, 0.5, (one.gaussians, 3)) * size + center)
        instances += [one.id] * one.gaussians
        row = np.ones(len(names))
        row[names.index(one.class_name)] += 0.5 * one.views
        concentrations.append(np.tile(row, (one.gaussians, 1)))
    n = len(instances)
    shades = rng.integers(60, 220, (n, 3))
    return pb.GaussiansReply(
        count=n, means_m=np.concatenate(means).astype("<f4").tobytes(),
        scales_m=np.full(n, 0.02, "<f4").tobytes(), colors=shades.astype(np.uint8).tobytes(),
        instances=np.array(instances, "<u4").tobytes(), class_names=names,
        concentration=np.concatenate(concentrations).astype("<f4").tobytes(),
        opacities=np.full(n, 0.9, "<f4").tobytes(),
    )  # fmt: skip


def picture_jpeg(tone: int) -> bytes:
    """A small picture, as map2d keeps of a view."""
    _, jpeg = cv2.imencode(".jpg", np.full((180, 320, 3), (90, 60 + tone, 150), np.uint8))
    return jpeg.tobytes()


def description() -> pb.RobotDescription:
    return pb.RobotDescription(
        name="stretch", footprint_radius_m=0.18, height_m=1.41, camera_height_m=1.31,
        camera=pb.Pinhole(fx=520, fy=520, cx=319.5, cy=239.5, width=640, height=480),
        reach_m=0.8, max_depth_m=5.0, can_move=True, can_pick=True, can_place=True, simulated=True,
    )  # fmt: skip


def thing(
    id: int,
    name: str,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    score: float,
    views: int,
) -> pb.ObjectInstance:
    """An instance of the object map with a rectangle for an outline."""
    (x, y, _), (w, d, _) = center, size
    outline = [x - w / 2, y - d / 2, x + w / 2, y - d / 2, x + w / 2, y + d / 2, x - w / 2,
               y + d / 2]  # fmt: skip
    return pb.ObjectInstance(
        id=id, class_name=name, center_m=pb.Vector3(x=center[0], y=center[1], z=center[2]),
        size_m=pb.Vector3(x=size[0], y=size[1], z=size[2]), score=score,
        class_score=min(score + 0.08, 1.0), uncertainty=0.08, views=views, gaussians=40 * views,
        probabilities={name: min(score + 0.08, 1.0), "other": max(0.92 - score, 0.0)},
        top_m=center[2] + size[2] / 2, outline_m=outline, detection_rate=0.8,
    )  # fmt: skip


def decision(index: int) -> pb.Decision:
    """A global search over two tables and two frontiers."""
    rows = [
        ("receptacle", "coffee table 2", (1.7, 1.5), 0.68, 0.74, 1.6, True),
        ("frontier", "frontier 12", (4.5, 2.9), 0.41, 0.42, 1.5, False),
        ("frontier", "frontier 15", (2.1, 3.9), 0.22, 0.23, 2.0, False),
        ("receptacle", "dining table 5", (6.9, 2.4), 0.31, 0.19, 3.8, False),
    ]
    candidates = [
        pb.Candidate(
            kind=kind, name=name, position_m=pb.Vector3(x=x, y=y), chosen=chosen,
            terms={"class_score": score, "information_gain": score * 0.4, "distance_m": far,
                   "total": total},
        )
        for kind, name, (x, y), score, total, far, chosen in rows
    ]  # fmt: skip
    return pb.Decision(
        task_id="t1", index=index, phase="find_object", rule="global_search (eq. 10)",
        candidates=candidates, made_s=1.8e9 + index, context_id="c1",
        why="coffee table 2 is likely one and may hold the mug: total 0.74 against 0.42 of "
        "frontier 12",
        settings={"alpha_cs": 1.0, "alpha_d": 0.001},
    )  # fmt: skip


def snapshot(version: int, pose: tuple[float, float, float]) -> pb.MapSnapshot:
    """The home as it is known when three of its four rooms have been seen."""
    rows, columns = round(7 / CELL_M), round(9 / CELL_M)
    occupancy = np.zeros((rows, columns), np.int8)
    for x0, y0, x1, y1 in (*WALLS_M, *FURNITURE_M):
        box = [round(v / CELL_M) for v in (y0, y1, x0, x1)]
        occupancy[box[0] : box[1], box[2] : box[3]] = 100
    y, x = (np.mgrid[0:rows, 0:columns] + 0.5) * CELL_M
    seen = (x < 4.5) | ((y < 3.8) & (x < 8.2))
    seen &= ~((x < 4.4) & (y > 3.9) & (x + y > 7.8))
    occupancy[~seen] = -1
    explored = (seen & (x < 6.4)).astype(np.uint8)
    pick = np.exp(-((x - 1.7) ** 2 + (y - 1.5) ** 2) / 3) * 0.42 * seen
    place = np.exp(-((x - 7.2) ** 2 + (y - 0.7) ** 2) / 4) * 0.35 * seen
    angle = np.linspace(0, 1.6 * math.pi, 60)
    walked = np.column_stack([2.9 + 0.9 * np.cos(angle) + angle * 0.02, 2.6 + 0.8 * np.sin(angle)])
    walked = np.vstack([walked, pose[:2]]).astype(np.float32)
    return pb.MapSnapshot(
        id=pb.FrameId(robot_boot_id="boot", seq=version), version=version, cell_m=CELL_M,
        origin_x_m=0.0, origin_y_m=0.0, width=columns, height=rows,
        occupancy=zlib.compress(occupancy.tobytes()), explored=zlib.compress(explored.tobytes()),
        values={"pick": zlib.compress(pick.astype("<f2").tobytes()),
                "place": zlib.compress(place.astype("<f2").tobytes())},
        frontiers=[
            pb.Frontier(id=12, x_m=6.4, y_m=2.0, size_m=1.3, reachable=True,
                        values={"pick": 0.21, "place": 0.33}),
            pb.Frontier(id=15, x_m=2.1, y_m=5.6, size_m=0.9, reachable=True,
                        values={"pick": 0.12, "place": 0.05}),
            pb.Frontier(id=19, x_m=6.7, y_m=3.8, size_m=0.7, reachable=False,
                        values={"pick": 0.08, "place": 0.11}),
        ],
        robot=pb.Pose2(x_m=pose[0], y_m=pose[1], yaw_rad=pose[2]),
        trajectory_m=walked.ravel().tolist(), context_id="c1",
        explored_m2=float(explored.sum() * CELL_M**2), occupied_m2=11.2,
    )  # fmt: skip
