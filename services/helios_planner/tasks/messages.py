"""Conversion of tasks, decisions and plans to protobuf messages and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_core import proto as pb
from helios_core import tracing
from helios_core.agent_presets import DEFAULT_AGENT
from helios_core.codec import frame_id_to_proto
from helios_core.types import FrameId
from numpy.typing import NDArray

from helios_planner.decisions.counterfactual import Recomputed
from helios_planner.decisions.decision import Candidate, Decision, Do
from helios_planner.instruction.move_commands import Point
from helios_planner.instruction.parser import Instruction, Kind
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.task import Cause, Phase, State, Task


def task_to_proto(task: Task) -> pb.Task:
    """Message of a task, as published and stored."""
    i = task.instruction
    task_message = pb.Task(
        id=task.id,
        instruction=task.text,
        state=task.state,
        phase=task.phase or "",
        cause=task.cause or "",
        message=task.message,
        object=i.object or "",
        start=i.start or "",
        goal=i.goal or "",
        kind=i.kind,
        steps=task.steps,
        max_steps=task.max_steps,
        time_limit_s=task.time_limit_s,
        picks=task.picks,
        created_s=task.created_s,
        started_s=task.started_s,
        ended_s=task.ended_s,
        progress=task.progress,
        context_id=task.context_id,
        seeking=task.seeking,
        agent=task.agent,
        priority=task.priority,
        settings=task.settings,
        on_hold=task.on_hold,
        unused=i.unused,
        traceparent=task.traceparent,
    )
    if task.seen_at_goal is not None:
        task_message.seen_at_goal = task.seen_at_goal
    if task.eta_s is not None:
        task_message.eta_low_s, task_message.eta_high_s = task.eta_s
    if i.point is not None:
        task_message.point.CopyFrom(pb.GoalPoint(x_m=i.point.x_m, y_m=i.point.y_m))
        if i.point.yaw_rad is not None:
            task_message.point.yaw_rad = i.point.yaw_rad
    return task_message


def task_from_proto(task: pb.Task) -> Task:
    """Inverse of `task_to_proto`, except for the estimated end, which is out of date."""
    return Task(
        id=task.id,
        text=task.instruction,
        instruction=Instruction(
            Kind(task.kind),
            task.object or None,
            task.start or None,
            task.goal or None,
            tuple(task.unused),
            _point_from_proto(task.point) if task.HasField("point") else None,
        ),
        state=State(task.state),
        max_steps=task.max_steps,
        time_limit_s=task.time_limit_s,
        created_s=task.created_s,
        phase=Phase(task.phase) if task.phase else None,
        cause=Cause(task.cause) if task.cause else None,
        message=task.message,
        seeking=task.seeking,
        steps=task.steps,
        picks=task.picks,
        started_s=task.started_s,
        ended_s=task.ended_s,
        progress=task.progress,
        context_id=task.context_id,
        agent=task.agent or DEFAULT_AGENT,
        priority=task.priority,
        settings=dict(task.settings),
        on_hold=task.on_hold,
        seen_at_goal=task.seen_at_goal if task.HasField("seen_at_goal") else None,
        traceparent=tracing.valid(task.traceparent),
    )


def _point_from_proto(point: pb.GoalPoint) -> Point:
    return Point(point.x_m, point.y_m, point.yaw_rad if point.HasField("yaw_rad") else None)


def decision_to_proto(
    decision: Decision, task: Task, index: int, frame: FrameId | None, made_s: float
) -> pb.Decision:
    """Message of a decision. index: its number in the task; frame: newest keyframe before it;
    made_s: seconds since 1970."""
    out = pb.Decision(
        task_id=task.id,
        index=index,
        phase=task.phase or "",
        rule=decision.rule,
        why=decision.why,
        made_s=made_s,
        settings=decision.settings,
        context_id=task.context_id,
        do=decision.do,
        candidates=_candidates_to_proto(decision.candidates, decision.winner),
        memory=_candidates_to_proto(decision.memory, None),
    )
    if frame is not None:
        out.id.CopyFrom(frame_id_to_proto(frame))
    return out


def decision_from_proto(message: pb.Decision) -> Decision:
    """Inverse of `decision_to_proto`."""
    chosen = [k for k, c in enumerate(message.candidates) if c.chosen]
    return Decision(
        rule=message.rule,
        do=Do(message.do),
        candidates=tuple(map(_candidate_from_proto, message.candidates)),
        winner=chosen[0] if chosen else None,
        why=message.why,
        settings=dict(message.settings),
        memory=tuple(map(_candidate_from_proto, message.memory)),
    )


def recomputed_to_proto(recomputed: Recomputed) -> pb.Recomputed:
    """Message of a decision recomputed under other settings."""
    d = recomputed.decision
    return pb.Recomputed(
        do=d.do,
        candidates=_candidates_to_proto(d.candidates, d.winner),
        why=d.why,
        flips=recomputed.flips,
        certain=recomputed.certain,
    )


def _candidates_to_proto(candidates: Sequence[Candidate], winner: int | None) -> list[pb.Candidate]:
    return [
        pb.Candidate(
            kind=c.kind,
            name=c.name,
            position_m=pb.Vector3(
                x=float(c.position_m[0]), y=float(c.position_m[1]), z=float(c.position_m[2])
            ),
            terms={name: float(value) for name, value in c.terms.items()},
            chosen=k == winner,
            id=c.id,
        )
        for k, c in enumerate(candidates)
    ]


def _candidate_from_proto(c: pb.Candidate) -> Candidate:
    p = c.position_m
    return Candidate(c.kind, c.name, (p.x, p.y, p.z), dict(c.terms), c.id)


def plan_to_proto(
    task_id: str, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str
) -> pb.Plan:
    """Message of a plan. route_m: [n, 2], world; goal: the pose at its end, None without one."""
    out = pb.Plan(task_id=task_id, path_m=route_m.ravel().tolist(), purpose=purpose)
    if goal is not None:
        out.goal.CopyFrom(pb.Pose2(x_m=goal.x_m, y_m=goal.y_m, yaw_rad=goal.yaw_rad))
    return out
