"""Tests real camera frames through real processes: a mug on a table is found at its position."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import uuid
from pathlib import Path

import numpy as np
import pytest

from tests.helios_up import MARK, left_of

SHARED = Path(__file__).resolve().parents[2].parent / "shared"
DATASET, MODEL = SHARED / "data" / "redkitchen", SHARED / "models" / "yolox_nano.onnx"
FRAMES = 20
MUG_A_M = (1.80, 0.715, 0.80)  # measured from all frames; see the data set's README

needs_data = pytest.mark.skipif(
    not (DATASET.is_dir() and MODEL.is_file()),
    reason=f"the data set and the model are not at {SHARED}, and are not part of the project",
)


def replay(
    out: Path, classes: str, detector: str = f"onnx:{MODEL}"
) -> subprocess.CompletedProcess[str]:
    """Run `helios replay` on the first frames; checks that no process is left."""
    mark = uuid.uuid4().hex
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", "replay", str(DATASET), "--classes", classes,
         "--detector", detector, "--out", str(out), "--limit", str(FRAMES)],
        capture_output=True, text=True, timeout=280, check=False,
        env=os.environ | {"COLUMNS": "160", MARK: mark},
    )  # fmt: skip
    assert left_of(mark) == []
    return done


@needs_data
def test_replay_finds_a_mug_in_real_frames(tmp_path: Path) -> None:
    done = replay(tmp_path, "cup,dining table")
    assert done.returncode == 0, done.stderr
    objects = json.loads((tmp_path / "objects.json").read_text())
    cups = [o for o in objects if o["class"] == "cup"]
    nearest_m = min(np.linalg.norm(np.subtract(o["center_m"], MUG_A_M)) for o in cups)
    assert nearest_m < 0.10
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["frames"], summary["keyframes"]) == (FRAMES, FRAMES)
    assert {"occupancy", "value", "objects", "detect", "total"} <= set(summary["ms_per_frame"])
    occupancy = np.load(tmp_path / "occupancy.npz")["occupancy"]
    assert set(np.unique(occupancy)) == {-1, 0, 100}
    assert (tmp_path / "occupancy.png").read_bytes().startswith(b"\x89PNG")
    assert "cup" in done.stdout


@needs_data
@pytest.mark.parametrize(
    ("classes", "detector", "words", "status"),
    [
        ("unicorn,zeppelin", f"onnx:{MODEL}", "unicorn", 2),  # no class is known
        ("cup", "onnx:/no/such/model.onnx", "/no/such/model.onnx", 2),
        ("cup", "crystal-ball", "crystal-ball", 2),  # no such detector
    ],
)
def test_an_unknown_class_model_or_detector_is_reported_in_one_sentence(
    classes: str, detector: str, words: str, status: int, tmp_path: Path
) -> None:
    done = replay(tmp_path, classes, detector)
    assert done.returncode == status
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "objects.json").exists()
