"""The realism study: how recognised objects are counted. People judge the images themselves."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from helios_core.errors import Unavailable
from helios_core.geometry import Pinhole, project
from helios_core.types import Detection
from helios_detector.coco_classes import COCO_NAMES
from helios_eval.studies import realism
from helios_eval.studies.realism import main
from helios_eval.studies.realism_judging import Judgement, Row, judged, names_for, rows_of, table
from helios_eval.studies.realism_views import ObserverCamera, Thing, iou, looking, outline_of
from helios_sim.home import PRESETS, generate_home

MODEL = Path(__file__).resolve().parents[4] / "shared" / "models" / "yolox_nano.onnx"
CHAIR = Thing("chair_1", "chair", (10, 10, 30, 50), 600, 0.9, 0.8, None)


def detection(name: str, score: float, box: tuple[int, int, int, int]) -> Detection:
    return Detection(name, score, box, np.zeros((60, 80), bool))


def test_iou_measures_the_overlap_of_two_boxes():
    assert iou((0, 0, 10, 10), (0, 0, 10, 10)) == 1
    assert iou((0, 0, 10, 10), (5, 0, 15, 10)) == pytest.approx(1 / 3)
    assert iou((0, 0, 10, 10), (10, 0, 20, 10)) == 0


def test_an_object_counts_under_its_own_name_or_else_under_a_related_name():
    assert names_for("sofa", COCO_NAMES) == {"couch"}
    assert names_for("coffee table", COCO_NAMES) == {"dining table"}
    assert names_for("wardrobe", COCO_NAMES) == frozenset()
    assert names_for("wardrobe", None) == {"wardrobe"}


def test_a_right_name_beats_a_stronger_wrong_name_and_other_places_do_not_count():
    right, wrong = frozenset({"chair"}), detection("bench", 0.9, (10, 10, 30, 50))
    good = detection("chair", 0.4, (12, 12, 30, 50))
    away = detection("chair", 0.9, (40, 10, 60, 50))
    assert judged(CHAIR, "parametric", [wrong, good, away], right).recognised
    missed = judged(CHAIR, "parametric", [wrong, away], right)
    assert (missed.found, missed.recognised) == ("bench", False)
    assert judged(CHAIR, "parametric", [away], right).found == ""


def test_the_table_shows_recognition_rates_and_confusions():
    sights = [
        Judgement("parametric", "chair", "chair", 0.9, True),
        Judgement("parametric", "chair", "bench", 0.5, False),
        Judgement("realistic", "chair", "", 0.0, False),
    ]
    rows = rows_of(sights)
    assert rows["chair", "parametric"] == Row(2, 1, (("bench", 1),))
    text = table(rows, {"chair": frozenset({"chair"})})
    assert "| chair | chair | 50% of 2 | bench 1 | 0% of 1 | nothing |" in text


def test_looking_points_the_camera_at_its_target():
    camera = Pinhole(400.0, 400.0, 320.0, 240.0, 640, 480)
    T = looking(np.array([1.0, 2.0, 1.3]), np.array([3.0, -1.0, 0.5]))
    uv, z = project(np.array([[3.0, -1.0, 0.5], [3.0, -1.0, 0.6]]), camera, T)
    np.testing.assert_allclose(uv[0], [320, 240], atol=1e-9)
    assert z[0] == pytest.approx(np.linalg.norm([2, -3, -0.8]))
    assert uv[1][1] < 240  # higher in the world is higher in the image


def test_the_outline_of_an_object_is_that_of_its_projected_points():
    camera = Pinhole(400.0, 400.0, 320.0, 240.0, 640, 480)
    eye = np.array([2.0, 0.0, 0.5])
    T = looking(eye, np.array([0.0, 0.0, 0.5]))
    square = np.array([[0.0, y, 0.5 + z] for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
    outline = outline_of(square, camera, T)  # 0.2 m, 2 m away: 40 pixels wide
    assert outline is not None
    assert iou(outline[0], (300, 220, 340, 260)) > 0.9
    assert outline[1] == pytest.approx(1600, rel=0.01)
    assert outline_of(square + np.array([0.0, 2.0, 0.0]), camera, T) is None  # outside the image
    assert outline_of(square + np.array([4.0, 0.0, 0.0]), camera, T) is None  # behind the camera


def test_a_view_lists_its_objects_and_how_much_of_each_is_unoccluded():
    home = generate_home(0, PRESETS["demo-v1"])
    eye = ObserverCamera(home, None)
    try:
        views = list(eye.views({home.objects[0].class_name}))
    finally:
        eye.close()
    things = [t for v in views for t in v.things]
    assert home.objects[0].name in {t.name for t in things}
    assert all(0 <= t.open_box <= 1 for t in things)
    whole = [t for t in things if t.open_box > 0.9 and t.pixels > 400]
    assert whole
    assert all(0.2 < t.open_pixels < 1.3 for t in whole)


def test_a_missing_model_or_furniture_is_reported_in_one_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    args = ["--detector", "onnx:/no/model.onnx", "--out", "/tmp/none"]
    assert main([*args, "--furniture", "parametric"]) == 1
    assert "/no/model.onnx is not there" in capsys.readouterr().err

    def nothing_baked() -> None:
        raise Unavailable("no furniture is baked; bake it with: helios assets bake")

    monkeypatch.setattr(realism, "realistic", nothing_baked)
    assert main(args) == 1
    assert "helios assets bake" in capsys.readouterr().err


@pytest.mark.skipif(not MODEL.is_file(), reason=f"no model at {MODEL}")
def test_the_command_writes_figures_a_table_and_images(tmp_path: Path):
    status = main(
        ["--detector", f"onnx:{MODEL}", "--preset", "demo-v1", "--furniture", "parametric",
         "--seeds", "0", "--out", str(tmp_path)]
    )  # fmt: skip
    assert status == 0
    figures = json.loads((tmp_path / "realism.json").read_text())
    assert figures["views"]["parametric"] > 5
    seen = {row["class"]: row for row in figures["rows"]}
    assert all(row["recognised"] <= row["seen"] for row in seen.values())
    assert "| thing | counts as |" in (tmp_path / "realism.md").read_text()
    for name in ("realism-classes.png", "realism-parametric.jpg"):
        assert cv2.imread(str(tmp_path / name)) is not None
    assert not (tmp_path / "attributions.md").exists()
