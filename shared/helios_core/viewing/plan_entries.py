"""Conversion of plans and decisions to Foxglove scenes: current path, and candidates. No I/O."""

from __future__ import annotations

import math
from collections.abc import Iterator

from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame

from helios_core import proto as pb
from helios_core.recording_format import CANDIDATES, PATH, PLAN
from helios_core.viewing.entry import Entry
from helios_core.viewing.foxglove_scene import (
    WORLD,
    Rgb,
    Xyz,
    add_arrow,
    add_ball,
    add_line,
    add_words,
    entity,
    pose,
    scene,
    stamp,
)

PATH_RGB: Rgb = (18, 158, 106)
CHOSEN_RGB: Rgb = (18, 158, 106)
OTHER_RGB: Rgb = (120, 126, 140)
PATH_Z_M = 0.05


def plan_entries(plan: pb.Plan, stamp_ns: int) -> Iterator[Entry]:
    """Path as poses, and as a line with goal and purpose; both empty while the robot stands."""
    points = _points(plan)
    path = PosesInFrame(timestamp=stamp(stamp_ns), frame_id=WORLD)
    goal = (plan.goal.x_m, plan.goal.y_m, plan.goal.yaw_rad)
    goal_yaw_rad = goal[2] if plan.HasField("goal") and all(map(math.isfinite, goal)) else None
    for k, (x, y, z) in enumerate(points):
        ahead, behind = points[min(k + 1, len(points) - 1)], points[max(k - 1, 0)]
        near, far = ((x, y), ahead) if k + 1 < len(points) else (behind, (x, y))
        yaw_rad = math.atan2(far[1] - near[1], far[0] - near[0])
        if k == len(points) - 1 and goal_yaw_rad is not None:
            yaw_rad = goal_yaw_rad
        path.poses.append(pose((x, y, z), yaw_rad))
    yield Entry(PATH, path)
    drawn = []
    if points:
        about = {"task": plan.task_id, "purpose": plan.purpose}
        shown = entity("plan", stamp_ns, about)
        if len(points) > 1:
            add_line(shown, points, 0.05, PATH_RGB)
        if goal_yaw_rad is not None:
            add_arrow(shown, (goal[0], goal[1], PATH_Z_M), goal_yaw_rad, PATH_RGB)
        if plan.purpose:
            x, y, _ = points[-1]
            add_words(shown, (x, y, 0.25), plan.purpose, PATH_RGB)
        drawn.append(shown)
    yield Entry(PLAN, scene(drawn, stamp_ns))


def candidate_entry(decision: pb.Decision, stamp_ns: int) -> Entry:
    """Ball at each candidate with its total; the chosen one is larger and green."""
    drawn = []
    for k, c in enumerate(decision.candidates):
        at_m = (c.position_m.x, c.position_m.y, max(c.position_m.z, 0.1))
        if not all(map(math.isfinite, at_m)):
            continue
        about = {
            "kind": c.kind,
            "name": c.name,
            "id": c.id,
            "chosen": c.chosen,
            "rule": decision.rule,
            "decision": decision.index,
            **dict(c.terms),
        }
        shown = entity(f"candidate {k}", stamp_ns, about)
        rgb = CHOSEN_RGB if c.chosen else OTHER_RGB
        add_ball(shown, at_m, 0.22 if c.chosen else 0.14, rgb)
        total = f" {c.terms['total']:.2f}" if "total" in c.terms else ""
        add_words(shown, (*at_m[:2], at_m[2] + 0.2), f"{c.name or c.kind}{total}", rgb)
        drawn.append(shown)
    return Entry(CANDIDATES, scene(drawn, stamp_ns))


def _points(plan: pb.Plan) -> list[Xyz]:
    """Finite points of the path."""
    numbers = plan.path_m
    pairs = zip(numbers[::2], numbers[1::2], strict=False)
    return [(x, y, PATH_Z_M) for x, y in pairs if math.isfinite(x) and math.isfinite(y)]
