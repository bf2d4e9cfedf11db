"""Checks after a run: the planner's journal, and the maps against the simulator's ground truth."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from helios_client.answer_types import FoundObject
from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_core.errors import HeliosError
from helios_core.task_states import ENDED

NEAR_M = 0.75  # from a mapped object to the nearest true one of its class
SURE = 0.5  # score of the objects that are compared
RIGHT_SHARE = 0.9


def journal_faults(state_dir: Path, played: Iterable[str]) -> list[str]:
    """Faults of the planner's file, after the planner has ended. played: ids of the known tasks."""
    files = sorted(state_dir.glob("planner/**/tasks.sqlite"))
    if len(files) != 1:
        return [f"{len(files)} files of tasks in {state_dir}; wanted 1"]
    out = [f"a damaged file was put aside: {p.name}" for p in files[0].parent.glob("*.damaged-*")]
    db = sqlite3.connect(f"file:{files[0]}?mode=ro", uri=True)
    try:
        [sound] = db.execute("PRAGMA integrity_check").fetchone()
        out += [] if sound == "ok" else [f"integrity: {sound}"]
        rows = db.execute("SELECT id, state, message FROM tasks").fetchall()
        states = {id: state for id, state, _ in rows}
        out += [f"task {id} is missing" for id in played if id not in states]
        for id, state, message in rows:
            if pb.Task.FromString(message).state != state:
                out.append(f"task {id} has two states")
        for (id,) in db.execute("SELECT task_id FROM journal"):
            if states.get(id) in ENDED:
                out.append(f"task {id} has ended and is still in the journal")
        for id, most, number in db.execute(
            "SELECT task_id, MAX(number), COUNT(*) FROM decisions GROUP BY task_id"
        ):
            if most + 1 != number:
                out.append(f"task {id} has {number} decisions, numbered up to {most}")
    except sqlite3.Error as error:
        out.append(f"the file cannot be read: {error}")
    finally:
        db.close()
    return out


def map_faults(helios: Helios, truth: pb.TruthObjects) -> list[str]:
    """Faults of the maps that the services publish now."""
    try:
        occupancy, info = helios.occupancy(), helios.map_info()
        objects = helios.objects()
    except HeliosError as error:
        return [f"the maps cannot be read: {error.message}"]
    out = [
        f"the array {name} has values that are not finite"
        for name, values in occupancy.items()
        if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all()
    ]
    if info["explored_m2"] <= 0:
        out.append("the 2D map is empty")
    return out + misplaced(objects, truth)


def misplaced(objects: Sequence[FoundObject], truth: pb.TruthObjects) -> list[str]:
    """Faults of the object map: too few of its surest movable objects are near a true one."""
    movable = {one.class_name for one in truth.instances if one.graspable}
    sure = [o for o in objects if o.score >= SURE and o.class_name in movable]
    wrong = [o for o in sure if _away_m(o, truth) > NEAR_M]
    if len(wrong) <= (1 - RIGHT_SHARE) * len(sure):
        return []
    named = ", ".join(f"{o.class_name} {o.id} ({_away_m(o, truth):.1f} m)" for o in wrong[:5])
    return [f"{len(wrong)} of {len(sure)} objects are far from every true one: {named}"]


def _away_m(found: FoundObject, truth: pb.TruthObjects) -> float:
    """Distance on the floor to the nearest true object of the class."""
    center = np.array(found.center_m[:2])
    return min(
        (
            float(np.hypot(*(center - (one.center_m.x, one.center_m.y))))
            for one in truth.instances
            if one.class_name == found.class_name
        ),
        default=np.inf,
    )
