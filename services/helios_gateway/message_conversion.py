"""Conversion of bus messages to HTTP models. Removes numbers that are not finite."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from helios_core import proto as pb
from helios_core.codec.robot import battery_from_proto
from helios_core.errors import Internal
from helios_core.geometry import se2_to_se3
from helios_core.printable_text import printable
from helios_core.task_states import is_task_state
from helios_core.tracing import trace_id_of

from helios_gateway import api_map_models, api_models
from helios_gateway.task_suggestions import KnownObject, words

PHASES = {
    "move": ("find_object", "pick", "find_receptacle", "place"),
    "find": ("find_object",),
    "go_to": ("find_receptacle",),
    "go_to_point": ("go",),
    "go_home": ("go",),
    "explore": ("explore",),
}


def finite(value: float) -> float | None:
    """Value, or None if it is not finite: JSON cannot express it."""
    return value if math.isfinite(value) else None


def metres(value: float) -> float | None:
    """Length rounded to 0.01 mm; None if it is not finite."""
    return round(value, 5) if math.isfinite(value) else None


def pairs(flat: Sequence[float]) -> list[list[float | None]]:
    """[x, y] pairs of x, y, x, y …, rounded to 0.1 mm; points that are not finite are left out."""
    return [
        [round(x, 4), round(y, 4)]
        for x, y in zip(flat[::2], flat[1::2], strict=False)
        if math.isfinite(x) and math.isfinite(y)
    ]


def _vector(v: pb.Vector3) -> list[float | None]:
    return [metres(v.x), metres(v.y), metres(v.z)]


def _numbers(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: finite(value) for name, value in sorted(values.items())}


def _time(seconds: float) -> float | None:
    return finite(seconds) or None


def _eta_s(message: pb.Task) -> tuple[float, float] | None:
    if not (message.HasField("eta_low_s") and message.HasField("eta_high_s")):
        return None
    low, high = finite(message.eta_low_s), finite(message.eta_high_s)
    return None if low is None or high is None else (low, high)


def task(message: pb.Task, recordings: Sequence[str] = ()) -> api_models.Task:
    """HTTP model of a task; recordings: names of those around its failure. Raises Internal for an
    unknown state."""
    state = message.state
    if not is_task_state(state):
        raise Internal(f"the planner named a state {state!r} of task {message.id}")
    return api_models.Task(
        id=message.id, instruction=printable(message.instruction), state=state,
        phase=message.phase, phases=phases(message.kind, message.phase, state),
        message=printable(message.message), cause=message.cause, seeking=message.seeking,
        kind=message.kind, object=message.object, start=message.start, goal=message.goal,
        steps=message.steps, max_steps=message.max_steps, picks=message.picks,
        time_limit_s=_time(message.time_limit_s),
        progress=finite(message.progress), eta_s=_eta_s(message),
        created_s=_time(message.created_s), started_s=_time(message.started_s),
        ended_s=_time(message.ended_s),
        context_id=message.context_id, agent=message.agent, priority=message.priority,
        settings=dict(sorted(message.settings.items())), on_hold=message.on_hold,
        unused=list(message.unused),
        seen_at_goal=message.seen_at_goal if message.HasField("seen_at_goal") else None,
        point=_point(message.point) if message.HasField("point") else None,
        trace_id=trace_id_of(message.traceparent) or None, recordings=list(recordings),
    )  # fmt: skip


def _point(point: pb.GoalPoint) -> api_models.GoalPoint:
    yaw_rad = finite(point.yaw_rad) if point.HasField("yaw_rad") else None
    return api_models.GoalPoint(x_m=metres(point.x_m), y_m=metres(point.y_m), yaw_rad=yaw_rad)


def phases(kind: str, phase: str, state: str) -> list[api_models.Phase]:
    """Phases of a kind of task; those before the current one are done."""
    names = list(PHASES.get(kind, PHASES["move"]))
    if phase and phase not in names:
        names.append(phase)
    at = len(names) if state == "succeeded" else names.index(phase) if phase else 0
    out = []
    for i, name in enumerate(names):
        if i < at:
            out.append(api_models.Phase(name=name, state="done"))
        elif i > at or state == "queued":
            out.append(api_models.Phase(name=name, state="waiting"))
        elif state in ("failed", "cancelled"):
            out.append(api_models.Phase(name=name, state="failed"))
        else:
            out.append(api_models.Phase(name=name, state="active"))
    return out


def decision(message: pb.Decision) -> api_models.Decision:
    """HTTP model of a decision, with its candidates and its outcome under other settings."""
    again = message.recomputed if message.HasField("recomputed") else None
    return api_models.Decision(
        task_id=message.task_id, index=message.index, phase=message.phase, rule=message.rule,
        do=message.do, why=message.why, settings=_numbers(message.settings),
        made_s=_time(message.made_s), context_id=message.context_id,
        candidates=_candidates(message.candidates),
        recomputed=again and api_models.Recomputed(
            do=again.do, why=again.why, flips=again.flips, certain=again.certain,
            candidates=_candidates(again.candidates),
        ),
    )  # fmt: skip


def _candidates(messages: Iterable[pb.Candidate]) -> list[api_models.Candidate]:
    return [
        api_models.Candidate(
            kind=c.kind,
            name=c.name,
            position_m=_vector(c.position_m),
            terms=_numbers(c.terms),
            chosen=c.chosen,
        )
        for c in messages
    ]


def pose(x_m: float, y_m: float, yaw_rad: float) -> api_models.RobotPose | None:
    """Pose model; None if a number is not finite."""
    if not all(map(math.isfinite, (x_m, y_m, yaw_rad))):
        return None
    return api_models.RobotPose(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)


def plan(message: pb.Plan) -> api_models.Plan:
    """HTTP model of the path that the robot follows, in the world, metres."""
    goal = message.goal
    return api_models.Plan(
        task_id=message.task_id,
        path_m=pairs(message.path_m),
        goal=pose(goal.x_m, goal.y_m, goal.yaw_rad) if message.HasField("goal") else None,
        purpose=message.purpose,
    )


def object_list(
    message: pb.ObjectsReply, stored: pb.StoredObjectsReply
) -> api_map_models.ObjectList:
    """HTTP model of all instances of the object map, and of the objects of a stored map."""
    place = stored.relocalisation
    return api_map_models.ObjectList(
        objects=[_object(o) for o in message.objects],
        version=message.version,
        gaussians=message.gaussians,
        stored=[_stored_object(o, place) for o in stored.objects],
        relocalisation=_relocalisation(place) if place.state else None,
    )


def _stored_object(o: pb.ObjectInstance, place: pb.Relocalisation) -> api_map_models.StoredObject:
    """HTTP model of an object of a stored map; without a place while that is unknown."""
    center_m: list[float | None] = [None, None, None]
    tentative = place.state == "tentative" and place.HasField("T_present_stored")
    if tentative:
        T = place.T_present_stored
        center = se2_to_se3(T.x_m, T.y_m, T.yaw_rad) @ [o.center_m.x, o.center_m.y, o.center_m.z, 1]
        center_m = [metres(float(v)) for v in center[:3]]
    return api_map_models.StoredObject(
        class_name=o.class_name,
        relocalisation="tentative" if tentative else "unknown",
        center_m=center_m,
        size_m=_vector(o.size_m),
        score=finite(o.score),
        views=o.views,
    )


def _relocalisation(place: pb.Relocalisation) -> api_map_models.Relocalisation:
    return api_map_models.Relocalisation(
        state="tentative" if place.state == "tentative" else "unknown",
        attempts=place.attempts,
        reason=printable(place.reason),
        overlap_m=finite(place.overlap_m),
        agreement=finite(place.agreement),
        contradiction=finite(place.contradiction),
        ratio=finite(place.ratio),
    )


def _object(o: pb.ObjectInstance) -> api_map_models.ObjectInstance:
    return api_map_models.ObjectInstance(
        id=o.id, class_name=o.class_name, center_m=_vector(o.center_m), size_m=_vector(o.size_m),
        score=finite(o.score), class_score=finite(o.class_score),
        uncertainty=finite(o.uncertainty), views=o.views, gaussians=o.gaussians,
        probabilities=_numbers(o.probabilities), detection_rate=finite(o.detection_rate),
        image_text_nats=finite(o.image_text_nats),
        outline_m=pairs(o.outline_m), relocalisation="relocalised" if o.relocalised else None,
    )  # fmt: skip


def object_detail(message: pb.ObjectDetail) -> api_map_models.ObjectDetail:
    """HTTP model of one instance with the history of its score and its upright box."""
    return api_map_models.ObjectDetail(
        object=_object(message.object),
        history=[
            api_map_models.ScoreSample(
                stamp_s=m.stamp_ns / 1e9,
                views=finite(m.views),
                score=finite(m.score),
                class_score=finite(m.class_score),
            )
            for m in message.history
        ],
        box_center_m=_vector(message.box_center_m),
        box_size_m=_vector(message.box_size_m),
        box_yaw_rad=finite(message.box_yaw_rad),
    )


def frontier(f: pb.Frontier) -> api_map_models.Frontier:
    """HTTP model of a frontier with its values."""
    return api_map_models.Frontier(
        id=f.id,
        center_m=[metres(f.x_m), metres(f.y_m)],
        size_m=metres(f.size_m),
        reachable=f.reachable,
        values=_numbers(f.values),
    )


def robot_state(message: pb.RobotState) -> api_models.RobotState:
    """HTTP model of the robot's state; without a pose if none is finite."""
    return api_models.RobotState(
        pose=pose_of(message.T_world_base.rows),
        tilt_rad=finite(message.tilt_rad),
        held=message.held,
        moving=message.moving,
        stopped=message.stopped,
        finished=message.finished,
        message=printable(message.message),
        robot_boot_id=message.robot_boot_id,
        world_epoch=message.world_epoch,
        origin_id=message.origin_id,
        battery=battery_from_proto(message),
    )


