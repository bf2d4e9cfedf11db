"""What HELIOS took from a plan, as lines of text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from helios_sim.home.home_types import Room
from helios_sim.plans.plan_builder import DrawnHome
from helios_sim.robot_model import description

_MOST_LINES = 12
_CLOSED_FROM_M = 0.3


def summary(drawn: DrawnHome) -> list[str]:
    """Rooms, doors, furniture by class, what carries things, and what is left out and why."""
    plan, home = drawn.plan, drawn.home
    level = f", level {plan.level}" if plan.level else ""
    others = [name for name in plan.other_levels if name]
    lines = [f"{plan.file_name}{level}, SHA-256 {plan.sha256}"]
    if others:
        lines.append(f"not used: the level{'s' * (len(others) > 1)} {', '.join(others)}")
    lines.append(f"rooms, {len(home.rooms)}: {'; '.join(_room(drawn, r) for r in home.rooms)}")
    lines.append(_doors(drawn))
    closed = sum(block.length_m for block in drawn.area.closing)
    if closed > _CLOSED_FROM_M:
        lines.append(
            f"{closed:.1f} m of the outline of rooms have no wall in the plan; HELIOS closes them"
        )
    lines += unreachable_sentences(drawn)
    lines.append(f"furniture: {_counted(p.class_name for p in drawn.furnishing.pieces)}")
    lines.append(f"drawn by: {_counted(p.source for p in drawn.furnishing.pieces)}")
    lines.append(f"can carry things: {_counted(r.class_name for r in home.receptacles)}")
    if drawn.furnishing.out_of_reach:
        lines.append(
            "without a free surface within reach, so no task uses them: "
            + _counted(drawn.furnishing.out_of_reach.elements())
        )
    lines += _left_out(drawn)
    return lines


def _room(drawn: DrawnHome, room: Room) -> str:
    drawn_name = drawn.area.rooms[room.index].name
    name = f"{drawn_name} ({room.kind})" if drawn_name else room.kind
    return f"{name} {room.area_m2:.1f} m²"


def _doors(drawn: DrawnHome) -> str:
    doors = drawn.doors
    windows = sum(opening.kind == "window" for opening in drawn.plan.openings)
    parts = [f"doors between rooms, open: {len(doors.open_doors)}"]
    if doors.shut:
        parts.append(f"doors to the outside, shut: {len(doors.shut)}")
    if doors.nowhere:
        parts.append(f"doors in no wall, left out: {len(doors.nowhere)}")
    return f"{'; '.join(parts)}; windows: {windows}"


def unreachable_sentences(drawn: DrawnHome) -> list[str]:
    """One sentence on the rooms that the robot cannot reach; none if it reaches all."""
    away = drawn.unreachable_rooms()
    if not away:
        return []
    names = [_room(drawn, room) for room in away]
    indices = {room.index for room in away}
    narrow = [
        f"{door.name} is {door.width_m:.2f} m wide"
        for door in drawn.home.doors
        if door.width_m < 2 * drawn.home.preset.passage_radius_m and indices & set(door.rooms)
    ]
    robot_m = 2 * description().footprint_radius_m
    why = f" ({'; '.join(dict.fromkeys(narrow))})" if narrow else ""
    needs = 2 * drawn.home.preset.passage_radius_m
    return [
        f"the robot, {robot_m:.1f} m wide, cannot reach: {'; '.join(names)}{why}; it needs "
        f"{needs:.1f} m, so widen a door or clear the way"
    ]


def _left_out(drawn: DrawnHome) -> list[str]:
    plan = drawn.plan
    sentences = [*plan.left_out, *drawn.furnishing.left_out]
    sentences += [f"room {room.name or '?'}: no walls around it" for room in drawn.area.outdoors]
    sentences += [
        f"the model of {name}: {why}" for name, why in sorted(drawn.model_failures.items())
    ]
    rows = [f"left out: {sentence}" for sentence in dict.fromkeys(sentences)]
    if len(rows) > _MOST_LINES:
        rest = len(rows) - _MOST_LINES
        rows = [*rows[:_MOST_LINES], f"left out: {rest} more"]
    return rows


def _counted(names: Iterable[str]) -> str:
    counts = Counter(names)
    return ", ".join(f"{n} {name}" for name, n in sorted(counts.items())) or "nothing"
