"""Tests the command that records a camera stream while all services run."""

import json
from pathlib import Path

import pytest
from helios_eval.studies.recording_rate import main

SHARED = Path(__file__).resolve().parents[4] / "shared"
KITCHEN = SHARED / "data" / "redkitchen"
MODEL = SHARED / "models" / "yolox_nano.onnx"


def test_a_missing_data_set_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["/no/such/folder", "--detector", "onnx:x"]) == 2
    assert "there is no data set at" in capsys.readouterr().err


@pytest.mark.timeout(300)
@pytest.mark.skipif(not KITCHEN.is_dir(), reason=f"no real frames at {KITCHEN}")
@pytest.mark.skipif(not MODEL.is_file(), reason=f"no model at {MODEL}")
def test_every_frame_is_recorded_while_the_maps_work(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Uses a rate that any machine keeps; 30 Hz is for the command on an idle machine."""
    figures = tmp_path / "figures.json"
    argv = [str(KITCHEN), "--detector", f"onnx:{MODEL}", "--hz", "8", "--seconds", "3"]
    assert main([*argv, "--cores", "0", "--json", str(figures)]) == 0, capsys.readouterr()
    found = json.loads(figures.read_text())
    assert found["recorded"] == found["sent"] == 21
    assert found["keyframes_recorded"] == 3
    assert {"/detector/preview", "/objectmap/ack"} <= found["messages"].keys()
