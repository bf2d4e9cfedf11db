"""Tests `helios replay` of a recording with a late search, unknown classes, damage or an interrupt:
it ends, reports why, and writes its results."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from helios_core.codec import context_to_proto
from helios_core.topics import CONTEXT, KEYFRAME
from helios_core.types import Role, SearchClass, SearchContext

from tests.helios_up import MARK, left_of
from tests.support import wait_until
from tests.unit.recorder.recorder_bus import Recorded, frame

BEFORE, AFTER = 3, 4  # keyframes before and after the search began
LONGEST_S = 280.0


def record(folder: Path, *classes: str, after: int = AFTER) -> Path:
    """Write a recording whose first `BEFORE` keyframes have no observation."""
    recorded = Recorded(folder, chunk_mb=0.02)
    recorded.robot()
    for seq in range(BEFORE):
        recorded.bus.publish(KEYFRAME, frame(seq))
    sought = tuple(SearchClass(name, Role.WATCH, 0.2) for name in classes)
    recorded.bus.publish(CONTEXT, context_to_proto(SearchContext("late", sought)))
    for seq in range(BEFORE, BEFORE + after):
        recorded.look(seq, "late")
    recorded.close()
    (path,) = folder.glob("*.mcap")
    return path


def command(path: Path, out: Path, flags: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "helios_client", "replay", str(path), "--out", str(out), *flags]


def replay(path: Path, out: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    """Run a replay to its end; checks that no process is left."""
    mark = uuid.uuid4().hex
    done = subprocess.run(
        command(path, out, flags),
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
        env=os.environ | {"COLUMNS": "160", MARK: mark},
    )
    assert left_of(mark) == []
    return done


@pytest.mark.parametrize("flags", [[], ["--from", "0.001"]])
def test_keyframes_before_the_first_search_are_mapped_and_unknown_classes_are_skipped(
    flags: list[str], tmp_path: Path
) -> None:
    path = record(tmp_path, "box", "cup")
    done = replay(path, tmp_path / "out", "--detector", "paint", *flags)
    assert done.returncode == 0, done.stderr
    assert "not searched for: 'cup' is not painted" in done.stdout
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["keyframes"] == summary["frames"]
    assert summary["before_search"] == summary["frames"] - AFTER
    assert (summary["interrupted"], summary["lost"]["chunks"]) == (False, 0)
    assert flags or summary["before_search"] == BEFORE
    assert json.loads((tmp_path / "out/objects.json").read_text()) == []
    occupancy = np.load(tmp_path / "out/occupancy.npz")["occupancy"]
    assert np.any(occupancy >= 0)


def test_a_recording_without_any_class_of_the_detector_ends_as_a_usage_error(
    tmp_path: Path,
) -> None:
    path = record(tmp_path, "cup")
    done = replay(path, tmp_path / "out", "--detector", "paint")
    assert done.returncode == 2, done.stdout
    assert "detector paint knows none of the classes to find: 'cup' is not painted" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out/objects.json").exists()


def test_a_damaged_recording_is_replayed_without_its_lost_chunks(tmp_path: Path) -> None:
    path = record(tmp_path, "box")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 50] = bytes(b ^ 0xFF for b in data[middle : middle + 50])
    path.write_bytes(data)
    done = replay(path, tmp_path / "out", "--classes", "box", "--detector", "paint")
    assert done.returncode == 0, done.stderr
    assert "damaged chunk" in done.stdout
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert 0 < summary["frames"] < BEFORE + AFTER
    assert 1 <= summary["lost"]["chunks"] <= 2
    assert summary["lost"]["bytes"] > 50
    strict = replay(
        path, tmp_path / "strict", "--classes", "box", "--detector", "paint", "--strict"
    )
    assert strict.returncode == 1
    assert "without --strict the rest is played" in strict.stderr


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_replay_writes_its_results_so_far(
    number: signal.Signals, tmp_path: Path
) -> None:
    path = record(tmp_path, "box", "cup", after=60)
    out, said = tmp_path / "out", tmp_path / "said"
    mark = uuid.uuid4().hex
    with said.open("wb") as stream:
        process = subprocess.Popen(
            command(path, out, ["--detector", "paint", "--rate", "0.01"]),
            stdout=stream,
            stderr=stream,
            env=os.environ | {"PYTHONUNBUFFERED": "1", "COLUMNS": "160", MARK: mark},
        )
    try:
        wait_until(lambda: "not searched for" in said.read_text(), LONGEST_S, "the search began")
        process.send_signal(number)
        assert process.wait(60) == 130, said.read_text()
    finally:
        process.kill()
    assert left_of(mark) == []
    assert "interrupted: the results so far are written" in said.read_text()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert BEFORE <= summary["keyframes"] < summary["frames"] == BEFORE + 60
    for name in ("objects.json", "occupancy.png", "occupancy.npz"):
        assert (out / name).stat().st_size > 0
