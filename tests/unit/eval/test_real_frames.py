"""What is believed of real frames: a folder of images with a thing that one map is told of."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_client.wrong_use import WrongUse
from helios_core.types import Detection, Frame, Role, SearchContext
from helios_detector.backend import DetectorBackend, Findings
from helios_eval import real_frames
from helios_eval.real_frames import Course, arms_of, context_of, courses, frames_of, place, table
from helios_replay.dataset import read_dataset

SHAPE = (48, 64)
THING = (slice(16, 32), slice(24, 40))  # pixels of a block 1 m before the camera


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three views, each 0.1 m farther from the block, which fills the middle of the image."""
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
    """Calls the block a cup."""

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


def test_the_thing_at_a_place_is_told_by_its_name_in_every_arm(folder):
    places = [place("mine=cup@0,0,1.0")]
    arms = arms_of(["size_agreement=on"])
    found = courses(read_dataset(folder), Painter(), context_of("cup", "", ""), places, arms)
    plain, by_size = found["default"], found["size_agreement=on"]
    assert len(plain.psi) == len(plain.gaussians) == 3
    assert plain.highest("mine") >= plain.ended("mine") > 0.5
    assert 0 < by_size.ended("mine") < 0.7 * plain.ended("mine")  # 0.27 m is much for a cup
    assert plain.gaussians == by_size.gaussians


def test_frames_carry_what_the_folder_says(folder):
    first, *_, last = frames_of(read_dataset(folder))
    assert first.depth_m[THING].max() == pytest.approx(1.0)
    assert last.depth_m[THING].max() == pytest.approx(1.2)
    assert last.T_world_cam[2, 3] == pytest.approx(-0.2)


def test_a_table_has_the_end_and_the_highest_of_each_name():
    text = table({"a": Course([1, 1], [{"x": 0.7}, {"x": 0.5, "other cup": 0.1}])})
    assert "| a | 0.10 (0.10) | 0.50 (0.70) |" in text


def test_classes_that_are_receptacles_are_searched_as_such():
    roles = {c.name: c.role for c in context_of("cup,table", "", "table").classes}
    assert roles == {"cup": Role.OBJECT, "table": Role.START_RECEPTACLE}
    with pytest.raises(WrongUse, match="desk"):
        context_of("cup,table", "", "desk")


def test_what_makes_no_sense_is_said(capsys, tmp_path):
    with pytest.raises(argparse.ArgumentTypeError, match="NAME=CLASS@X,Y,Z"):
        place("mug A=1,2,3")
    with pytest.raises(WrongUse, match="colour"):
        arms_of(["colour=red"])
    told = ["--detector", "onnx:x", "--classes", "cup", "--out", str(tmp_path)]
    assert real_frames.main([str(tmp_path / "nowhere"), *told]) == 2
    assert "there is no data set" in capsys.readouterr().err
