"""Real frames and a real detector give both mugs and one table. Skipped without the data."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
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
from helios_detector.backend import DetectorBackend, DetectorOptions
from helios_detector.model_loading import open_detector
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings

SHARED = Path(__file__).resolve().parents[4] / "shared"
KITCHEN = SHARED / "data" / "redkitchen"
MODEL = SHARED / "models" / "yolox_nano.onnx"

MUG_A_M, MUG_B_M = np.array([1.80, 0.715, 0.80]), np.array([1.655, -0.265, 0.785])
THRESHOLDS = {
    "cup": 0.25, "bowl": 0.25, "microwave": 0.45, "book": 0.25, "dining table": 0.25,
    "chair": 0.25, "tv": 0.25,
}  # fmt: skip
CONTEXT = SearchContext(
    "c",
    tuple(
        SearchClass(name, Role.START_RECEPTACLE if "table" in name else Role.OBJECT, threshold)
        for name, threshold in THRESHOLDS.items()
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


@dataclass(frozen=True)
class Walk:
    objects: tuple[ObjectInstance, ...]  # after all frames
    best: dict[int, float]  # highest Psi that each cup ever had
    size: int  # Gaussians after all frames
    size_again: int  # after the same frames once more


@pytest.fixture(scope="module")
def walk(detector) -> Walk:
    built, best, found = ObjectMap(ObjectMapSettings()), {}, []
    for frame in kitchen_frames():
        found.append(detector.detect(frame, CONTEXT).detections)
        built.update(Observation(frame, CONTEXT.id, found[-1], {}, "yolox"), CONTEXT)
        for o in built.objects():
            if o.class_name == "cup":
                best[o.id] = max(o.score, best.get(o.id, 0.0))
    objects, size = built.objects(), len(built)
    for frame, detections in zip(kitchen_frames(), found, strict=True):
        built.update(Observation(frame, CONTEXT.id, detections, {}, "yolox"), CONTEXT)
    return Walk(objects, best, size, len(built))


def of_class(walk: Walk, name: str) -> list[ObjectInstance]:
    return sorted((o for o in walk.objects if o.class_name == name), key=lambda o: -o.score)


def test_both_mugs_are_found_within_6_cm_of_the_truth(walk):
    a, b = of_class(walk, "cup")[:2]
    assert np.linalg.norm(a.center_m - MUG_A_M) < 0.06
    assert np.linalg.norm(b.center_m - MUG_B_M) < 0.06
    assert a.score >= 0.55
    assert b.score >= 0.45


def test_exactly_two_cups_ever_reach_a_score_of_one_half(walk):
    assert sum(score >= 0.5 for score in walk.best.values()) == 2
    assert all(o.score <= 0.3 for o in of_class(walk, "cup")[2:])


def test_an_absent_bowl_or_microwave_gets_only_low_scores(walk):
    assert all(o.score <= 0.3 for o in of_class(walk, "bowl"))
    mugs = [o.score for o in of_class(walk, "cup")[:2]]
    assert all(o.score < min(0.5, *mugs) for o in of_class(walk, "microwave"))


def test_exactly_one_table_is_found(walk):
    assert len([o for o in of_class(walk, "dining table") if o.score >= 0.5]) == 1


def test_the_number_of_gaussians_levels_off(walk):
    assert walk.size < 100_000
    assert walk.size_again < 1.05 * walk.size
