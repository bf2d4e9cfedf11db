"""The study of a detector process at the rate of a camera: ages, drops, mask depths, arguments."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from detector_scene import frame_of
from helios_core.errors import Unavailable
from helios_core.types import Detection, Observation
from helios_eval.studies.camera_rate import main, middles_of, rate_of

SHARED = Path(__file__).resolve().parents[4] / "shared"
KITCHEN = SHARED / "data" / "redkitchen"
MODEL = SHARED / "models" / "yolox_nano.onnx"


def test_ages_drops_and_keyframe_answers_are_matched_by_sequence_number():
    sent = {1: 0.0, 2: 1.0, 3: 2.0, 5: 3.0}
    answered = {1: 0.01, 3: 2.2, 5: 3.03, 9: 4.0}  # 9 was a keyframe
    observed = Counter({9: 1, 10: 2})
    rate = rate_of(sent, answered, [9, 10, 11], observed, 100.0, 0.5)
    assert (rate.sent, rate.answered, rate.older) == (4, 3, 1)
    assert rate.dropped_share == pytest.approx(0.25)
    assert rate.median_ms == pytest.approx(30)
    assert rate.oldest_ms == pytest.approx(200)
    assert (rate.keyframes, rate.keyframes_answered_once) == (3, 1)


def test_a_stream_without_an_answer_is_an_error():
    with pytest.raises(Unavailable, match="no frame of the stream was answered"):
        rate_of({1: 0.0}, {}, [], Counter(), 100.0, 0.0)


def observation_at_depth(mask_depth_m: float, box: tuple[int, int, int, int]) -> Observation:
    """An observation of the scene with one mug whose mask lies at this depth."""
    frame = frame_of()
    depth_m = np.full_like(frame.depth_m, mask_depth_m)
    mask = np.zeros(depth_m.shape, bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    frame = replace(frame, depth_m=depth_m)
    return Observation(frame, "c", (Detection("mug", 0.9, box, mask),), {}, "d")


def test_a_mask_is_judged_by_its_median_depth_at_the_objects_centre():
    frame = frame_of()
    camera, T = frame.camera, frame.T_world_cam
    center_m = (T @ np.array([0, 0, 1.5, 1]))[:3]  # on the optical axis, 1.5 m away
    u, v = round(camera.cx), round(camera.cy)
    box = (u - 10, v - 10, u + 10, v + 10)
    near, far = observation_at_depth(1.46, box), observation_at_depth(1.7, box)
    aside = observation_at_depth(1.5, (0, 0, 20, 20))
    got = middles_of([near, far, aside], "mug", center_m, 0.07)
    assert (got.in_view, got.found, got.within) == (3, 2, 1)
    assert got.share == 0.5
    behind = (T @ np.array([0, 0, -1.5, 1]))[:3]
    assert middles_of([near], "mug", behind, 0.07).in_view == 0


@pytest.mark.parametrize(
    ("args", "status", "sentence"),
    [
        (["/no/such/folder", "--detector", "onnx:x"], 2, "there is no data set at"),
        (["/tmp", "--detector", "onnx:x", "--hz", "0"], 2, "must be above 0"),
    ],
)
def test_wrong_arguments_are_reported_in_one_sentence(
    args: list[str], status: int, sentence: str, capsys: pytest.CaptureFixture[str]
):
    assert main(args) == status
    assert sentence in capsys.readouterr().err


@pytest.mark.skipif(not KITCHEN.is_dir(), reason=f"no real frames at {KITCHEN}")
def test_a_missing_model_ends_the_study_with_the_detectors_message(
    capsys: pytest.CaptureFixture[str],
):
    assert main([str(KITCHEN), "--detector", "onnx:/no/model.onnx", "--cores", "0"]) == 1
    assert "/no/model.onnx is not there; put a YOLOX model" in capsys.readouterr().err


@pytest.mark.skipif(not KITCHEN.is_dir(), reason=f"no real frames at {KITCHEN}")
@pytest.mark.skipif(not MODEL.is_file(), reason=f"no model at {MODEL}")
def test_real_frames_get_right_masks_and_one_answer_per_keyframe(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    """The age limit is off here: ages need a machine without other load."""
    args = ["--detector", f"onnx:{MODEL}", "--at", "1.80,0.715,0.80", "--at", "1.655,-0.265,0.785"]
    figures = tmp_path / "figures.json"
    status = main([str(KITCHEN), *args, "--seconds", "3", "--limit-ms", "1e6", "--cores", "0",
                   "--json", str(figures)])  # fmt: skip
    assert status == 0, capsys.readouterr()
    assert '"older": 0' in figures.read_text()
