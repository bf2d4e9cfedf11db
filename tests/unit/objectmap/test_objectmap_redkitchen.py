"""Real frames and a real detector: both mugs, and one table. Skips without the data."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_core.geometry import Pinhole
from helios_core.types import (
    Frame,
    FrameId,
    ObjectInstance,
    Observation,
    Role,
    SearchClass,
    SearchContext,
)
from helios_detector.backend import DetectorBackend, DetectorOptions, open_detector
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings

SHARED = Path(__file__).resolve().parents[4] / "shared"
KITCHEN = SHARED / "data" / "redkitchen"
MODEL = SHARED / "models" / "yolox_nano.onnx"

MUG_A_M, MUG_B_M = np.array([1.80, 0.715, 0.80]), np.array([1.655, -0.265, 0.785])
CONTEXT = SearchContext(
    "c",
    (
        SearchClass("cup", Role.OBJECT, 0.25),
        SearchClass("dining table", Role.START_RECEPTACLE, 0.35),
    ),
)

pytestmark = [
    pytest.mark.skipif(not KITCHEN.is_dir(), reason=f"no real frames at {KITCHEN}"),
    pytest.mark.skipif(not MODEL.is_file(), reason=f"no model at {MODEL}"),
]


def kitchen_frames() -> Iterator[Frame]:
    meta = json.loads((KITCHEN / "meta.json").read_text())
    camera = Pinhole(*(meta[k] for k in ("fx", "fy", "cx", "cy", "width", "height")))
    with (KITCHEN / "poses.csv").open() as file:
        rows = list(csv.reader(file))[1:]
    for row in rows:
        seq = int(row[0])
        bgr = cv2.imread(str(KITCHEN / "frames" / f"{seq:06d}.jpg"))
        depth_mm = cv2.imread(str(KITCHEN / "frames" / f"{seq:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert bgr is not None
        assert depth_mm is not None
        T = np.vstack([np.array(row[2:], float).reshape(3, 4), [0, 0, 0, 1]])
        color = np.ascontiguousarray(bgr[..., ::-1], np.uint8)
        depth_m = (depth_mm / 1000).astype(np.float32)
        stamp_ns = int(float(row[1]) * 1e9)
        yield Frame(FrameId("k", 0, seq), stamp_ns, True, color, depth_m, camera, T, np.eye(4))


@pytest.fixture(scope="module")
def detector() -> DetectorBackend:
    pytest.importorskip("onnxruntime")
    out = open_detector(f"onnx:{MODEL}", DetectorOptions())
    out.warm_up()
    return out


@pytest.fixture(scope="module")
def walk(detector) -> tuple[tuple[ObjectInstance, ...], list[int]]:
    """The objects after all frames, and the number of Gaussians after each."""
    objects, sizes = ObjectMap(ObjectMapSettings()), []
    for frame in kitchen_frames():
        detections = detector.detect(frame, CONTEXT).detections
        objects.update(Observation(frame, CONTEXT.id, detections, {}, "yolox"), CONTEXT)
        sizes.append(len(objects))
    return objects.objects(), sizes


def cups(walk) -> list[ObjectInstance]:
    return sorted((o for o in walk[0] if o.class_name == "cup"), key=lambda o: -o.score)


def test_both_mugs_are_believed_within_6_cm_of_the_truth(walk):
    a, b = cups(walk)[:2]
    assert np.linalg.norm(a.center_m - MUG_A_M) < 0.06
    assert np.linalg.norm(b.center_m - MUG_B_M) < 0.06
    assert a.score >= 0.55
    assert b.score >= 0.45


def test_no_other_cup_is_believed(walk):
    assert all(o.score <= 0.3 for o in cups(walk)[2:])


def test_there_is_one_table(walk):
    assert len([o for o in walk[0] if o.class_name == "dining table" and o.score >= 0.5]) == 1


def test_the_number_of_gaussians_levels_off(walk):
    sizes = walk[1]
    assert sizes[-1] < 100_000
    assert sizes[-1] < 1.1 * sizes[-40]
