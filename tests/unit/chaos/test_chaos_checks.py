"""Checks after a run find a damaged journal, displaced objects and damaged messages."""

from __future__ import annotations

import random
import sqlite3
from pathlib import Path
from typing import Any, cast

import numpy as np
from helios_chaos.checks import journal_faults, map_faults, misplaced
from helios_chaos.messages import damaged
from helios_client.answer_types import FoundObject
from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_planner.tasks.store import Store
from hypothesis import given
from hypothesis import strategies as st


def journal(state: Path, *tasks: pb.Task) -> Path:
    store = Store(state / "planner" / "sim-demo-v1-0")
    for task in tasks:
        store.finish(task) if task.state != "running" else store.put(task)
    store.close()
    return store.path


def test_a_sound_journal_has_no_faults(tmp_path: Path) -> None:
    journal(tmp_path, pb.Task(id="a", state="succeeded"))
    assert journal_faults(tmp_path, ["a"]) == []


def test_a_missing_task_and_an_open_journal_of_an_ended_one_are_found(tmp_path: Path) -> None:
    path = journal(tmp_path, pb.Task(id="a", state="succeeded"))
    with sqlite3.connect(path) as db:
        db.execute("INSERT INTO journal VALUES ('a', 0, NULL, NULL, '{}', '', 0)")
    assert journal_faults(tmp_path, ["a", "b"]) == [
        "task b is missing",
        "task a has ended and is still in the journal",
    ]


def test_a_damaged_file_is_found(tmp_path: Path) -> None:
    path = journal(tmp_path, pb.Task(id="a", state="succeeded"))
    path.write_bytes(path.read_bytes()[:100] + bytes(4000))
    [said] = journal_faults(tmp_path, ["a"])
    assert "read" in said or "integrity" in said


def test_no_journal_is_a_fault(tmp_path: Path) -> None:
    assert "0 files of tasks" in journal_faults(tmp_path, [])[0]


def objects(*xs_m: float) -> list[FoundObject]:
    return [FoundObject(n, "mug", [x, 0.0, 1.0], score=0.9) for n, x in enumerate(xs_m)]


TRUTH = pb.TruthObjects(
    instances=[pb.TruthInstance(name="mug_0", class_name="mug", graspable=True)]
)


def test_objects_far_from_every_true_one_of_their_class_are_found() -> None:
    assert misplaced(objects(0.1, 0.2), TRUTH) == []
    [said] = misplaced(objects(0.1, 3.0), TRUTH)
    assert "1 of 2 objects" in said
    assert "mug 1 (3.0 m)" in said


class Maps:
    """Client of a gateway whose maps are these."""

    def __init__(self, explored_m2: float) -> None:
        self._explored_m2 = explored_m2

    def occupancy(self) -> dict[str, np.ndarray]:
        return {"occupancy": np.full((4, 4), -1, np.int8), "cell_m": np.array(0.05)}

    def map_info(self) -> dict[str, Any]:
        return {"explored_m2": self._explored_m2}

    def objects(self) -> list[FoundObject]:
        return []


def test_a_map_without_known_ground_is_a_fault() -> None:
    assert map_faults(cast(Helios, Maps(0.0)), TRUTH) == ["the 2D map is empty"]
    assert map_faults(cast(Helios, Maps(3.0)), TRUTH) == []


def test_unsure_objects_and_furniture_are_not_compared() -> None:
    unsure = FoundObject(1, "mug", [9.0, 9.0, 1.0], score=0.2)
    sofa = FoundObject(2, "sofa", [9.0, 9.0, 1.0], score=0.9)
    assert misplaced([unsure, sofa], TRUTH) == []


@given(st.binary(max_size=2000), st.integers(0, 1000))
def test_a_damaged_message_differs_from_the_message(data: bytes, seed: int) -> None:
    ways = [damaged(data, random.Random(seed + n)) for n in range(20)]
    assert any(way != data for way in ways)
