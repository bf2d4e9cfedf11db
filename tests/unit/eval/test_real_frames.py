"""Tests the study of beliefs on real frames, with a folder of images that show one block."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_client.usage_errors import UsageError
from helios_core.types import Detection, Frame, Role, SearchContext
from helios_detector.backend import DetectorBackend, Findings
from helios_eval.studies import real_frames
from helios_eval.studies.real_frames import arms_of, context_of, figures, place, table
from helios_eval.studies.real_frames_beliefs import (
    EpisodeProgress,
    Seen,
    belief_progress,
    frames_of,
)
from helios_eval.studies.real_frames_pictures import (
    belief_curves,
    count_curves,
    draw_beliefs,
    draw_counts,
    drawn,
)
from helios_replay.rgbd_folder import read_dataset

SHAPE = (48, 64)
THING = (slice(16, 32), slice(24, 40))  # pixels of a block 1 m in front of the camera


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three views, each 0.1 m farther from a block in the middle of the image."""
    out = tmp_path_factory.mktemp("frames")
    (out / "frames").mkdir()
    meta = {"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}
    (out / "meta.json").write_text(json.dumps(meta | {"depth_scale_m": 0.001}))
    lines = ["frame,t_s,r00,r01,r02,tx,r10,r11,r12,ty,r20,r21,r22,tz"]
    for k in range(3):
        depth_mm = np.full(SHAPE, 2000 + 100 * k, np.uint16)
        depth_mm[THING] = 1000 + 100 * k
        cv2.imwrite(str(out / "frames" / f"{k:06d}.png"), depth_mm)
        cv2.imwrite(str(out / "frames" / f"{k:06d}.jpg"), np.full((*SHAPE, 3), 128, np.uint8))
        lines.append(f"{k},{k},1,0,0,0,0,1,0,0,0,0,1,{-0.1 * k}")
    (out / "poses.csv").write_text("\n".join(lines) + "\n")
    return out


class Painter(DetectorBackend):
    """Detects the block as a cup."""

    name = "painter"

    def vocabulary(self):
        return None

    def refused(self, context):
        return {}

    def warm_up(self):
        return

    def close(self):
        return

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        mask = np.zeros(SHAPE, bool)
        mask[THING] = True
        return Findings((Detection("cup", 0.9, (24, 16, 40, 32), mask),), ())


def test_the_object_at_a_place_is_reported_under_its_name_in_every_arm(folder):
    places = [place("mine=cup@0,0,1.0")]
    arms = arms_of(["size_agreement=on"])
    found = belief_progress(
        read_dataset(folder), Painter(), context_of("cup", "", ""), places, arms
    )
    plain, by_size = found["default"], found["size_agreement=on"]
    assert len(plain.seen) == len(plain.gaussians) == 3
    assert plain.frames == [0, 1, 2]
    assert plain.highest("mine") >= plain.ended("mine") > 0.45
    np.testing.assert_allclose(plain.seen[-1]["mine"].center_m, [0, 0, 1], atol=0.05)
    assert 0 < by_size.ended("mine") < 0.7 * plain.ended("mine")  # 0.27 m is large for a cup
    assert plain.gaussians == by_size.gaussians


def test_an_agent_is_an_arm_with_its_settings_of_the_map():
    arms = arms_of([], ["helios", "helios-paper"])
    assert list(arms) == ["default", "helios", "helios-paper"]
    assert (arms["default"].evidence, arms["helios"].evidence) == ("views", "hindsight")
    assert arms["helios-paper"].expected_label == "rendered"


def test_frames_have_the_depth_and_poses_of_the_folder(folder):
    first, *_, last = frames_of(read_dataset(folder))
    assert first.depth_m[THING].max() == pytest.approx(1.0)
    assert last.depth_m[THING].max() == pytest.approx(1.2)
    assert last.T_world_cam[2, 3] == pytest.approx(-0.2)


def test_a_full_map_takes_no_more_frames(folder):
    fine = arms_of(["stride_px=1"])["stride_px=1"]
    arms = {"fine": fine, "small": fine.model_copy(update={"max_gaussians": 100})}
    found = belief_progress(read_dataset(folder), Painter(), context_of("cup", "", ""), [], arms)
    assert (found["fine"].is_full, found["fine"].frames) == (False, [0, 1, 2])
    assert (found["small"].is_full, found["small"].frames) == (True, [0])
    assert found["small"].gaussians == found["fine"].gaussians[:1]


def cup(psi: float, **probabilities: float) -> Seen:
    return Seen("cup", psi, {"cup": psi, "other": 0.1, **probabilities}, (1.0, 2.0, 3.0))


FOUND = {
    "a": EpisodeProgress(
        [0, 4, 8],
        [1000, 2000, 2500],
        [
            {"mine": cup(0.4, bowl=0.1, tv=0.1)},
            {"mine": cup(0.7, bowl=0.09, tv=0.03), "other cup": cup(0.1, bowl=0.05, tv=0.05)},
            {"mine": cup(0.5, bowl=0.05, tv=0.03)},
        ],
    ),
    "b": EpisodeProgress(
        [0, 4], [1000, 9000], [{}, {"table": Seen("table", 0.2, {"cup": 0.1}, (0, 0, 0))}], True
    ),
}


def test_the_table_shows_the_final_and_highest_score_of_each_name():
    text = table(FOUND)
    assert "| | mine | other cup | table |" in text
    assert "| a | 0.50 (0.70) | 0.00 (0.10) | 0.00 (0.00) |" in text
    assert "| b (full at frame 4) | 0.00 (0.00) | 0.00 (0.00) | 0.20 (0.20) |" in text


def test_an_object_has_a_curve_of_psi_and_one_of_each_rival_class():
    psi, rival, other = belief_curves(FOUND["a"], ["mine", "other cup", "table"])
    assert (psi.label, rival.label) == ("mine as cup: Ψ", "mine as bowl: mean probability")
    assert psi.thing == rival.thing == "mine"
    assert (psi.rival, rival.rival) == (0, 1)
    np.testing.assert_array_equal(psi.frames, [0, 4, 8])
    np.testing.assert_array_equal(psi.values, [0.4, 0.7, 0.5])
    np.testing.assert_array_equal(rival.values, [0.1, 0.09, 0.05])
    assert other.label == "other cup: Ψ"  # no rival class there
    np.testing.assert_array_equal(other.values, [np.nan, 0.1, np.nan])


def test_each_map_has_a_curve_of_its_gaussian_count_up_to_its_last_frame():
    a, b = count_curves(FOUND)
    np.testing.assert_array_equal(a.values, [1, 2, 2.5])
    np.testing.assert_array_equal(b.values, [1, 9])
    np.testing.assert_array_equal(b.frames, [0, 4])
    assert b.label == "b (full at frame 4)"


def test_the_plot_shows_the_named_objects_or_else_the_accepted_ones():
    assert drawn(FOUND, ["table", "nowhere", "mine"]) == ["table", "mine"]
    assert drawn(FOUND, []) == ["mine"]
    assert drawn({"b": FOUND["b"]}, []) == ["table"]


def test_the_figures_and_both_plots_are_written(tmp_path):
    reported = json.loads(json.dumps(figures(FOUND)))
    assert reported["b"]["frames"] == [0, 4]
    assert reported["a"]["psi"][1] == {"mine": 0.7, "other cup": 0.1}
    assert reported["a"]["probabilities"][2]["mine"]["bowl"] == 0.05
    assert reported["a"]["center_m"][0] == {"mine": [1, 2, 3]}
    draw_beliefs(FOUND, [], tmp_path / "psi.png")
    draw_counts(FOUND, tmp_path / "gaussians.png")
    for name, panels in (("psi.png", 2), ("gaussians.png", 1)):
        image = cv2.imread(str(tmp_path / name))
        assert image is not None
        assert image.shape[0] > 300 * panels
        assert (image[0, 0] == 255).all()


def test_receptacle_classes_get_a_receptacle_role():
    roles = {c.name: c.role for c in context_of("cup,table", "", "table").classes}
    assert roles == {"cup": Role.OBJECT, "table": Role.START_RECEPTACLE}
    with pytest.raises(UsageError, match="desk"):
        context_of("cup,table", "", "desk")


def test_invalid_arguments_are_refused_with_a_reason(capsys, tmp_path):
    with pytest.raises(argparse.ArgumentTypeError, match="NAME=CLASS@X,Y,Z"):
        place("mug A=1,2,3")
    with pytest.raises(UsageError, match="colour"):
        arms_of(["colour=red"])
    reported = ["--detector", "onnx:x", "--classes", "cup", "--out", str(tmp_path)]
    assert real_frames.main([str(tmp_path / "nowhere"), *reported]) == 2
    assert "there is no data set" in capsys.readouterr().err
