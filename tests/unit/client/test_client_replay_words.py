"""The search context, the detector and the process arguments that a replay's flags select."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_client.replay.input_selection import search_and_detector
from helios_client.supervision.flag_checks import default_detector
from helios_client.supervision.service_specs import RECORDED_DETECTOR, StackOptions
from helios_client.supervision.service_table import ServiceRow, is_ready
from helios_client.usage_errors import UsageError

TAPE, FOLDER = Path("tour.mcap"), Path("folder")


def test_a_recording_needs_no_classes_and_no_detector() -> None:
    assert search_and_detector(TAPE, None, "", None) == (None, RECORDED_DETECTOR)
    assert search_and_detector(TAPE, None, "", "onnx:x") == (None, "onnx:x")
    context, detector = search_and_detector(TAPE, "cup", "cup=0.3", "onnx:x")
    assert context is not None
    assert (context.classes[0].threshold, detector) == (0.3, "onnx:x")


@pytest.mark.parametrize(
    ("source", "classes", "thresholds", "detector"),
    [
        (FOLDER, None, "", "onnx:x"),
        (FOLDER, "cup", "", None),
        (TAPE, "cup", "", None),
        (TAPE, "cup", "", RECORDED_DETECTOR),
        (TAPE, None, "cup=0.3", None),
    ],
)
def test_missing_flags_are_a_usage_error(
    source: Path, classes: str | None, thresholds: str, detector: str | None
) -> None:
    with pytest.raises(UsageError):
        search_and_detector(source, classes, thresholds, detector)


def test_the_robot_and_the_source_select_the_default_detector() -> None:
    assert default_detector("sim", None) == "simulated"
    assert default_detector("replay", TAPE) == RECORDED_DETECTOR
    with pytest.raises(UsageError):
        default_detector("replay", FOLDER)


def test_replay_and_recorder_processes_get_their_flags(tmp_path: Path) -> None:
    stack = StackOptions(
        "replay",
        7447,
        tmp_path,
        detector=RECORDED_DETECTOR,
        source=TAPE,
        from_s=2.0,
        to_s=5.0,
        rate=1.0,
        record=tmp_path / "out",
    )
    specs = {spec.name: " ".join(spec.argv) for spec in stack.processes()}
    assert "--from-s 2.0 --to-s 5.0 --rate 1.0" in specs["bridge"]
    assert "--contexts" in specs["bridge"]
    assert "-m helios_replay " in specs["detector"]
    assert f"--out {tmp_path / 'out'}" in specs["recorder"]


def test_a_degraded_recorder_does_not_keep_the_stack_from_being_ready() -> None:
    rows = [ServiceRow("bridge", "ready", "", 0, 1), ServiceRow("recorder", "degraded", "", 0, 2)]
    assert is_ready(rows)
    assert not is_ready([ServiceRow("bridge", "degraded", "", 0, 1)])
