"""Bus observer that collects the content of video frames, one per keyframe."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus, Registration
from helios_core.codec import (
    context_from_proto,
    object_from_proto,
    observation_from_proto,
    state_from_proto,
)
from helios_core.geometry import wrap_angle, yaw_of
from helios_core.map_snapshot import decode_snapshot
from helios_core.topics import (
    CONTEXT,
    DECISION,
    OBJECTS,
    OBSERVATION,
    PLAN,
    ROBOT_STATE,
    SNAPSHOT,
    TASK,
)
from helios_core.types import RobotState

from helios_eval.video.frame_content import Pose2, Scene

CALL_S = 60.0
GLIDE_M = 0.35  # a longer move gets frames in between
GLIDE_RAD = math.radians(35)
MOST_GLIDES = 4
MOST_STORY, MOST_DECISIONS = 20, 5


class Watcher:
    """Observer of the newest message of every topic.

    For a bus in lockstep: when the robot's state arrives, every map holds the last keyframe.
    """

    def __init__(self, bus: Bus, title: str, on_scene: Callable[[Scene], None]) -> None:
        """on_scene: called on the thread that publishes the robot's state."""
        self._bus, self._on_scene = bus, on_scene
        self._lock = threading.Lock()
        self._scene = Scene(title=title)
        self._seq = 0  # number of the keyframe shown last
        self._kept: list[Registration] = [
            bus.subscribe(CONTEXT, self._on_context),
            bus.subscribe(TASK, self._on_task),
            bus.subscribe(DECISION, self._on_decision),
            bus.subscribe(PLAN, self._on_plan),
            bus.subscribe(OBSERVATION, self._on_observation),
            bus.subscribe(ROBOT_STATE, self._on_state),
        ]

    def close(self) -> None:
        for registration in self._kept:
            registration.close()

    def now(self) -> Scene:
        """Scene with the current objects and map of the services. Raises their errors."""
        reply = self._bus.call(OBJECTS, pb.ObjectsRequest(), CALL_S)
        objects = tuple(object_from_proto(o) for o in reply.objects)
        snapshot = self._bus.call(SNAPSHOT, pb.SnapshotRequest(layers=True), CALL_S)
        view = decode_snapshot(snapshot) if snapshot.cell_m > 0 else None
        with self._lock:
            self._scene = replace(self._scene, objects=objects, map=view)
            return self._scene

    # --- handlers ---------------------------------------------------------------------------------
    def _on_context(self, message: pb.SearchContext) -> None:
        context = context_from_proto(message)
        self._change(roles={c.name: str(c.role) for c in context.classes})

    def _on_task(self, task: pb.Task) -> None:
        with self._lock:
            story = self._scene.story
            if task.message and (not story or story[-1][1] != task.message):
                story = (*story, (task.steps, task.message))[-MOST_STORY:]
            self._scene = replace(self._scene, task=task, story=story)

    def _on_decision(self, decision: pb.Decision) -> None:
        with self._lock:
            decisions = (*self._scene.decisions, decision)[-MOST_DECISIONS:]
            self._scene = replace(self._scene, decisions=decisions)

    def _on_plan(self, plan: pb.Plan) -> None:
        self._change(path_m=np.array(plan.path_m, np.float64).reshape(-1, 2))

    def _on_observation(self, message: pb.Observation) -> None:
        seen = observation_from_proto(message, with_others=False)
        self._change(color=seen.frame.color, detections=seen.detections)

    def _on_state(self, message: pb.RobotState) -> None:
        state = state_from_proto(message)
        self._change(robot=_pose(state), held=state.held)
        if state.last_seq != self._seq:
            self._seq = state.last_seq
            self._on_scene(self.now())

    def _change(self, **changes: Any) -> None:
        with self._lock:
            self._scene = replace(self._scene, **changes)


def glides(before: Scene | None, after: Scene) -> list[Scene]:
    """Scenes between two moments of a longer move, in which only the robot's pose changes."""
    if before is None or before.robot is None or after.robot is None:
        return []
    (x0, y0, yaw0), (x1, y1, yaw1) = before.robot, after.robot
    turn = wrap_angle(yaw1 - yaw0)
    parts = max(math.hypot(x1 - x0, y1 - y0) / GLIDE_M, abs(turn) / GLIDE_RAD)
    count = min(MOST_GLIDES, max(1, math.ceil(parts - 1e-6)))
    shares = [k / count for k in range(1, count)]
    return [
        replace(before, robot=(x0 + s * (x1 - x0), y0 + s * (y1 - y0), yaw0 + s * turn))
        for s in shares
    ]


def _pose(state: RobotState) -> Pose2:
    T = state.T_world_base
    return float(T[0, 3]), float(T[1, 3]), yaw_of(T)
