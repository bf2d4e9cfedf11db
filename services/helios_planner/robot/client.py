"""The robot and its maps over the bus: implements `RobotInterface` for a real task."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from helios_core import proto as pb
from helios_core import tracing
from helios_core.bus import Bus
from helios_core.codec import (
    description_from_proto,
    frame_id_from_proto,
    object_from_proto,
    pinhole_to_proto,
    result_from_proto,
    transform_to_proto,
    vector_to_proto,
)
from helios_core.errors import (
    Conflict,
    InvalidInput,
)
from helios_core.geometry import Matrix
from helios_core.heartbeat import HALTED, HeartbeatSender
from helios_core.keyframe_acks import FROM_DETECTIONS, KeyframeAcks, MapPart
from helios_core.map_snapshot import decode_snapshot
from helios_core.printable_text import counted
from helios_core.robot import Action, ActionResult, Observe, Turn
from helios_core.topics import (
    HELD_OBJECT,
    NAMES_AT,
    OBJECTS,
    PLANNER_HEARTBEAT,
    RETIRE,
    SNAPSHOT,
    WHAT_IF,
)
from helios_core.types import AlignedBox, FrameId, ObjectInstance, RobotState, WorldId
from helios_core.viewing.newest_map import newest_snapshot
from numpy.typing import NDArray

from helios_planner.decisions.held_object import HeldObject
from helios_planner.match_radii import SAME_INSTANCE_M
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.robot.detections import DETECTIONS, MessageBuffer, Sighting
from helios_planner.robot.detector_status import DetectorStatus
from helios_planner.robot.interface import Frontier, ProgressListener, RobotInterface, WhatIf
from helios_planner.robot.rpc import RETRY_S, ActionSender, RobotConnection, system_error
from helios_planner.robot.service_returns import ServiceReturns
from helios_planner.robot.step_spans import StepSpans
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed

log = logging.getLogger(__name__)

ACK_PATIENCE_S = 6.0  # then a new keyframe is taken: a service that restarted has lost it
MOST_REFUSALS = 5  # keyframes in a row that a map refuses before the task fails
# Actions that give map2d a first keyframe after a restart. The turn is needed while the robot shows
# what it holds: until it moves, the maps leave its images out.
NEW_MAP_ACTIONS = (Observe(), Turn(0.3))
MOST_OFF_MAP_M = 50.0  # the map holds the place of every keyframe, so a right pose is on it
ANSWERED_BY = {  # part of a keyframe's acknowledgements -> service to check when it is missing
    DETECTIONS: "detector",
    MapPart.OCCUPANCY: MapPart.OCCUPANCY.service,
} | {part: f"{part.service} (or the detector before it)" for part in FROM_DETECTIONS}
BY_DETECTOR = FROM_DETECTIONS | {DETECTIONS}  # not acknowledged while the detector does not respond


class TaskListener(ProgressListener, Protocol):
    """Progress listener that also receives events of the robot and the services."""

    def on_steps(self, steps: int) -> None: ...
    def on_keyframe(self, frame: FrameId) -> None: ...
    def on_paused(self, why: str) -> None: ...
    def on_resumed(self) -> None: ...
    def on_wait(self, what: str | None) -> None: ...


class RobotClient(RobotInterface):
    """Access of one task to the robot. Used from one thread; any thread may set `cancelled`."""

    def __init__(
        self,
        bus: Bus,
        line: RobotConnection,
        settings: Settings,
        description: pb.RobotDescription,
        acks: KeyframeAcks,
        task_id: str,
        context_id: str,
        max_steps: int,
        listener: TaskListener,
        parts: Sequence[str],
    ) -> None:
        """bus: for subscriptions; line: for requests; parts: of a keyframe that must be
        acknowledged before the next action (`ANSWERED_BY`)."""
        self._settings, self._acks, self._parts = settings, acks, parts
        self.description = description_from_proto(description)
        most_m = self.description.max_depth_m
        self._inbox = MessageBuffer(bus, acks, context_id, most_m) if DETECTIONS in parts else None
        self._detector, self._returns = DetectorStatus(bus), ServiceReturns(bus)
        self._line = line
        self._driver = ActionSender(
            line, settings, task_id, self._on_pause, HeartbeatSender(bus, PLANNER_HEARTBEAT)
        )
        self._context_id, self._max_steps = context_id, max_steps
        self.listener = self._listener = listener
        self.steps, self.collisions = 0, 0
        self._spans = StepSpans()
        self._frame: FrameId | None = None
        self._state: RobotState | None = None
        self._ground: GroundMap | None = None
        self._frontiers: tuple[Frontier, ...] = ()
        self._start: tuple[float, float] | None = None
        self._objects: dict[str, list[ObjectInstance]] = {}
        self._fresh = False  # True if the map holds the last action's keyframe

    def begin(self) -> None:
        """Get the lease, and look until every map uses this task's search context."""
        deadline = time.monotonic() + self._settings.ack_timeout_s + self._settings.away_s
        while True:
            _, answers, missing = self._do(Observe(), ACK_PATIENCE_S)
            foreign = self._not_taken_up(answers)
            if not missing and not foreign:
                self._line.waits_for("")
                self._detector.note_from_now()
                return
            whom, why = self._whom((*missing, *foreign))
            self._line.waits_for(f"{whom}: {why}" if why else f"{whom} to take up the search")
            if time.monotonic() > deadline:
                reasons = [answers[p].reason for p in foreign if answers[p].reason]
                reasons += [why] if why else []
                raise TaskFailed(
                    Cause.SYSTEM_ERROR,
                    f"{whom} did not take up the search"
                    + (f": {'; '.join(reasons)}" if reasons else "; see `helios status`"),
                )
            self._line.rest(RETRY_S)

    @property
    def world(self) -> WorldId:
        """World of the robot's poses."""
        now = self._now()
        return WorldId.of(now.robot_boot_id, now.world_epoch, now.origin_id)

    def end(self) -> None:
        """Close the subscriptions, and release the robot."""
        self._spans.end()
        self._driver.release()
        self._detector.close()
        self._returns.close()
        if self._inbox is not None:
            self._inbox.close()

    # --- acting --------------------------------------------------------------------------------
    def act(self, action: Action) -> ActionResult:
        """See `RobotInterface`. A keyframe that a map lost, for example by a restart, or refused
        is taken again."""
        result, answers, missing = self._do(action, ACK_PATIENCE_S)
        cut_short = self.cut_short
        deadline = time.monotonic() + self._settings.ack_timeout_s
        refusals = 0
        while True:
            refused = self._not_taken_up(answers)
            if missing:
                self._wait_for_answer(missing, deadline)
            elif refused:
                refusals += 1
                self._wait_after_refusal(answers[refused[0]], refusals)
            else:
                break
            _, answers, missing = self._do(Observe(), ACK_PATIENCE_S)
        self.cut_short = cut_short  # of the action, not of a repeated keyframe
        self._line.waits_for("")
        return result

    def _wait_for_answer(self, missing: Sequence[str], deadline: float) -> None:
        """Report the parts that did not answer the newest keyframe. Raises TaskFailed after the
        deadline."""
        whom, why = self._whom(missing)
        what = f"to answer keyframe {self._frame}"
        self._line.waits_for(f"{whom}: {why}" if why else f"{whom} {what}")
        if time.monotonic() > deadline:
            waited = ACK_PATIENCE_S + self._settings.ack_timeout_s
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"{whom} did not answer keyframe {self._frame} within {waited:.0f} s"
                + (f": {why}" if why else "; see `helios status`"),
            )
        log.warning("keyframe %s lacks %s; looking again", self._frame, ", ".join(missing))

    def _wait_after_refusal(self, ack: pb.Ack, refusals: int) -> None:
        """Report a refusal of the newest keyframe, and wait a moment. refusals: keyframes that were
        refused so far. Raises TaskFailed at the limit."""
        whom = ack.service or ANSWERED_BY[ack.part]
        why = ack.reason or f"it took the keyframe up for another search, {ack.context_id!r:.80}"
        log.warning("%s refused keyframe %s (%s); looking again", whom, self._frame, why)
        if refusals >= MOST_REFUSALS:
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"{whom} did not take up keyframe {self._frame} and the {refusals - 1} before it: "
                f"{why}; see `helios status`",
            )
        self._line.waits_for(f"{whom} to take up a keyframe: {why}")
        self._line.rest(RETRY_S)

    def _not_taken_up(self, answers: Mapping[str, pb.Ack]) -> list[str]:
        """Parts that refused a keyframe, or took it up for another search. No refusal is harmless:
        the maps accept a keyframe that they already hold."""
        return [
            part
            for part, ack in answers.items()
            if not ack.accepted
            or (part != MapPart.OCCUPANCY and ack.context_id != self._context_id)
        ]

    def _do(
        self, action: Action, ack_s: float
    ) -> tuple[ActionResult, dict[str, pb.Ack], list[str]]:
        if self.steps >= self._max_steps:
            used = "is" if self._max_steps == 1 else "are"
            said = (
                f"the task's {counted(self._max_steps, 'step')} {used} used up"
                f"{self.detector_trouble()}"
            )
            raise TaskFailed(Cause.STEP_BUDGET, said)
        with self._spans.action(action, self._context_id):
            return self._carry_out(action, ack_s)

    def _carry_out(
        self, action: Action, ack_s: float
    ) -> tuple[ActionResult, dict[str, pb.Ack], list[str]]:
        began_s = time.monotonic()
        reply = self._driver.do(action)
        self.steps += 1
        self._listener.on_steps(self.steps)
        self._fresh = False
        self._objects.clear()
        self._state = None
        result = result_from_proto(reply)
        self.on_result(action, result)
        self.collisions += int(result.collided)
        self.cut_short = not result.succeeded and (
            self._driver.wait_while_stopped() or HALTED in result.reason
        )
        if not reply.HasField("keyframe"):
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"the robot sent no image after {type(action).__name__.lower()}; see why its "
                "driver's capture ended in `helios logs bridge`",
            )
        frame = frame_id_from_proto(reply.keyframe)
        if self._frame is not None and frame.epoch != self._frame.epoch:
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                "the robot restarted or its localisation jumped; submit the task again",
            )
        self._frame = frame
        tracing.present_span().set("helios.keyframe", str(frame))
        self._listener.on_keyframe(frame)
        missing = self._acks.wait(
            frame, self._parts, ack_s, self._line.cancelled, lambda: self._returns.since(began_s)
        )
        self._line.check()
        if missing:
            tracing.present_span().set("missing", ", ".join(missing))
        answers = {p: a for p, a in self._acks.answers(frame).items() if p in self._parts}
        return result, answers, missing

    def _whom(self, parts: Sequence[str]) -> tuple[str, str]:
        """Services that have not acknowledged these parts, and the detector's reason if
        it gave one."""
        trouble = self._detector.trouble
        blamed = [p for p in parts if trouble and p in BY_DETECTOR]
        names = [ANSWERED_BY[p] for p in parts if p not in blamed]
        return _listed([*names, *(["the detector"] if blamed else [])]), trouble if blamed else ""

    # --- knowing -------------------------------------------------------------------------------
    def detector_trouble(self) -> str:
        noted = self._detector.noted
        return f"; meanwhile the detector was degraded: {noted}" if noted else ""

    def budget_used(self) -> float:
        return min(self.steps / max(self._max_steps, 1), 1.0)

    def pose(self) -> Pose2:
        return Pose2.of(self._now().T_world_base)

    def tilt_rad(self) -> float:
        return self._now().tilt_rad

    def held(self) -> str:
        return self._now().held

    def ground(self) -> GroundMap:
        """See `RobotInterface`. Raises TaskFailed if the robot is so far off the map that one with
        room for it would be too large."""
        self._refresh()
        assert self._ground is not None
        off_m = self._ground.distance_m(self.pose().xy)
        if not off_m <= MOST_OFF_MAP_M:
            x_m, y_m = self.pose().xy
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"the robot's localisation is {off_m:.0f} m off the map, at ({x_m:.0f}, {y_m:.0f}) "
                f"m; wanted at most {MOST_OFF_MAP_M:.0f} m: see what its pose comes from, and "
                "submit the task again once it is right",
            )
        return self._ground

    def frontiers(self) -> Sequence[Frontier]:
        self._refresh()
        return self._frontiers

    def start(self) -> tuple[float, float] | None:
        self._refresh()
        return self._start

    def objects(self, class_name: str) -> Sequence[ObjectInstance]:
        if class_name not in self._objects:
            reply = self._line.call(OBJECTS, pb.ObjectsRequest(class_names=[class_name]))
            self._objects[class_name] = [object_from_proto(o) for o in reply.objects]
        return self._objects[class_name]

    def sightings(self) -> Sequence[Sighting]:
        assert self._inbox is not None, "this task does not listen to the detector"
        return self._inbox.sightings()

    def what_if(
        self,
        id: int,
        class_name: str,
        T_world_cam: Sequence[Matrix],
        joint: bool,
        other_share: float | None = None,
    ) -> WhatIf:
        request = pb.WhatIfRequest(
            object_id=id,
            class_name=class_name,
            T_world_cam=[transform_to_proto(T) for T in T_world_cam],
            camera=pinhole_to_proto(self.description.camera),
            joint=joint,
            other_share=other_share,
        )
        try:
            reply = self._line.call(WHAT_IF, request, refusals=(InvalidInput, Conflict))
        except (InvalidInput, Conflict) as error:
            log.warning("no expectation for %s %d: %s", class_name, id, error.message)
            return WhatIf((), ())
        return WhatIf(
            tuple(reply.score), tuple(reply.information_gain), tuple(reply.pixels), reply.area_m2
        )

    def held_object(self, class_name: str) -> HeldObject:
        reply = self._line.call(HELD_OBJECT, pb.HeldObjectRequest(class_name=class_name))
        names = tuple((n.name, n.share) for n in reply.names)
        rated = reply.HasField("image_text_nats")
        nats = reply.image_text_nats if rated else None
        return HeldObject(reply.probability, reply.sides, names, nats)

    def probability_at(self, class_name: str, boxes: Sequence[AlignedBox]) -> Sequence[float]:
        request = pb.NamesAtRequest(
            class_name=class_name,
            center_m=[vector_to_proto(center) for center, _ in boxes],
            size_m=[vector_to_proto(size) for _, size in boxes],
        )
        return tuple(self._line.call(NAMES_AT, request).probability)

    def retire(self, id: int, point_m: NDArray[np.float64], reason: str) -> None:
        request = pb.RetireRequest(
            object_id=id, point_m=vector_to_proto(point_m), radius_m=SAME_INSTANCE_M, reason=reason
        )
        try:
            self._line.call(RETIRE, request, refusals=(InvalidInput, Conflict))
        except (InvalidInput, Conflict) as error:
            log.warning("object %d was not retired: %s", id, error.message)
        self._objects.clear()

    def _now(self) -> RobotState:
        if self._state is None:
            self._state = self._driver.state()
        return self._state

    def _refresh(self) -> None:
        if self._fresh:
            return
        map_id, known = self._ground.identity if self._ground is not None else ("", 0)
        reply = self._snapshot(known, map_id)
        for action in NEW_MAP_ACTIONS:
            if reply.unchanged or reply.width * reply.height:
                break
            log.warning("map2d has no map yet: a new keyframe gives it one")
            self.act(action)
            reply = self._snapshot()
        if not reply.unchanged or self._ground is None:
            try:
                view = decode_snapshot(reply)
            except InvalidInput as error:
                raise system_error(error) from error
            if not view.occupancy.size:
                raise TaskFailed(
                    Cause.SYSTEM_ERROR,
                    "map2d has no map, though it took up the newest keyframe; see `helios status` "
                    "and its log, logs/map2d.log in the state folder",
                )
            self._ground = GroundMap(
                view.occupancy,
                view.top_m,
                view.cell_m,
                view.origin_m,
                view.version,
                view.map_id,
            )
            if len(view.trajectory_m):
                self._start = float(view.trajectory_m[0, 0]), float(view.trajectory_m[0, 1])
            self._frontiers = tuple(
                Frontier(f.id, (f.x_m, f.y_m), f.size_m, dict(f.values)) for f in view.frontiers
            )
        self._fresh = True

    def _snapshot(self, known: int = 0, map_id: str = "") -> pb.MapSnapshot:
        """Newest map; without arrays if it is that version of that map."""
        return newest_snapshot(
            lambda request: self._line.call(SNAPSHOT, request), known, map_id, ground_only=True
        )

    def _on_pause(self, why: str | None) -> None:
        if why is None:
            self._listener.on_resumed()
        else:
            self._listener.on_paused(why)


def _listed(services: Sequence[str]) -> str:
    return " and ".join(dict.fromkeys(services))
