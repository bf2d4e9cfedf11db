"""Real frames and a real detector give both mugs and one table. Skipped without the data."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_core.agent_presets import service_settings
from helios_core.geometry import Pinhole
from helios_core.household_names import HOUSEHOLD_NAMES
from helios_core.types import (
    Detection,
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
    "cup": 0.25,
    "bowl": 0.25,
    "microwave": 0.45,
    "book": 0.25,
    "dining table": 0.25,
    "chair": 0.25,
    "tv": 0.25,
}
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
    best_microwave: float  # highest Psi of any microwave at any frame
    size: int  # Gaussians after all frames
    size_again: int  # after the same frames once more


@pytest.fixture(scope="module")
def walk(detector) -> Walk:
    found = [detector.detect(frame, CONTEXT).detections for frame in kitchen_frames()]
    return walked(ObjectMap(ObjectMapSettings()), CONTEXT, found, again=True)


@pytest.fixture(scope="module")
def walk_of_helios(detector) -> Walk:
    """Map with the settings of `helios`, with its threshold and all household names asked for."""
    classes = tuple(replace(c, threshold=0.2) for c in CONTEXT.classes)
    context = replace(CONTEXT, classes=classes, also=HOUSEHOLD_NAMES)
    settings = ObjectMapSettings.model_validate(service_settings("objectmap", "helios"))
    found = [detector.detect(frame, context).detections for frame in kitchen_frames()]
    return walked(ObjectMap(settings), context, found, again=False)


def walked(
    built: ObjectMap, context: SearchContext, found: list[tuple[Detection, ...]], *, again: bool
) -> Walk:
    best: dict[int, float] = {}
    best_microwave = 0.0
    for frame, detections in zip(kitchen_frames(), found, strict=True):
        built.update(Observation(frame, context.id, detections, {}, "yolox"), context)
        for o in built.objects():
            if o.class_name == "cup":
                best[o.id] = max(o.score, best.get(o.id, 0.0))
            elif o.class_name == "microwave":
                best_microwave = max(best_microwave, o.score)
    objects, size = built.objects(), len(built)
    for frame, detections in zip(kitchen_frames(), found, strict=True) if again else ():
        built.update(Observation(frame, context.id, detections, {}, "yolox"), context)
    return Walk(objects, best, best_microwave, size, len(built))


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


def test_helios_accepts_both_mugs_and_neither_another_cup_nor_the_false_microwave(walk_of_helios):
    tau = float(service_settings("planner", "helios")["tau_g"])
    a, b = of_class(walk_of_helios, "cup")[:2]
    assert np.linalg.norm(a.center_m - MUG_A_M) < 0.06
    assert np.linalg.norm(b.center_m - MUG_B_M) < 0.06
    assert sum(score >= tau for score in walk_of_helios.best.values()) == 2
    assert walk_of_helios.best_microwave < tau <= min(a.score, b.score)


def test_the_number_of_gaussians_levels_off(walk):
    assert walk.size < 100_000
    assert walk.size_again < 1.05 * walk.size