def pose_of(rows: Sequence[float]) -> api_models.RobotPose | None:
    """Pose on the floor of a row-major T_world_base; None unless it has 16 finite numbers."""
    return pose(rows[3], rows[7], math.atan2(rows[4], rows[0])) if len(rows) == 16 else None


def robot_description(message: pb.RobotDescription) -> api_models.RobotDescription:
    """HTTP model of the robot's dimensions and abilities."""
    return api_models.RobotDescription(
        name=message.name, simulated=message.simulated,
        footprint_radius_m=finite(message.footprint_radius_m), height_m=finite(message.height_m),
        reach_m=finite(message.reach_m), max_depth_m=finite(message.max_depth_m),
        camera_height_m=finite(message.camera_height_m),
        camera_width_px=message.camera.width, camera_height_px=message.camera.height,
        can_move=message.can_move, can_pick=message.can_pick, can_place=message.can_place,
        min_forward_m=finite(message.min_forward_m), max_forward_m=finite(message.max_forward_m),
        max_back_m=finite(message.max_back_m), min_turn_rad=finite(message.min_turn_rad),
        max_turn_rad=finite(message.max_turn_rad),
    )  # fmt: skip


def suggestable_objects(found: api_map_models.ObjectList) -> list[KnownObject]:
    """Objects whose score, centre and size are finite."""
    out = []
    for one in found.objects:
        figures = [v for v in (one.score, *one.center_m, *one.size_m) if v is not None]
        if len(figures) == 7:
            score, x, y, z, width, depth, height = figures
            out.append(KnownObject(words(one.class_name), score, (x, y, z), (width, depth, height)))
    return out


def seen_names(found: Iterable[KnownObject]) -> list[api_models.SeenName]:
    """Each name once with its highest score, highest score first."""
    scores: dict[str, list[float]] = {}
    for one in found:
        scores.setdefault(one.name, []).append(one.score)
    names = [
        api_models.SeenName(name=name, score=max(all_), objects=len(all_))
        for name, all_ in scores.items()
    ]
    return sorted(names, key=lambda n: (-n.score, n.name))
